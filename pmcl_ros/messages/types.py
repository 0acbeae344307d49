"""The classes of ROS messages: ROS's own, or rosbags' of the same fields where ROS is missing."""

from array import array
from importlib import import_module
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.messages.cdr import typestore
from pmcl_ros.runtime.errors import BagError


def message_class(name: str) -> type:
    """ROS's class of `PACKAGE/msg/KIND`; BagError when it is not installed."""
    try:
        package, _, kind = name.split('/')
        return getattr(import_module(f'{package}.msg'), kind)
    except ValueError:
        raise BagError(f'{name!r} is no message type, as PACKAGE/msg/KIND') from None
    except (ImportError, AttributeError):
        raise BagError(f'message type {name} is not installed: install ros-jazzy-'
                       f'{package.replace("_", "-")}, or leave its topic out') from None


def _class(name: str) -> Any:
    try:
        return message_class(name)
    except BagError:
        return typestore().types[name]


Time: Any = _class('builtin_interfaces/msg/Time')
Point: Any = _class('geometry_msgs/msg/Point')
Pose: Any = _class('geometry_msgs/msg/Pose')
PoseArray: Any = _class('geometry_msgs/msg/PoseArray')
PoseStamped: Any = _class('geometry_msgs/msg/PoseStamped')
PoseWithCovariance: Any = _class('geometry_msgs/msg/PoseWithCovariance')
PoseWithCovarianceStamped: Any = _class('geometry_msgs/msg/PoseWithCovarianceStamped')
Quaternion: Any = _class('geometry_msgs/msg/Quaternion')
Transform: Any = _class('geometry_msgs/msg/Transform')
TransformStamped: Any = _class('geometry_msgs/msg/TransformStamped')
Vector3: Any = _class('geometry_msgs/msg/Vector3')
CameraInfo: Any = _class('sensor_msgs/msg/CameraInfo')
CompressedImage: Any = _class('sensor_msgs/msg/CompressedImage')
Image: Any = _class('sensor_msgs/msg/Image')
RegionOfInterest: Any = _class('sensor_msgs/msg/RegionOfInterest')
Float32MultiArray: Any = _class('std_msgs/msg/Float32MultiArray')
HeaderMessage: Any = _class('std_msgs/msg/Header')
MultiArrayDimension: Any = _class('std_msgs/msg/MultiArrayDimension')
MultiArrayLayout: Any = _class('std_msgs/msg/MultiArrayLayout')
String: Any = _class('std_msgs/msg/String')


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
