"""The command connection under cameras that answer anything."""

import contextlib
import socket
import struct
import threading
import time
import tracemalloc
from itertools import cycle

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pmcl_ros.camera.lytro import protocol
from pmcl_ros.camera.lytro.address import Address, LinkSettings
from pmcl_ros.camera.lytro.buffer_lock import buffer_lock
from pmcl_ros.camera.lytro.link import Link
from pmcl_ros.camera.lytro.protocol import CHUNK, load_file
from pmcl_ros.runtime.errors import CameraError, LinkError, ProtocolError

BATTERY = bytes.fromhex('AF55AAFA 04000000 03000000 C600 06' + '00' * 13 + '0000AF42')
QUICK = LinkSettings(timeout=0.2, patience=0.3)  # for cameras that do not answer
SURE = LinkSettings(timeout=60, patience=60)  # for those that do, however busy the machine
WRONG = LinkSettings(timeout=60, patience=0.3, slowest=1.0)  # whose answers are wrong each time


@contextlib.contextmanager
def camera(answer):
    """Calls `answer(connection, request)` for each 28 bytes; its address."""
    with socket.create_server(('127.0.0.1', 0)) as listening:
        open_ones = []

        def serve():
            with contextlib.suppress(OSError):
                while True:
                    open_ones.append(listening.accept()[0])
                    threading.Thread(target=converse, args=[open_ones[-1]], daemon=True).start()

        def converse(connected):
            with connected, contextlib.suppress(OSError):
                while request := connected.recv(28, socket.MSG_WAITALL):
                    answer(connected, request)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield Address(host='127.0.0.1', port=listening.getsockname()[1])
        finally:
            listening.shutdown(socket.SHUT_RDWR)
            thread.join()
            for each in open_ones:
                each.close()


def reply(request, payload):
    flags = struct.unpack_from('<I', request, 8)[0]
    return struct.pack('<III', 0xFAAA55AF, len(payload), flags | 2) + request[12:] + payload


def test_a_reply_in_single_bytes():
    def answer(connected, _):
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for byte in BATTERY:
            connected.sendall(bytes([byte]))
            time.sleep(0.001)

    with camera(answer) as address:
        link = Link(address, SURE)
        before = link.last_exchange
        assert link.ask(protocol.BATTERY) == bytes.fromhex('0000AF42')
        assert link.last_exchange > before


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 31), st.integers(1, 255)), min_size=1, max_size=3),
       st.integers(0, 32))
def test_damaged_replies_end_in_the_packages_own_errors(flips, cut):
    data = bytearray(BATTERY)
    for place, flip in flips:
        data[place] ^= flip

    def answer(connected, _):
        connected.sendall(data[:cut])
        connected.close()

    with camera(answer) as address:
        link = Link(address, LinkSettings(timeout=0.2, patience=0.01))
        with contextlib.suppress(CameraError):
            assert len(link.ask(protocol.BATTERY)) <= 4
        link.close()


def test_gigabytes_that_are_announced_are_not_allocated():
    lies = iter([reply(bytes.fromhex('AF55AAFA 04000000 01000000 C600 00' + '00' * 13),
                       struct.pack('<I', 2**32 - 1))])

    def answer(connected, request):
        if request[12] == 0xC6:
            connected.sendall(next(lies, BATTERY))
        else:
            connected.sendall(reply(request, b''))

    with camera(answer) as address:
        tracemalloc.start()
        with pytest.raises(CameraError, match='has 4294967295 bytes, more than any file'):
            Link(address, WRONG).load(protocol.LOAD_PICTURE_LIST, 'the picture list')
        assert tracemalloc.get_traced_memory()[1] < 10_000_000
        tracemalloc.stop()


def test_a_header_that_announces_gigabytes_is_refused():
    def answer(connected, request):
        connected.sendall(BATTERY[:4] + b'\xff\xff\xff\xff' + BATTERY[8:28] + bytes(1000))

    with camera(answer) as address, pytest.raises(
            ProtocolError, match='announces 4294967295 bytes, at most 4'):
        Link(address, WRONG).ask(protocol.BATTERY)


def test_a_camera_that_sends_a_byte_now_and_then_is_given_up():
    def answer(connected, _):
        for byte in BATTERY:
            connected.sendall(bytes([byte]))
            time.sleep(0.1)

    with camera(answer) as address, pytest.raises(LinkError, match='lost the camera'):
        Link(address, QUICK).ask_once(protocol.BATTERY)  # without a deadline it would succeed


@pytest.mark.parametrize('bytes_a_connection', [1, 100_000])
def test_a_download_that_drips_meets_a_limit_in_all(bytes_a_connection):
    def answer(connected, request):
        if request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', 100_000)))
        elif request[12] == 0xC4:
            body = reply(request, bytes(int.from_bytes(request[4:8], 'little')))
            connected.sendall(body[:28])
            for each in body[28:28 + bytes_a_connection]:  # never silent for long
                connected.sendall(bytes([each]))
                time.sleep(0.02)
            connected.close()
        else:
            connected.sendall(reply(request, b''))

    patient = LinkSettings(timeout=1, patience=0.5, slowest=1_000_000)
    began = time.monotonic()
    with camera(answer) as address, pytest.raises(
            CameraError, match='of 100000 bytes came within 1 s, too slow') as error:
        Link(address, patient).load(protocol.LOAD_CALIBRATION, 'the calibration')
    assert not isinstance(error.value, LinkError)  # no other try
    assert time.monotonic() - began < 60  # at their pace 100000 bytes take 2000 s


def test_nothing_of_the_buffer_is_told():
    def answer(connected, request):
        connected.sendall(reply(request, struct.pack('<I', 100) if request[12] == 0xC6 else b''))

    with camera(answer) as address, pytest.raises(
            ProtocolError, match='sends no byte 0 of 100 of the picture list'):
        Link(address, WRONG).load(protocol.LOAD_PICTURE_LIST, 'the picture list')


def file_server(lengths, send):
    """What a camera answers to the commands that load a file: its lengths, and by send(connected,
    request) its pieces."""
    def answer(connected, request):
        if request[12] == 0xC2:
            length = struct.unpack_from('<I', request, 4)[0]
            connected.sendall(reply(request, connected.recv(length, socket.MSG_WAITALL)))
        elif request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', next(lengths))))
        else:
            send(connected, request)
    return answer


def test_a_file_that_changes_its_length_is_refused():
    def half(connected, request):
        connected.sendall(reply(request, bytes(60))[:58])
        connected.close()

    with camera(file_server(iter([100, 50]), half)) as address, pytest.raises(
            CameraError, match=r'A\.RAW has 50 bytes, expected 100'):
        Link(address, WRONG).load(load_file('A.RAW'), 'A.RAW')


def test_a_list_that_grows_while_the_connection_is_lost_is_read_again():
    # It is loaded, cut off, loaded again, found to be longer, and loaded from its beginning.
    lists, cut = iter([b'a' * 100, b'b' * 150, b'b' * 150]), [True]
    held = b''

    def answer(connected, request):
        nonlocal held
        if request[12] == 0xC2:
            held = next(lists)
            connected.sendall(reply(request, b''))
        elif request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', len(held))))
        elif cut.pop():
            cut.append(False)
            connected.sendall(reply(request, held)[:58])
            connected.close()
        else:
            cut.append(False)
            offset = struct.unpack_from('<I', request, 15)[0]
            connected.sendall(reply(request, held[offset:]))

    with camera(answer) as address:
        link = Link(address, SURE)
        assert link.load(protocol.LOAD_PICTURE_LIST, 'list', grows=True) == b'b' * 150


def test_one_request_is_in_flight_at_a_time():
    flying, most = [], []

    def answer(connected, request):
        flying.append(request)
        most.append(len(flying))
        time.sleep(0.01)
        flying.pop()
        connected.sendall(BATTERY)

    with camera(answer) as address:
        link = Link(address, SURE)
        threads = [threading.Thread(target=link.ask, args=[protocol.BATTERY]) for _ in range(10)]
        for each in threads:
            each.start()
        for each in threads:
            each.join()
        assert most == [1] * 10


def test_closing_ends_what_waits():
    asked = threading.Event()
    with camera(lambda *_: asked.set()) as address:
        link, errors = Link(address, SURE), []

        def wait():
            try:
                link.ask(protocol.BATTERY)
            except LinkError as error:
                errors.append(error)

        thread = threading.Thread(target=wait)
        thread.start()
        assert asked.wait(60)
        link.close()
        thread.join(60)
        assert not thread.is_alive()
        assert len(errors) == 1
        with pytest.raises(LinkError, match='is closed'):
            link.ask_once(protocol.BATTERY)


@pytest.mark.parametrize('host', ['127.0.0.1', 'no.such.host.invalid', 'x' * 100])
def test_nobody_there_says_what_to_look_at(host):
    with socket.create_server(('127.0.0.1', 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(LinkError, match=r'no camera answers .*network lytro\.camera\.NNN'):
        Link(Address(host=host, port=port), QUICK).ask(protocol.BATTERY)


def test_a_buffer_that_another_client_replaces_is_no_picture():
    """Raw pictures are equally long: only their bytes tell them apart."""
    length, held = CHUNK + 1000, b'a'

    def answer(connected, request):
        nonlocal held
        if request[12] == 0xC2:
            connected.recv(struct.unpack_from('<I', request, 4)[0], socket.MSG_WAITALL)
            held = b'a'
            connected.sendall(reply(request, b'there'))
        elif request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', length)))
        else:
            offset, asked = struct.unpack_from('<I', request, 15)[0], struct.unpack_from(
                '<I', request, 4)[0]
            connected.sendall(reply(request, held * min(asked, length - offset)))
            held = b'b'

    with camera(answer) as address, pytest.raises(
            ProtocolError, match=r'bytes 0 to 4096 of A\.RAW are not the same twice'):
        Link(address, WRONG).load(load_file('A.RAW'), 'A.RAW')


@pytest.mark.parametrize(('lengths', 'pieces', 'told'), [
    ([100], [b'b' * 60, b'a' * 60], r'bytes 0 to 60 of A\.RAW are not the same twice'),
    ([100, 50], [b'a' * 100], r'A\.RAW has 50 bytes, expected 100')], ids=['piece', 'end'])
def test_a_short_file_that_another_client_replaces_is_none_either(lengths, pieces, told):
    pieces = cycle(pieces)

    def send(connected, request):
        connected.sendall(reply(request, next(pieces)))

    with camera(file_server(cycle(lengths), send)) as address, pytest.raises(
            CameraError, match=told):
        Link(address, WRONG).load(load_file('A.RAW'), 'A.RAW')


def test_a_long_reply_may_take_longer_than_a_short_one():
    def answer(connected, request):
        if request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', 20_000)))
        elif request[12] == 0xC4:
            body = reply(request, b'a' * 20_000)
            for begin in range(0, len(body), 2000):  # 3 s in all
                connected.sendall(body[begin:begin + 2000])
                time.sleep(0.3)
        else:
            connected.sendall(reply(request, b''))

    with camera(answer) as address:
        link = Link(address, LinkSettings(timeout=2, patience=2, slowest=1_000))
        assert link.load(protocol.LOAD_PICTURE_LIST, 'the list') == b'a' * 20_000
        assert link.made == 1


def test_silence_in_a_long_reply_ends_it_as_in_a_short_one():
    def answer(connected, request):
        connected.sendall(reply(request, bytes(CHUNK))[:99])

    began = time.monotonic()
    with camera(answer) as address, pytest.raises(LinkError, match='timed out'):
        Link(address, QUICK).ask_once(protocol.download(0, CHUNK))
    assert time.monotonic() - began < 60  # at the slowest pace it would take 210 s


def test_who_waits_for_the_buffer_of_a_camera_meets_a_limit():
    with buffer_lock(('10.0.0.1', 5678), 1, threading.Event()):
        with (pytest.raises(CameraError, match=r'from the camera at 10\.0\.0\.1 for 0 s'),
              buffer_lock(('10.0.0.1', 5678), 0.2, threading.Event())):
            pass
        closed = threading.Event()
        closed.set()
        with (pytest.raises(LinkError, match='is closed'),
              buffer_lock(('10.0.0.1', 5678), 20, closed)):
            pass
        for other in (('10.0.0.2', 5678), ('10.0.0.1', 5679)):
            with buffer_lock(other, 0, closed):
                pass
    with buffer_lock(('10.0.0.1', 5678), 0, closed):
        pass


def test_a_buffer_is_waited_for_as_long_as_another_program_may_take_for_a_picture():
    def answer(connected, request):
        payload = struct.pack('<I', 4) if request[12] == 0xC6 else b'list'
        connected.sendall(reply(request, b'' if request[12] == 0xC2 else payload))

    with camera(answer) as address:
        link, came = Link(address, LinkSettings(timeout=20, patience=0.2)), []
        thread = threading.Thread(target=lambda: came.append(
            link.load(protocol.LOAD_PICTURE_LIST, 'the list')))
        with buffer_lock((address.host, address.port), 1, threading.Event()):
            thread.start()
            time.sleep(1)
            assert not came
        thread.join()
        assert came == [b'list']


def test_a_connection_that_was_reset_is_made_anew():
    """The camera turned its Wi-Fi off and on while nothing was asked."""
    def answer(connected, request):
        if request[12] == 0xC6:
            connected.sendall(reply(request, struct.pack('<I', 4)))
        elif request[12] == 0xC2:
            connected.sendall(reply(request, b''))
        else:
            connected.sendall(reply(request, b'list'))
            connected.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack('ii', 1, 0))
            connected.close()

    with camera(answer) as address:
        link = Link(address, SURE)
        for _ in range(2):
            assert link.load(protocol.LOAD_PICTURE_LIST, 'the picture list') == b'list'
            time.sleep(0.05)  # the reset arrives
        link.close()
