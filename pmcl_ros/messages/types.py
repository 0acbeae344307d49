"""The classes of ROS messages: ROS's own, or rosbags' of the same fields where ROS is missing."""

from array import array
from importlib import import_module
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.runtime.errors import BagError

try:
    from builtin_interfaces.msg import Time
    from geometry_msgs.msg import (
        Point,
        Pose,
        PoseArray,
        PoseStamped,
        PoseWithCovariance,
        PoseWithCovarianceStamped,
        Quaternion,
        Transform,
        TransformStamped,
        Vector3,
    )
    from sensor_msgs.msg import CameraInfo, Image, RegionOfInterest
    from std_msgs.msg import (
        Float32MultiArray,
        MultiArrayDimension,
        MultiArrayLayout,
        String,
    )
    from std_msgs.msg import Header as HeaderMessage
except ImportError:
    from rosbags.typesys import Stores, get_typestore

    _TYPES = get_typestore(Stores.ROS2_JAZZY).types
    Time = _TYPES['builtin_interfaces/msg/Time']
    Point = _TYPES['geometry_msgs/msg/Point']
    Pose = _TYPES['geometry_msgs/msg/Pose']
    PoseArray = _TYPES['geometry_msgs/msg/PoseArray']
    PoseStamped = _TYPES['geometry_msgs/msg/PoseStamped']
    PoseWithCovariance = _TYPES['geometry_msgs/msg/PoseWithCovariance']
    PoseWithCovarianceStamped = _TYPES['geometry_msgs/msg/PoseWithCovarianceStamped']
    Quaternion = _TYPES['geometry_msgs/msg/Quaternion']
    Transform = _TYPES['geometry_msgs/msg/Transform']
    TransformStamped = _TYPES['geometry_msgs/msg/TransformStamped']
    Vector3 = _TYPES['geometry_msgs/msg/Vector3']
    CameraInfo = _TYPES['sensor_msgs/msg/CameraInfo']
    Image = _TYPES['sensor_msgs/msg/Image']
    RegionOfInterest = _TYPES['sensor_msgs/msg/RegionOfInterest']
    Float32MultiArray = _TYPES['std_msgs/msg/Float32MultiArray']
    MultiArrayDimension = _TYPES['std_msgs/msg/MultiArrayDimension']
    MultiArrayLayout = _TYPES['std_msgs/msg/MultiArrayLayout']
    String = _TYPES['std_msgs/msg/String']
    HeaderMessage = _TYPES['std_msgs/msg/Header']

__all__ = [
    'Buffer',
    'CameraInfo',
    'Float32MultiArray',
    'HeaderMessage',
    'Image',
    'MultiArrayDimension',
    'MultiArrayLayout',
    'Point',
    'Pose',
    'PoseArray',
    'PoseStamped',
    'PoseWithCovariance',
    'PoseWithCovarianceStamped',
    'Quaternion',
    'RegionOfInterest',
    'String',
    'Time',
    'Transform',
    'TransformStamped',
    'Vector3',
    'message_class',
]


def message_class(name: str) -> type:
    """The class of `PACKAGE/msg/KIND`; BagError when it is not installed."""
    package, _, kind = name.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise BagError(f'message type {name} is not installed') from None


class Buffer:
    """A publisher's message with a big array, reused from one publication to the next.

    To assign such a field copies it, numpy arrays and lists element by element: 0.8 s for a volume
    of 32 MB. To fill the array of an old message through a numpy view of it takes 5 ms.
    """

    def __init__(self) -> None:
        self._message: Any = None

    def message(self, kind: Any, typecode: str, shape: tuple[int, ...],
                dtype: str) -> tuple[Any, NDArray[Any]]:
        """A message of this class, and its data as a writable array of this shape and dtype.

        The caller sets all other fields.
        """
        size = prod(shape) * np.dtype(dtype).itemsize
        if not isinstance(self._message, kind) or memoryview(self._message.data).nbytes != size:
            ros = hasattr(kind, 'get_fields_and_field_types')
            message: Any = kind() if ros else object.__new__(kind)  # rosbags' have no defaults
            message.data = array(typecode, bytes(size))
            self._message = message
        return self._message, np.frombuffer(self._message.data, dtype).reshape(shape)
