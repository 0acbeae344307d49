"""Messages as they were sent."""

from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore
from std_msgs.msg import Float32MultiArray


def multi_array_from(cdr: bytes) -> Float32MultiArray:
    """A `dlv` or `dlv/edges` message as it was sent: see `message_from`."""
    return message_from(cdr, Float32MultiArray)


def message_from(cdr: bytes, kind: type) -> Any:
    """A message of type `kind` as it was sent; its arrays are numpy.

    They are copied once, to be writable as all others are: numba compiles for that. rclpy copies
    them three times, in ways that take longer than all of the transport.
    """
    # numpy's new memory comes in huge pages, which a bytearray's does not: 20 ms less of 40.
    copy = np.frombuffer(cdr, np.uint8).copy()
    package = kind.__module__.partition('.')[0]
    return _types().deserialize_cdr(memoryview(copy), f'{package}/msg/{kind.__name__}')


@cache
def _types() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)
