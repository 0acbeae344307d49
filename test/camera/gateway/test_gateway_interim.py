"""A camera that takes longer for a picture than a client of its gateway waits in silence."""

import threading
import time
from contextlib import closing, contextmanager

import pytest
from gateways import said
from simulated_cameras import SIDE

from pmcl_ros.camera.client import CameraStatus, Picture
from pmcl_ros.camera.gateway.client import GatewayClient
from pmcl_ros.camera.gateway.handler import Handler
from pmcl_ros.camera.gateway.server import GatewayServer
from pmcl_ros.camera.gateway.service import Cache, Service
from pmcl_ros.camera.gateway.settings import GatewaySettings
from pmcl_ros.runtime.errors import CameraError, LinkError

SILENCE = 2.0  # s
# Patience for no second attempt, which would find what the first has waited for.
SETTINGS = GatewaySettings(timeout=60.0, answer_timeout=SILENCE, patience=0.001)
RAW = bytes(SIDE * SIDE * 3 // 2)
CONTINUE = b'HTTP/1.1 100 Continue\r\n\r\n'


class SlowCamera:
    """Whose every picture takes twice the client's `answer_timeout`."""

    def __init__(self, text, error=None):
        self.text, self.error = text, error
        self.card = [Picture('by hand', 1)]
        self.fetched = 0

    def status(self):
        return CameraStatus('A1', '', None)

    def pictures(self):
        return list(self.card)

    def capture(self):
        self.card.append(Picture(f'picture {len(self.card)}', time.time_ns()))
        return self.card[-1]

    def fetch(self, _):
        self.fetched += 1
        time.sleep(2 * SILENCE)
        if self.error is not None:
            raise self.error
        return RAW, self.text

    def close(self):
        """There is nothing to close."""


@contextmanager
def gateway(camera, pause, monkeypatch):
    monkeypatch.setattr(Handler, 'interim_pause', pause)
    with closing(Service(lambda: camera, Cache())) as service, \
            GatewayServer(service, '127.0.0.1', 0) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


def test_a_slow_picture_is_waited_for(camera_text, monkeypatch):
    camera = SlowCamera(camera_text(SIDE, SIDE))
    with gateway(camera, SILENCE / 10, monkeypatch) as server, \
            GatewayClient(server.url, None, SETTINGS) as client:
        taken = client.capture()
        assert client.fetch(taken) == (RAW, camera.text)
        assert [each.id for each in client.pictures()] == ['by hand', taken.id]
        assert camera.fetched == 1  # with the capture
        assert client.fetch(client.pictures()[0]) == (RAW, camera.text)
        assert camera.fetched == 2


def test_silence_is_not_waited_for(camera_text, monkeypatch):
    with gateway(SlowCamera(camera_text(SIDE, SIDE)), 60.0, monkeypatch) as server, \
            GatewayClient(server.url, None, SETTINGS) as client, \
            pytest.raises(LinkError, match='timed out'):
        client.capture()


@pytest.mark.parametrize(('error', 'status'), [
    (None, b'200 '), (CameraError('no'), b'502 '), (LinkError('no'), b'503 ')])
def test_interim_answers_come_before_the_answer_alone(camera_text, monkeypatch, error, status):
    with gateway(SlowCamera(camera_text(SIDE, SIDE), error), 0.01, monkeypatch) as server:
        answer = said(server, b'GET /pictures/by%20hand/raw HTTP/1.1\r\nHost: localhost\r\n\r\n')
    count = answer.count(CONTINUE)
    assert count > 1
    final = answer[count * len(CONTINUE):]
    assert final.startswith(b'HTTP/1.1 ' + status)
    assert answer == count * CONTINUE + final
    if error is None:
        assert final.endswith(b'\r\n\r\n' + RAW)


def test_http_1_0_has_no_interim_answers(camera_text, monkeypatch):
    with gateway(SlowCamera(camera_text(SIDE, SIDE)), 0.01, monkeypatch) as server:
        answer = said(server, b'GET /pictures/by%20hand/raw HTTP/1.0\r\n\r\n')
    assert answer.startswith(b'HTTP/1.1 200 ')
    assert b'100 Continue' not in answer
