"""Simulated cameras for the tests: small pictures, real sockets."""

import asyncio
import contextlib
import socket
import threading
from contextlib import contextmanager

import numpy as np

from pmcl_ros.camera.lytro.address import LinkSettings
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.camera.packing import pack12
from pmcl_ros.camera.simulated.camera import SimulatedCamera
from pmcl_ros.camera.simulated.card import Card
from pmcl_ros.camera.simulated.faults import Faults
from pmcl_ros.camera.simulated.server import CameraServer

SIDE = 64  # pixels: 6144 bytes
# Of a camera that answers, however busy the machine is; tests of one that does not have their own.
QUICK = LinkSettings(timeout=60, patience=60, picture_timeout=60, watchdog=10)


def write_captures(folder, text, count=3, side=SIDE):
    """`count` pictures of noise, text: their metadata; their bytes."""
    raws = []
    for number in range(count):
        place = folder / f'capture{number}'
        place.mkdir(parents=True)
        counts = np.random.default_rng(number).integers(0, 4096, (side, side)).astype(np.uint16)
        raws.append(pack12(counts))
        (place / 'IMG.RAW').write_bytes(raws[-1])
        (place / 'IMG.TXT').write_text(text)
    return raws


@contextmanager
def in_thread(server):
    """The address of a camera server that runs in a thread of this process."""
    loop = asyncio.new_event_loop()
    task = loop.create_task(server.run())

    def serve():
        with contextlib.suppress(asyncio.CancelledError):
            loop.run_until_complete(task)
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()

    thread = threading.Thread(target=serve, name='simulated camera', daemon=True)
    thread.start()
    try:
        yield server.address
    finally:
        loop.call_soon_threadsafe(task.cancel)
        thread.join()


@contextmanager
def serving(folder, *faults, empty=False, delay=0.02, at=None):
    """The address of a camera in a thread of this process, any or `at`."""
    camera = SimulatedCamera(Card.from_folder(folder, empty=empty), faults=Faults.parse(faults),
                             delay=delay)
    ports = (at.port, at.callback_port) if at else (0, 0)
    with in_thread(CameraServer(camera, '127.0.0.1', *ports)) as address:
        yield address


@contextmanager
def client_of(folder, *faults, settings=QUICK, **options):
    """A client of such a camera."""
    with serving(folder, *faults, **options) as address, LytroClient(address, settings) as client:
        yield client


@contextmanager
def replies_that_can_be_held(address):
    """The address with its commands relayed, and an event: replies wait until it is set."""
    go = threading.Event()
    go.set()
    with socket.create_server((address.host, 0)) as listening:
        def serve():
            with contextlib.suppress(OSError):
                while True:
                    threading.Thread(target=converse, args=listening.accept()[:1],
                                     daemon=True).start()

        def converse(near):
            with near, socket.create_connection((address.host, address.port)) as far:
                replies = threading.Thread(target=relay, args=[far, near, go.wait], daemon=True)
                replies.start()
                relay(near, far, lambda: None)
                replies.join()

        def relay(source, target, wait):
            with contextlib.suppress(OSError):
                while data := source.recv(4096):
                    wait()
                    target.sendall(data)
            for each in (source, target):
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield address.model_copy(update={'port': listening.getsockname()[1]}), go
        finally:
            go.set()
            listening.shutdown(socket.SHUT_RDWR)
            thread.join()


@contextmanager
def callbacks_that_can_be_cut(address):
    """The address with its callbacks relayed, and a function that cuts their connections."""
    with socket.create_server((address.host, 0)) as listening:
        pairs = []

        def serve():
            with contextlib.suppress(OSError):
                while True:
                    near = listening.accept()[0]
                    far = socket.create_connection((address.host, address.callback_port))
                    pairs.append((near, far))
                    threading.Thread(target=relay, args=[near, far], daemon=True).start()

        def relay(near, far):
            with near, far, contextlib.suppress(OSError):
                while data := far.recv(4096):
                    near.sendall(data)

        def cut():
            for pair in pairs:
                for each in pair:
                    with contextlib.suppress(OSError):
                        each.shutdown(socket.SHUT_RDWR)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield address.model_copy(update={'callback_port': listening.getsockname()[1]}), cut
        finally:
            cut()
            listening.shutdown(socket.SHUT_RDWR)
            thread.join()
