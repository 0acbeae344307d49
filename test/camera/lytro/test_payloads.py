"""Payloads, laid out by hand as in lytro_f01.md, A5."""

import contextlib
import struct
from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmcl_ros.camera.lytro import payloads
from pmcl_ros.camera.lytro.payloads import HardwareInfo, PictureRecord
from pmcl_ros.runtime.errors import ProtocolError

ID = 'sha1-' + '0123456789' * 4
RECORD = PictureRecord(100, 7, ID, '2014-05-14T15:32:40.000Z', True, 2.5, 8)
NAMES = st.from_regex(r'[A-Z_]{0,8}', fullmatch=True)
RECORDS = st.builds(PictureRecord, st.integers(0, 999), st.integers(0, 9999), st.just(ID),
                    st.just('2014-05-14T15:32:40.000Z'), st.booleans(), st.floats(width=32,
                    allow_nan=False), st.sampled_from([1, 3, 6, 8]), NAMES, NAMES)
DECODERS = [HardwareInfo.decode, payloads.decode_picture_list, payloads.decode_time,
            payloads.decode_battery, payloads.decode_length, payloads.decode_files]


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
    assert payloads.decode_picture_list(header + record) == [RECORD]
    assert payloads.encode_picture_list([RECORD]) == header + record
    assert payloads.decode_picture_list(header) == []
    assert RECORD.key == record[:24]


def test_longer_records_and_what_is_left_at_the_end():
    header, record = by_hand()
    data = header[:4] + struct.pack('<I', 132) + header[8:] + 2 * (record + b'more') + b'rest'
    assert payloads.decode_picture_list(data) == [RECORD, RECORD]


@given(st.lists(RECORDS, max_size=5))
def test_picture_lists_round(records):
    assert payloads.decode_picture_list(payloads.encode_picture_list(records)) == records


def test_what_a_record_says():
    assert RECORD.path('RAW') == r'I:\DCIM\100PHOTO\IMG_0007.RAW'
    assert RECORD.name == 'IMG_0007'
    assert RECORD.rotation == 90
    assert RECORD.taken == datetime(2014, 5, 14, 15, 32, 40, tzinfo=timezone.utc)
    assert PictureRecord(100, 1, ID, 'yesterday').taken is None


@pytest.mark.parametrize('name', [b'../../et', b'a/b', b'C:\\', b'\xff\xfe', b'\x01'])
def test_names_that_are_no_part_of_a_path_are_refused(name):
    header, record = by_hand()
    with pytest.raises(ProtocolError, match='picture list holds'):
        payloads.decode_picture_list(header + record[:8] + name.ljust(8, b'\0') + record[16:])


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
    assert payloads.encode_time(moment.astimezone(timezone(timedelta(hours=5)))) == data
    assert payloads.decode_time(data) == moment
    assert payloads.decode_battery(bytes.fromhex('0000AF42')) == 87.5
    assert payloads.decode_length(bytes.fromhex('84020000')) == 644
    for impossible in (data[:-1], struct.pack('<7H', 2014, 13, 1, 0, 0, 0, 0),
                       struct.pack('<7H', 2014, 1, 1, 0, 0, 0, 5000)):
        with pytest.raises(ProtocolError):
            payloads.decode_time(impossible)
    for impossible in (float('nan'), float('inf'), -50, 300):
        with pytest.raises(ProtocolError):
            payloads.decode_battery(struct.pack('<f', impossible))


@given(st.dictionaries(st.from_regex(r'[A-Z0-9_.]{1,31}', fullmatch=True), st.binary(max_size=90),
                       max_size=5))
def test_calibration_files_round(files):
    assert payloads.decode_files(payloads.encode_files(files)) == files


def test_the_table_of_the_calibration_is_as_in_the_document():
    data = b''.join([struct.pack('<I32s', 3, b'A.TXT'), struct.pack('<I32s', 2, b'B.RAW'),
                     b'abcde'])
    assert payloads.decode_files(data) == {'A.TXT': b'abc', 'B.RAW': b'de'}
    for wrong in (data[:-1], data + b'x', data[:40]):
        with pytest.raises(ProtocolError):
            payloads.decode_files(wrong)


GOOD = [b''.join(by_hand()), HardwareInfo('Lytro', 'A1', '', '').encode(),
        payloads.encode_files({'A.TXT': b'abc'}), struct.pack('<7H', 2014, 5, 14, 15, 32, 40, 0)]


@given(st.sampled_from(DECODERS), st.sampled_from(GOOD) | st.binary(max_size=300),
       st.lists(st.tuples(st.integers(0, 700), st.binary(min_size=1, max_size=8)), max_size=4),
       st.integers(0, 700))
def test_damaged_payloads_end_in_the_packages_own_errors(decode, data, patches, cut):
    damaged = bytearray(data[:cut])
    for place, patch in patches:
        damaged[place:place + len(patch)] = patch
    with contextlib.suppress(ProtocolError):
        decode(bytes(damaged))
