"""The class of messages of /tf, of a package that may be missing."""

from pmcl_ros.messages.types import message_class
from pmcl_ros.runtime.errors import BagError, SettingsError


def transforms_class(instead: str) -> type:
    """TFMessage, for `set_up` of a node whose parameter broadcast_tf is true.

    instead: a topic that tells the same. Raises SettingsError where tf2_msgs is not installed.
    """
    name = 'tf2_msgs/msg/TFMessage'
    try:
        return message_class(name)
    except BagError:
        raise SettingsError(
            f"parameter 'broadcast_tf' is true, but message type {name} is not installed "
            '(ros-jazzy-tf2-msgs, a part of a full ROS that is not on PyPI): set broadcast_tf to '
            f'false and use the topic {instead}') from None
