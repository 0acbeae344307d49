"""Bytes of the protocol: frames and payloads, against the protocol notes."""

import contextlib
import struct
from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.lytro import protocol
from pmcl_ros.camera.lytro.protocol import (
    Command,
    HardwareInfo,
    Header,
    PictureRecord,
    Request,
    download,
    load_file,
)
from pmcl_ros.runtime.errors import ProtocolError

RAW = r'I:\DCIM\100PHOTO\IMG_0001.RAW'
REQUESTS = [
    (protocol.LOAD_HARDWARE_INFO, 'AF55AAFA 00000000 01000000 C200 00' + '00' * 13),
    (protocol.CONTENT_LENGTH, 'AF55AAFA 04000000 01000000 C600 00' + '00' * 13),
    (download(0, 0xFFFF), 'AF55AAFA FFFF0000 01000000 C400 00 00000000' + '00' * 9),
    (protocol.TAKE_PICTURE, 'AF55AAFA 00000000 01000000 C000 00' + '00' * 13),
    (protocol.LOAD_PICTURE_LIST, 'AF55AAFA 00000000 01000000 C200 02' + '00' * 13),
    (protocol.BATTERY, 'AF55AAFA 04000000 01000000 C600 06' + '00' * 13),
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
    (protocol.LOAD_HARDWARE_INFO, 'AF55AAFA 00000000 03000000 C200 00' + '00' * 13, 0),
    (protocol.CONTENT_LENGTH, 'AF55AAFA 04000000 03000000 C600 00' + '00' * 13, 4),
    (protocol.TAKE_PICTURE, 'AF55AAFA 00000000 03000000 C000 00' + '00' * 13, 0),
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
    reply = protocol.BATTERY.header.reply(2**32 - 1)
    with pytest.raises(ProtocolError, match='BATTERY announces 4294967295 bytes, at most 4'):
        protocol.BATTERY.check(reply)


ID = 'sha1-' + '0123456789' * 4
RECORD = PictureRecord(100, 7, ID, '2014-05-14T15:32:40.000Z', True, 2.5, 8)
NAMES = st.from_regex(r'[A-Z_]{0,8}', fullmatch=True)
RECORDS = st.builds(PictureRecord, st.integers(0, 999), st.integers(0, 9999), st.just(ID),
                    st.just('2014-05-14T15:32:40.000Z'), st.booleans(), st.floats(width=32,
                    allow_nan=False), st.sampled_from([1, 3, 6, 8]), NAMES, NAMES)
DECODERS = [HardwareInfo.decode, protocol.decode_picture_list, protocol.decode_time,
            protocol.decode_battery, protocol.decode_length, protocol.decode_files]


def by_hand():
    """The record and the list of the document."""
    record = bytearray(128)
    record[0x00:0x05], record[0x08:0x0C] = b'PHOTO', b'IMG_'
    record[0x10:0x18] = struct.pack('<ii', 100, 7)
    record[0x28:0x30] = struct.pack('<if', 1, 2.5)
    record[0x30:0x30 + 45] = ID.encode()
    record[0x60:0x60 + 24] = b'2014-05-14T15:32:40.000Z'
    record[0x7C:0x80] = struct.pack('<i', 8)
    header = struct.pack('<III', 1, 128, 10)
    for index, offset in enumerate((0, 8, 0x10, 0x14, 0x18, 0x28, 0x2C, 0x30, 0x60, 0x7C)):
        header += struct.pack('<II', index, offset)
    assert len(header) == 0x5C
    return header, bytes(record)


def test_a_picture_list():
    header, record = by_hand()
    assert protocol.decode_picture_list(header + record) == [RECORD]
    assert protocol.encode_picture_list([RECORD]) == header + record
    assert protocol.decode_picture_list(header) == []
    assert RECORD.key == record[:24]


def test_longer_records_and_what_is_left_at_the_end():
    header, record = by_hand()
    data = header[:4] + struct.pack('<I', 132) + header[8:] + 2 * (record + b'more') + b'rest'
    assert protocol.decode_picture_list(data) == [RECORD, RECORD]


@pytest.mark.parametrize('length', [0, 127, 4097, 2**31, 2**32 - 1])
def test_impossible_lengths_of_a_record_are_no_empty_card(length):
    header, record = by_hand()
    with pytest.raises(ProtocolError, match=f'records of {length} bytes'):
        protocol.decode_picture_list(header[:4] + struct.pack('<I', length) + header[8:] + record)


def test_a_list_of_more_pictures_than_a_card_holds_is_refused():
    header, record = by_hand()
    with pytest.raises(ProtocolError, match='100001 pictures'):
        protocol.decode_picture_list(header + 100_001 * record)


@given(st.lists(RECORDS, max_size=5))
def test_picture_lists_round(records):
    assert protocol.decode_picture_list(protocol.encode_picture_list(records)) == records


def test_what_a_record_says():
    assert RECORD.path('RAW') == r'I:\DCIM\100PHOTO\IMG_0007.RAW'
    assert RECORD.name == 'IMG_0007'
    assert PictureRecord(101, 1234, ID, '').path('TXT') == r'I:\DCIM\101PHOTO\IMG_1234.TXT'
    assert RECORD.taken == datetime(2014, 5, 14, 15, 32, 40, tzinfo=timezone.utc)
    assert PictureRecord(100, 1, ID, RECORD.date.removesuffix('Z')).taken == RECORD.taken
    assert PictureRecord(100, 1, ID, 'yesterday').taken is None


@pytest.mark.parametrize('name', [b'../../et', b'a/b', b'C:\\', b'\xff\xfe', b'\x01'])
def test_names_that_are_no_part_of_a_path_are_refused(name):
    header, record = by_hand()
    with pytest.raises(ProtocolError, match='picture list holds'):
        protocol.decode_picture_list(header + record[:8] + name.ljust(8, b'\0') + record[16:])


@pytest.mark.parametrize(('place', 'value'), [
    (0x10, struct.pack('<i', -1)), (0x14, struct.pack('<i', -1)), (0x30, bytes(48))],
    ids=['folder', 'number', 'id'])
def test_a_record_of_no_picture_is_refused(place, value):
    header, record = by_hand()
    with pytest.raises(ProtocolError, match='impossible record'):
        protocol.decode_picture_list(
            header + record[:place] + value + record[place + len(value):])


def test_a_serial_number_that_is_no_line_of_text_is_refused():
    with pytest.raises(ProtocolError, match='hardware info holds'):
        HardwareInfo.decode(HardwareInfo('Lytro', 'A1\n', '', '').encode())


def test_hardware_info():
    data = bytearray(644)
    for offset, text in ((0, b'Lytro, Inc.'), (0x100, b'A102381403'), (0x180, b'1.0'),
                         (0x200, b'v1.2.2')):
        data[offset:offset + len(text)] = text
    info = HardwareInfo('Lytro, Inc.', 'A102381403', '1.0', 'v1.2.2')
    assert HardwareInfo.decode(bytes(data)) == info
    assert info.encode() == bytes(data)


def test_time_battery_and_length():
    moment = datetime(2014, 5, 14, 15, 32, 40, 123000, timezone.utc)
    data = struct.pack('<7H', 2014, 5, 14, 15, 32, 40, 123)
    assert protocol.encode_time(moment.astimezone(timezone(timedelta(hours=5)))) == data
    assert protocol.decode_time(data) == moment
    assert [protocol.decode_battery(struct.pack('<f', each)) for each in (87.5, 100.5, -0.5)] == [
        87.5, 100, 0]
    assert protocol.decode_length(bytes.fromhex('84020000')) == 644
    for impossible in (data[:-1], struct.pack('<7H', 2014, 13, 1, 0, 0, 0, 0),
                       struct.pack('<7H', 2014, 1, 1, 0, 0, 0, 5000)):
        with pytest.raises(ProtocolError):
            protocol.decode_time(impossible)
    for impossible in (float('nan'), float('inf'), -50, 300):
        with pytest.raises(ProtocolError):
            protocol.decode_battery(struct.pack('<f', impossible))


@given(st.dictionaries(st.from_regex(r'[A-Z0-9_.]{1,31}', fullmatch=True), st.binary(max_size=90),
                       max_size=5))
def test_calibration_files_round(files):
    assert protocol.decode_files(protocol.encode_files(files)) == files


def test_the_table_of_the_calibration_is_as_in_the_document():
    data = b''.join([struct.pack('<I32s', 3, b'A.TXT'), struct.pack('<I32s', 2, b'B.RAW'),
                     b'abcde'])
    assert protocol.decode_files(data) == {'A.TXT': b'abc', 'B.RAW': b'de'}
    endless = bytes(36 * 4097)  # empty files without a name
    for wrong in (data[:-1], data + b'x', data[:40], endless):
        with pytest.raises(ProtocolError):
            protocol.decode_files(wrong)


GOOD = [b''.join(by_hand()), HardwareInfo('Lytro', 'A1', '', '').encode(),
        protocol.encode_files({'A.TXT': b'abc'}), struct.pack('<7H', 2014, 5, 14, 15, 32, 40, 0)]


@given(st.sampled_from(DECODERS), st.sampled_from(GOOD) | st.binary(max_size=300),
       st.lists(st.tuples(st.integers(0, 700), st.binary(min_size=1, max_size=8)), max_size=4),
       st.integers(0, 700))
def test_damaged_payloads_end_in_the_packages_own_errors(decode, data, patches, cut):
    damaged = bytearray(data[:cut])
    for place, patch in patches:
        damaged[place:place + len(patch)] = patch
    with contextlib.suppress(ProtocolError):
        decode(bytes(damaged))
