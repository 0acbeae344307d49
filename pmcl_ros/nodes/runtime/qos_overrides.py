"""The user's word on quality of service: parameters `qos_overrides./TOPIC.publisher.depth` etc.

rclpy declares them, read-only, with each publisher and subscription: they are given when a node is
started, by file or command line.
"""

import copy
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import InvalidQosOverridesError, QoSOverridingOptions

from pmcl_ros.nodes.runtime.parameters import OVERRIDES, unknown_parameters
from pmcl_ros.runtime.errors import SettingsError


@contextmanager
def overridable(node: Node, topic: str, qos: QoSProfile, big: bool
                ) -> Iterator[tuple[QoSProfile, QoSOverridingOptions]]:
    """What an endpoint is made with, inside: its profile, and what lets history, depth and
    reliability of it be overridden.

    big: messages of many packets, for which some choices are allowed but warned of. Raises
    SettingsError for what is no quality of service.
    """
    def check(chosen: QoSProfile) -> SetParametersResult:
        if chosen.depth < 1:
            return SetParametersResult(successful=False, reason=f'depth {chosen.depth} keeps '
                                       'nothing: it must be 1 or more')
        if big and chosen.reliability == ReliabilityPolicy.BEST_EFFORT:
            node.get_logger().warning(f'{topic} is best effort by qos_overrides: most of its '
                                      'messages, which are big, will be lost')
        if big and chosen.history == HistoryPolicy.KEEP_ALL:
            node.get_logger().warning(f'{topic} keeps all by qos_overrides: its messages, which '
                                      'are big, may fill the memory')
        return SetParametersResult(successful=True)

    try:
        # a copy: rclpy writes what is overridden into the profile it gets
        yield copy.copy(qos), QoSOverridingOptions.with_default_policies(callback=check)
    except (InvalidQosOverridesError, InvalidParameterTypeException, RuntimeError,
            InvalidParameterValueException) as error:
        if isinstance(error, RuntimeError) and 'QoS override' not in str(error):
            raise  # rclpy has no error of its own for a policy that does not exist
        raise SettingsError(f'{topic}: {error}. Correct {OVERRIDES}* that the node is started '
                            'with and start it again') from None


def warn_of_unknown(node: Node) -> None:
    """Warn of overrides without a publisher or subscription, once all of these exist."""
    known = list(node.get_parameters_by_prefix(OVERRIDES.rstrip('.')))
    for name in unknown_parameters(node):
        if name.startswith(OVERRIDES):
            close = get_close_matches(name.removeprefix(OVERRIDES), known, 1)
            hint = f'; did you mean {OVERRIDES}{close[0]}?' if close else ''
            node.get_logger().warning(f'{name} is without effect: the node has no such publisher '
                                      f'or subscription as it is configured{hint}')
