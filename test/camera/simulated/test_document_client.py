"""A client written from lytro_f01.md alone, on raw sockets, with nothing of the package."""

import hashlib
import json
import socket
import struct
import time

import cv2
import numpy as np
import pytest
from simulated_cameras import SIDE, serving, write_captures
from waiting import eventually

EMPTY = '00' * 13


class DocumentClient:
    """Reads 28 bytes, then exactly `length` bytes; nothing may ever be left over."""

    def __init__(self, address):
        # A preview unpacks the picture, whose kernel may have to be compiled first.
        self.socket = socket.create_connection((address.host, address.port), 120)

    def read(self, count):
        data = b''
        while len(data) < count:
            piece = self.socket.recv(count - len(data))
            assert piece, 'closed by the camera'
            data += piece
        return data

    def ask(self, message):
        """message: hexadecimal or bytes; the header and the payload of the reply."""
        self.socket.sendall(bytes.fromhex(message) if isinstance(message, str) else message)
        header = self.read(28)
        return header, self.read(struct.unpack_from('<I', header, 4)[0])

    def command(self, group, sub, payload=None, length=0, parameters=b''):
        flags = 1 if payload is None else 0
        if payload is not None:
            length = len(payload)
        header = struct.pack('<IIIBBB13s', 0xFAAA55AF, length, flags, group, 0, sub, parameters)
        reply, content = self.ask(header + (payload or b''))
        magic, got, reply_flags = struct.unpack_from('<III', reply)
        assert (magic, got, reply_flags) == (0xFAAA55AF, len(content), flags | 2)
        assert reply[12:] == header[12:]  # class, sub-command and parameters are echoed
        return content

    def length(self):
        return struct.unpack('<I', self.command(0xC6, 0, length=4))[0]

    def buffer(self, chunk=0xFFFF, sub=0):
        total, data = self.length(), b''
        while len(data) < total:
            piece = self.command(0xC4, sub, length=chunk, parameters=struct.pack('<I', len(data)))
            assert len(piece) == min(chunk, total - len(data))
            data += piece
        assert self.command(0xC4, sub, length=chunk, parameters=struct.pack('<I', total)) == b''
        return data

    def file(self, path, **how):
        text = path.encode() + b'\0'
        assert self.command(0xC2, 1, text) == text  # mirrored
        return self.buffer(**how)

    def records(self):
        self.command(0xC2, 2)
        data = self.buffer()
        assert (len(data) - 0x5C) % 128 == 0
        return [data[each:each + 128] for each in range(0x5C, len(data), 128)]

    def nothing_is_left(self):
        self.socket.settimeout(0.05)
        with pytest.raises(TimeoutError):
            self.socket.recv(1)
        self.socket.close()


@pytest.fixture
def camera(tmp_path, camera_text):
    """A camera of three pictures and a white image; its address and what it serves."""
    raws = write_captures(tmp_path, camera_text(SIDE, SIDE))
    white = json.loads(camera_text(SIDE, SIDE))
    text = json.dumps({'master': {'picture': {
        'frameArray': [{'frame': {'metadata': white | {'devices': {'mla': {'lensPitch': 1.4e-5}}},
                                  'privateMetadata': {'camera': {'serialNumber': 'A1'}}}}],
        'parameters': {'vendorContent': {'com.lytro.tags': {'modulationFrame': True}}}}}})
    white_raw = write_captures(tmp_path / 'white', text, 1)
    with serving(tmp_path) as address:
        yield address, [*raws, *white_raw], text


@pytest.fixture
def client(camera):
    client = DocumentClient(camera[0])
    yield client
    client.nothing_is_left()


def test_the_worked_messages(client):
    header, content = client.ask('AF55AAFA 00000000 01000000 C200 00' + EMPTY)
    assert header == bytes.fromhex('AF55AAFA 00000000 03000000 C200 00' + EMPTY)
    header, content = client.ask('AF55AAFA 04000000 01000000 C600 00' + EMPTY)
    assert header == bytes.fromhex('AF55AAFA 04000000 03000000 C600 00' + EMPTY)
    assert content == bytes.fromhex('84020000')
    header, content = client.ask('AF55AAFA FFFF0000 01000000 C400 00 00000000' + '00' * 9)
    assert header == bytes.fromhex('AF55AAFA 84020000 03000000 C400 00 00000000' + '00' * 9)
    assert content.startswith(b'Lytro, Inc.\0')
    assert content[0x100:0x102] != b'\0\0'  # a serial number
    header, content = client.ask('AF55AAFA 04000000 01000000 C600 06' + EMPTY)
    assert header == bytes.fromhex('AF55AAFA 04000000 03000000 C600 06' + EMPTY)
    assert content == bytes.fromhex('0000AF42')
    path = rb'I:\DCIM\100PHOTO\IMG_0001.RAW' + b'\0'
    ask = 'AF55AAFA 1E000000 00000000 C200 01' + EMPTY + path.hex()
    header, content = client.ask(ask)
    assert header == bytes.fromhex('AF55AAFA 1E000000 02000000 C200 01' + EMPTY)
    assert content == path
    header, content = client.ask(ask.replace(b'IMG_0001'.hex(), b'IMG_4711'.hex()))
    assert header == bytes.fromhex('AF55AAFA 00000000 02000000 C200 01' + EMPTY)
    header, content = client.ask('AF55AAFA 04000000 00000000 C000 0C 03' + '00' * 12 + '332E3134')
    assert header == bytes.fromhex('AF55AAFA 04000000 02000000 C000 0C 03' + '00' * 12)
    assert content == b'3.14'


@pytest.mark.parametrize('chunk', [1000, 4096, 0xFFFF, 0x200000])
@pytest.mark.parametrize('sub', [0, 1])
def test_downloads_of_every_chunk_size(client, camera, chunk, sub):
    for number in (1, 2, 3):
        path = rf'I:\DCIM\100PHOTO\IMG_{number:04d}.RAW'
        assert client.file(path, chunk=chunk, sub=sub) == camera[1][number - 1]
    assert json.loads(client.file('i:/dcim/100photo/img_0003.txt'))['image']['width'] == SIDE


def test_the_buffer_stays_until_the_next_load(client, camera):
    raw = client.file(r'I:\DCIM\100PHOTO\IMG_0002.RAW')
    assert client.command(0xC2, 1, b'I:\\NO.RAW\0') == b''
    assert client.buffer() == raw
    other = DocumentClient(camera[0])  # the buffer is the camera's, not the connection's
    assert other.buffer() == raw
    other.nothing_is_left()


def test_the_picture_list_and_ids(client, camera):
    records = client.records()
    numbers = [struct.unpack_from('<ii', each, 0x10) for each in records]
    assert numbers == [(100, 3), (100, 2), (100, 1)]  # newest first
    ids = {each[0x30:0x60].rstrip(b'\0') for each in records}
    assert len(ids) == 3
    assert all(len(each) == 45 and each.startswith(b'sha1-') for each in ids)
    newest = records[0]
    assert newest[:0x10] == b'PHOTO\0\0\0IMG_\0\0\0\0'
    assert time.strptime(newest[0x60:0x78].decode(), '%Y-%m-%dT%H:%M:%S.%fZ')
    assert newest[0x7C:] == b'\1\0\0\0'
    identity = newest[0x30:0x60].rstrip(b'\0')
    for digit, size in ((b'1', len(camera[1][2])), (b'3', 128 * 128 * 2)):
        text = identity + digit + b'\0'
        assert client.command(0xC2, 5, text) == text
        content = client.buffer()
        assert content[:4] == struct.pack('<I', size) == struct.pack('<I', len(content) - 4)
    assert client.command(0xC2, 5, identity + b'1\0')
    assert client.buffer()[4:] == camera[1][2]
    assert client.command(0xC2, 5, b'sha1-no1\0') == b''
    assert client.command(0xC2, 5, identity + b'9\0') == b''


def test_previews_show_the_picture(client, camera):
    picture = cv2.imdecode(np.frombuffer(client.file(r'I:\DCIM\100PHOTO\IMG_0001.JPG'), np.uint8),
                           cv2.IMREAD_COLOR)
    assert picture.shape == (328, 328, 3)
    yuyv = np.frombuffer(client.file(r'I:\DCIM\100PHOTO\IMG_0001.128'), np.uint8)
    small = cv2.cvtColor(yuyv.reshape(128, 128, 2), cv2.COLOR_YUV2BGR_YUY2)
    shrunk = cv2.resize(picture, (128, 128), interpolation=cv2.INTER_AREA)
    close = np.corrcoef(small.mean(axis=2).ravel(), shrunk.mean(axis=2).ravel())[0, 1]
    assert close > 0.95


def test_calibration(client, camera):
    client.command(0xC2, 6)
    data = client.buffer()
    entries, used = [], 0
    while 36 * len(entries) + used < len(data):
        length, path = struct.unpack_from('<I32s', data, 36 * len(entries))
        entries.append((path.rstrip(b'\0').decode(), length))
        used += length
    begin, files = 36 * len(entries), {}
    for path, length in entries:
        files[path] = data[begin:begin + length]
        begin += length
    assert files['C:\\T1CALIB\\MOD_0000.RAW'] == camera[1][3]
    assert files['C:\\T1CALIB\\MOD_0000.TXT'].decode() == camera[2]
    assert client.file(r'c:\t1calib\mod_0000.raw') == camera[1][3]
    lenslets = json.loads(client.file('c:/t1calib/mlacalibration.txt'))
    assert lenslets == json.loads(files['C:\\T1CALIB\\MLACALIBRATION.TXT'])


def test_unlock_and_monitor(client):
    client.command(0xC2, 0)
    serial = client.buffer()[0x100:0x180].rstrip(b'\0')
    before = len(client.records())
    assert client.command(0xC0, 0xFF, b'rficapture\0') == b'rficapture\0'  # locked: no effect
    secret = hashlib.sha1(serial + b' please').hexdigest().encode() + b'\0'
    assert len(secret) == 41
    assert client.command(0xC0, 0xFF, secret) == secret
    assert client.command(0xC0, 0xFF, b'rficapture\0') == b'rficapture\0'
    assert client.command(0xC0, 0xFE, b'hello\0') == b'hello\0'
    text = client.command(0xC6, 2, length=0xFFFFF)
    assert b'hello' in text
    assert client.command(0xC6, 2, length=0xFFFFF) == b''  # read once
    eventually(lambda: len(client.records()) == before + 1)


def test_the_clock_is_set(client):
    moment = struct.pack('<7H', 2031, 2, 3, 4, 5, 6, 789)
    assert client.command(0xC0, 4, moment) == moment
    for room in (14, 16, 0xFF):
        assert struct.unpack('<7H', client.command(0xC6, 3, length=room))[:3] == (2031, 2, 3)
    assert client.command(0xC0, 4, b'\xff' * 14) == b'\xff' * 14  # no time: no effect
    assert client.command(0xC6, 3, length=14)[:2] == moment[:2]


def test_unknown_and_odd_commands_get_an_empty_reply(client):
    for group, sub in ((0xC0, 0x01), (0xC1, 0), (0xC3, 0), (0xC5, 0), (0xC6, 0x0A), (0xC2, 0x0B),
                       (0xC2, 7), (0x00, 0), (0xFF, 0xFF)):
        assert client.command(group, sub, length=100) == b''
        assert client.command(group, sub, b'payload\0') == b''
    assert client.command(0xC0, 0x0D) == b''  # Wi-Fi off
    assert client.command(0xC2, 1, b'\xff\xfe') == b''
    assert client.command(0xC0, 0xFF, b'') == b''
    assert client.command(0xC6, 0, length=2) == client.command(0xC6, 0, length=4)[:2]


def test_requests_may_come_in_pieces_or_all_at_once(client, camera):
    client.file(r'I:\DCIM\100PHOTO\IMG_0001.RAW')
    ask = bytes.fromhex('AF55AAFA 00040000 01000000 C400 00')
    asks = [ask + struct.pack('<I9x', each) for each in range(0, 6144, 1024)]
    client.socket.sendall(b''.join(asks))  # as lytro-dl does
    data = b''
    for each in asks:
        assert client.read(28)[12:] == each[12:]
        data += client.read(1024)
    assert data == camera[1][0]
    for byte in asks[0]:
        client.socket.sendall(bytes([byte]))
    assert client.read(28 + 1024)[28:] == data[:1024]


def test_callbacks_of_a_picture(client, camera):
    with socket.create_connection((camera[0].host, camera[0].callback_port), 5) as listening:
        data = b''
        while data.count(b'\0') < 3:
            data += listening.recv(100)
        assert set(data.split(b'\0')[:3]) == {b'[HeartbeatTick] tick\r\n'}
        before = len(client.records())
        assert client.command(0xC0, 0) == b''
        while b'NewPicture' not in data or not data.endswith(b'\0'):
            data += listening.recv(100)
        said = [each for each in data.split(b'\0')[:-1] if b'Heartbeat' not in each]
        assert said[0] == b'[ShutterPressed] CLICK\r\n'
        newest = client.records()[0]
        identity = newest[0x30:0x60].rstrip(b'\0')
        assert said[1] == b'[NewPictureAvailable] ' + identity + b'\r\n'
        assert client.file(r'I:\DCIM\100PHOTO\IMG_0004.RAW') == camera[1][0]  # in turn, again
        key = newest[:24]
        header, content = client.ask('AF55AAFA 18000000 00000000 C000 05' + EMPTY + key.hex())
        assert header == bytes.fromhex('AF55AAFA 18000000 02000000 C000 05' + EMPTY)
        assert content == key
        while b'PictureDeleted' not in data or not data.endswith(b'\0'):
            data += listening.recv(100)
        assert b'[PictureDeleted] ' + identity + b'\r\n\0' in data
        assert len(client.records()) == before


def test_heartbeats_come_ten_times_a_second(camera):
    began, data = time.monotonic(), b''
    with socket.create_connection((camera[0].host, camera[0].callback_port), 60) as listening:
        while data.count(b'\0') < 10:
            data += listening.recv(100)
        assert time.monotonic() - began > 0.8  # not faster; a loaded machine may be slower
