"""Messages <-> CDR, the form in which they are sent and recorded; by rosbags, without ROS."""

from array import array
from dataclasses import fields
from functools import cache
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from pmcl_ros.runtime.errors import MessageError


def type_name(kind: type) -> str:
    """`PACKAGE/msg/KIND` of a message class, ROS's or rosbags'."""
    name = getattr(kind, '__msgtype__', '')
    return name or f'{kind.__module__.partition(".")[0]}/msg/{kind.__name__}'


def message_from(cdr: bytes, name: str) -> Any:
    """A message of the type `name` from its CDR; its arrays are numpy.

    MessageError where the type is not known, or the bytes are none of it.

    They are copied once, to be writable as all others are: numba compiles for that. rclpy copies
    them three times, in ways that take longer than all of the transport.
    """
    # numpy's new memory comes in huge pages, which a bytearray's does not: 20 ms less of 40.
    copy = np.frombuffer(cdr, np.uint8).copy()
    if name not in typestore().types:
        raise MessageError(f'the message type {name!r} is none of ROS 2 Jazzy')
    try:
        return typestore().deserialize_cdr(memoryview(copy), name)
    except Exception as error:  # the code that rosbags makes of a type checks nothing itself
        raise MessageError(f'{len(cdr)} bytes are no {name}: {error!r}') from None


def cdr_from(message: Any) -> bytes:
    """The CDR of a message of `messages.types`."""
    return bytes(typestore().serialize_cdr(_as_rosbags(message), type_name(type(message))))


@cache
def typestore() -> Typestore:
    """The types of ROS 2 Jazzy."""
    return get_typestore(Stores.ROS2_JAZZY)


def _as_rosbags(value: Any) -> Any:
    """A message, or a field of one, in rosbags' classes with numpy arrays."""
    if isinstance(value, array):
        return np.frombuffer(value, value.typecode)
    if isinstance(value, list):
        return [_as_rosbags(each) for each in value]
    if hasattr(value, 'get_fields_and_field_types'):
        names = list(value.get_fields_and_field_types())
    elif hasattr(value, '__msgtype__'):
        names = [each.name for each in fields(value)]
    else:
        return value
    kind = typestore().types[type_name(type(value))]
    return kind(**{name: _as_rosbags(getattr(value, name)) for name in names})
