"""DiagnosticArray: the health of a node."""

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header as HeaderMessage

from pmcl_ros.messages.header import time_to_message


def diagnostics_to_message(stamp_ns: int, status: DiagnosticStatus,
                           values: dict[str, object]) -> DiagnosticArray:
    """`status` with `values`, as its text, for /diagnostics."""
    status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
    return DiagnosticArray(header=HeaderMessage(stamp=time_to_message(stamp_ns)), status=[status])
