"""Header and Time; checks that the messages of a capture belong together."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.types import HeaderMessage, Time
from pmcl_ros.runtime.errors import MessageError, PmclError


class Part(NamedTuple):
    """A message that becomes a value together with others of its capture."""

    header: Header
    message: Any


def header_to_message(header: Header) -> HeaderMessage:
    """Stamp and frame."""
    return HeaderMessage(stamp=time_to_message(header.stamp_ns), frame_id=header.frame_id)


def header_from(message: HeaderMessage) -> Header:
    """The inverse of `header_to_message`."""
    return Header(message.stamp.sec * 10**9 + message.stamp.nanosec, message.frame_id)


def part_from(check: Callable[[Any], object]) -> Callable[[Any], Part]:
    """A reader of messages with a header, which raises what `check` raises for a message."""
    def read(message: Any) -> Part:
        check(message)
        return Part(header_from(message.header), message)
    return read


def time_to_message(stamp_ns: int) -> Time:
    """Nanoseconds since the epoch as a Time, which ends in 2038."""
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    if not -2**31 <= seconds < 2**31:
        raise MessageError(f'stamp {stamp_ns} does not fit into a ROS time (32 bits of seconds): '
                           'it must be nanoseconds since 1970')
    return Time(sec=seconds, nanosec=nanoseconds)


@contextmanager
def promised_by(topic: str) -> Iterator[None]:
    """Turns other errors about a message's content into MessageErrors that name its topic."""
    try:
        yield
    except MessageError:
        raise
    except PmclError as error:
        raise MessageError(f'{topic}: {error}') from None


def check_same(topic: str, found: Header, expected: Header) -> None:
    """MessageError where parts of one capture differ."""
    if found != expected:
        raise MessageError(f'{topic} is of {found}, expected {expected}: messages of one capture '
                           'share stamp and frame')
