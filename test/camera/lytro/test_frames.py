"""Frames, against the worked messages of lytro_f01.md, A8."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.lytro import frames
from pmcl_ros.camera.lytro.frames import Command, Header, Request, download, load_file
from pmcl_ros.runtime.errors import ProtocolError

RAW = r'I:\DCIM\100PHOTO\IMG_0001.RAW'
REQUESTS = [
    (frames.LOAD_HARDWARE_INFO, 'AF55AAFA 00000000 01000000 C200 00' + '00' * 13),
    (frames.CONTENT_LENGTH, 'AF55AAFA 04000000 01000000 C600 00' + '00' * 13),
    (download(0, 0xFFFF), 'AF55AAFA FFFF0000 01000000 C400 00 00000000' + '00' * 9),
    (frames.TAKE_PICTURE, 'AF55AAFA 00000000 01000000 C000 00' + '00' * 13),
    (frames.LOAD_PICTURE_LIST, 'AF55AAFA 00000000 01000000 C200 02' + '00' * 13),
    (frames.BATTERY, 'AF55AAFA 04000000 01000000 C600 06' + '00' * 13),
    (load_file(RAW), 'AF55AAFA 1E000000 00000000 C200 01' + '00' * 13
     + (RAW.encode() + b'\0').hex()),
    (download(0x200000, 0x200000), 'AF55AAFA 00002000 01000000 C400 00 00002000' + '00' * 9),
    (Request(Command.MANUAL_CONTROL, b'3.14', parameters=b'\x03'),
     'AF55AAFA 04000000 00000000 C000 0C 03' + '00' * 12 + '332E3134'),
    (Request(Command.DELETE_PICTURE, b'PHOTO\0\0\0IMG_\0\0\0\0\x64\0\0\0\x01\0\0\0'),
     'AF55AAFA 18000000 00000000 C000 05' + '00' * 13
     + '50484F544F000000 494D475F00000000 64000000 01000000'),
]
REPLIES = [
    (frames.LOAD_HARDWARE_INFO, 'AF55AAFA 00000000 03000000 C200 00' + '00' * 13, 0),
    (frames.CONTENT_LENGTH, 'AF55AAFA 04000000 03000000 C600 00' + '00' * 13, 4),
    (frames.TAKE_PICTURE, 'AF55AAFA 00000000 03000000 C000 00' + '00' * 13, 0),
    (load_file(RAW), 'AF55AAFA 1E000000 02000000 C200 01' + '00' * 13, 30),
    (load_file(RAW), 'AF55AAFA 00000000 02000000 C200 01' + '00' * 13, 0),
    (download(0xE00000, 0x200000),
     'AF55AAFA 803D1600 03000000 C400 00 0000E000' + '00' * 9, 1_457_536),
]


@pytest.mark.parametrize(('request_', 'wire'), REQUESTS)
def test_requests_are_those_of_the_document(request_, wire):
    assert request_.encode() == bytes.fromhex(wire)


@pytest.mark.parametrize(('request_', 'wire', 'length'), REPLIES)
def test_replies_of_the_document_are_understood_and_made(request_, wire, length):
    header = Header.decode(bytes.fromhex(wire))
    assert request_.check(header) == length
    assert request_.header.reply(length).encode() == bytes.fromhex(wire)


@given(st.sampled_from(Command), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1),
       st.binary(min_size=13, max_size=13))
def test_headers_survive_the_wire(command, length, flags, parameters):
    header = Header(command, length, flags, parameters)
    assert len(header.encode()) == 28
    assert Header.decode(header.encode()) == header


@given(st.sampled_from(REPLIES), st.integers(0, 27), st.integers(1, 255))
def test_no_other_header_is_taken_for_the_reply(reply, place, flip):
    request, wire, length = reply
    data = bytearray.fromhex(wire)
    data[place] ^= flip
    try:
        got = request.check(Header.decode(bytes(data)))
    except ProtocolError:
        return
    assert 4 <= place < 8  # a shorter reply to this request is possible, nothing else
    assert got != length
    assert got <= request.header.length


@given(st.binary(max_size=40))
def test_any_bytes_are_a_header_or_refused(data):
    with contextlib.suppress(ProtocolError):
        assert Header.decode(data).encode() == data


def test_a_reply_longer_than_asked_for_is_refused():
    reply = frames.BATTERY.header.reply(2**32 - 1)
    with pytest.raises(ProtocolError, match='BATTERY announces 4294967295 bytes, at most 4'):
        frames.BATTERY.check(reply)
