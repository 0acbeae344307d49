"""The gateway's HTTP, in front of a simulated camera."""

import base64
import hashlib
import logging
import shutil
import time
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from datetime import datetime

import pytest
import requests
from gateways import gateway_of, gateway_to, said
from hypothesis import given, settings
from hypothesis import strategies as st
from simulated_cameras import QUICK, SIDE, serving, write_captures

from pmcl_ros.camera.gateway.server import GatewayServer
from pmcl_ros.camera.gateway.service import Cache, Service
from pmcl_ros.runtime.errors import CameraError, SettingsError

TOKEN = 'a-long-enough-token'
NOBODY = 'sha1-' + 40 * '0'


@pytest.fixture(scope='module')
def folder(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('captures')
    write_captures(folder, camera_text(SIDE, SIDE))
    return folder


@pytest.fixture(scope='module')
def raws(folder):
    return [path.read_bytes() for path in sorted(folder.rglob('*.RAW'))]


@pytest.fixture(scope='module')
def gateway(folder):
    """Whose camera is asked, and takes no pictures."""
    with gateway_of(folder) as server:
        yield server


def ids(gateway):
    return [each['id'] for each in requests.get(f'{gateway.url}/pictures', timeout=30).json()]


def picture_url(gateway, index=0, kind='raw'):
    return f'{gateway.url}/pictures/{ids(gateway)[index]}/{kind}'


def until(condition):
    deadline = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_status(gateway):
    answer = requests.get(f'{gateway.url}/status', timeout=30)
    assert answer.headers['Content-Type'] == 'application/json'
    assert answer.json() == {'link': 'up', 'serial': answer.json()['serial'], 'battery': 87.5,
                             'firmware': answer.json()['firmware'], 'pictures': 3}
    assert 'simulated' in answer.json()['firmware']


def test_pictures_come_as_the_camera_has_them(gateway, raws, camera_text):
    for index, raw in enumerate(raws):
        answer = requests.get(picture_url(gateway, index), timeout=30)
        assert answer.status_code == 200
        assert answer.content == raw
        digest = base64.b64encode(hashlib.sha256(raw).digest()).decode()
        assert answer.headers['Repr-Digest'] == f'sha-256=:{digest}:'
        assert answer.headers['ETag'] == f'"{hashlib.sha256(raw).hexdigest()}"'
        text = requests.get(picture_url(gateway, index, 'txt'), timeout=30)
        assert text.text == camera_text(SIDE, SIDE)
        assert text.headers['Content-Type'] == 'text/plain; charset=utf-8'
        head = requests.head(picture_url(gateway, index), timeout=30)
        assert (head.status_code, head.content) == (200, b'')
        assert head.headers['Content-Length'] == str(len(raw))


@pytest.mark.parametrize(('header', 'part'), [
    ('bytes=0-0', slice(0, 1)), ('bytes=100-199', slice(100, 200)),
    ('bytes=6000-', slice(6000, None)), ('bytes=-5', slice(-5, None)),
    ('bytes=6143-99999', slice(6143, None)), ('bytes=-99999', slice(0, None))])
def test_a_range(gateway, raws, header, part):
    answer = requests.get(picture_url(gateway), headers={'Range': header}, timeout=30)
    start, stop, _ = part.indices(len(raws[0]))
    assert answer.status_code == 206
    assert answer.content == raws[0][part]
    assert answer.headers['Content-Range'] == f'bytes {start}-{stop - 1}/{len(raws[0])}'
    head = requests.head(picture_url(gateway), headers={'Range': header}, timeout=30)
    assert (head.status_code, head.headers['Content-Length']) == (200, str(len(raws[0])))
    assert 'Content-Range' not in head.headers


def test_a_range_beyond_the_end(gateway, raws):
    answer = requests.get(picture_url(gateway), headers={'Range': 'bytes=6144-'}, timeout=30)
    assert answer.status_code == 416
    assert answer.headers['Content-Range'] == f'bytes */{len(raws[0])}'


def test_conditions(gateway, raws):
    url = picture_url(gateway)
    etag = requests.get(url, timeout=30).headers['ETag']
    for tags in (etag, '*', f'"a", W/{etag}'):
        answer = requests.get(url, headers={'If-None-Match': tags}, timeout=30)
        assert (answer.status_code, answer.content, answer.headers['ETag']) == (304, b'', etag)
    assert requests.get(url, headers={'If-None-Match': '"a"'}, timeout=30).content == raws[0]
    for condition, expected in ((etag, (206, raws[0][9:])), ('"a"', (200, raws[0])),
                                (f'W/{etag}', (200, raws[0])),
                                ('Wed, 21 Oct 2015 07:28:00 GMT', (200, raws[0]))):
        answer = requests.get(url, timeout=30, headers={'Range': 'bytes=9-',
                                                       'If-Range': condition})
        assert (answer.status_code, answer.content) == expected


def test_what_was_fetched_needs_no_camera(folder, raws):
    with ExitStack() as camera:
        address = camera.enter_context(serving(folder))
        hasty = QUICK.model_copy(update={'patience': 0.2})
        with gateway_to(address, settings=hasty) as gateway:
            url, other = picture_url(gateway), picture_url(gateway, 1)
            requests.get(url, headers={'Range': 'bytes=0-9'}, timeout=30)
            camera.close()
            assert requests.get(url, timeout=30).content == raws[0]
            assert requests.get(url.replace('raw', 'txt'), timeout=30).status_code == 200
            answer = requests.get(other, timeout=30)
            assert answer.status_code == 503
            assert int(answer.headers['Retry-After']) > 0
            assert str(address.port) in answer.json()['error']
            status = requests.get(f'{gateway.url}/status', timeout=30).json()
            assert status['link'] == 'down'
            assert str(address.port) in status['problem']


def test_the_oldest_pictures_are_forgotten_and_fetched_again(folder, raws, tmp_path):
    with gateway_of(folder, limit=2 * len(raws[0]), cache=tmp_path) as gateway:
        for index in (0, 1, 2, 0, 2, 1):
            assert requests.get(picture_url(gateway, index), timeout=30).content == raws[index]
        files = list(tmp_path.glob('*/*'))
        assert sum(each.stat().st_size for each in files) <= 2 * len(raws[0])
        for each in files:  # somebody tidies up
            each.unlink()
        assert requests.get(picture_url(gateway, 1), timeout=30).content == raws[1]
    assert not files[0].parent.exists()


def capture(gateway, key, **headers):
    return requests.post(f'{gateway.url}/capture', timeout=30,
                         headers={'Idempotency-Key': key, **headers})


def test_a_capture(folder):
    with gateway_of(folder, empty=True) as gateway:
        before = time.time_ns()
        answer = capture(gateway, 'one')
        after = time.time_ns()
        assert answer.status_code == 201
        found = answer.json()
        assert ids(gateway) == [found['id']]
        assert before < found['shutter_ns'] < after
        shutter = datetime.fromisoformat(found['shutter'])
        assert abs(shutter.timestamp() - found['shutter_ns'] / 1e9) < 0.002
        for kind in ('raw', 'txt'):
            body = requests.get(picture_url(gateway, 0, kind), timeout=30)
            assert found[kind] == {'size': len(body.content), 'etag': body.headers['ETag'],
                                   'sha256': hashlib.sha256(body.content).hexdigest()}
        assert capture(gateway, 'one').json() == found
        assert capture(gateway, 'two').json()['id'] != found['id']
        assert len(ids(gateway)) == 2


def test_the_last_hundred_captures_are_known_when_they_are_repeated(folder):
    """Who asks again, as no answer came, gets the picture that was taken, not another one."""
    with gateway_of(folder, empty=True) as gateway:
        taken = [capture(gateway, f'{number}').json()['id'] for number in range(101)]
        for number in range(100, 0, -1):
            assert capture(gateway, f'{number}').json()['id'] == taken[number]
        assert ids(gateway) == taken
        assert capture(gateway, '0').json()['id'] not in taken  # it was forgotten


def test_captures_at_the_same_time(folder, caplog):
    caplog.set_level(logging.DEBUG, 'pmcl_ros.camera.simulated.server')
    with gateway_of(folder, empty=True, delay=4) as gateway, ThreadPoolExecutor(4) as pool:
        answers = [pool.submit(capture, gateway, 'same') for _ in range(4)]
        until(lambda: 'C000' in caplog.text)  # the command to take a picture has come
        busy = capture(gateway, 'other')
        assert busy.status_code == 409
        assert int(busy.headers['Retry-After']) > 0
        found = {answer.result().json()['id'] for answer in answers}
        assert found == set(ids(gateway))
        assert len(found) == 1
        assert capture(gateway, 'other').status_code == 201  # a refusal is not remembered
        assert len(ids(gateway)) == 2


def test_a_capture_that_fails_says_why_and_is_not_tried_again_unasked(folder):
    hasty = QUICK.model_copy(update={'picture_timeout': 5.0})
    with gateway_of(folder, 'busy=1', empty=True, settings=hasty) as gateway:
        answer = capture(gateway, 'one')
        assert answer.status_code == 502
        assert 'no picture within 5 s' in answer.json()['error']
        assert capture(gateway, 'one').json() == answer.json()
        assert ids(gateway) == []
        assert capture(gateway, 'two').status_code == 201


def test_a_capture_needs_a_key(gateway):
    for headers in ({}, {'Idempotency-Key': ''}, {'Idempotency-Key': 'a' * 129}):
        answer = requests.post(f'{gateway.url}/capture', headers=headers, timeout=30)
        assert answer.status_code == 400
        assert 'Idempotency-Key' in answer.json()['error']


@pytest.mark.parametrize(('method', 'path', 'code'), [
    ('POST', '/status', 405), ('DELETE', '/pictures', 405), ('GET', '/capture', 405),
    ('PUT', f'/pictures/{NOBODY}/raw', 405), ('GET', f'/pictures/{NOBODY}/raw', 404),
    ('GET', f'/pictures/{NOBODY}', 404), ('GET', f'/pictures/{NOBODY}/jpg', 404),
    ('GET', '/', 404), ('GET', '/status/', 404), ('BREW', '/status', 501)])
def test_what_there_is_not(gateway, method, path, code):
    answer = requests.request(method, gateway.url + path, timeout=30)
    assert answer.status_code == code
    assert answer.json()['error']
    assert ('Allow' in answer.headers) == (code == 405)


@pytest.mark.parametrize('path', [
    '/pictures/../../etc/passwd', '/../../../../etc/passwd', '//etc/passwd', '/etc/passwd',
    '/pictures/%2e%2e%2f%2e%2e%2fetc%2fpasswd/raw', '/pictures/..%2f..%2f..%2fetc/passwd/raw',
    '/pictures/../raw', '/pictures/%2fetc%2fpasswd/txt', '/pictures/..%5c..%5cetc/raw',
    '/pictures/0/raw', '/pictures//raw', '/pictures/%00/raw', 'file:///etc/passwd',
    'http://[/etc/passwd', '/pictures/sha1-%2e%2e/raw?/etc/passwd', '/%c0%ae%c0%ae/etc/passwd'])
def test_no_path_leads_to_the_disk(gateway, path):
    ids(gateway)
    answer = said(gateway, f'GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n'.encode())
    assert answer.startswith(b'HTTP/1.1 404 ')
    assert b'root:' not in answer


def test_nothing_of_the_request_is_repeated(gateway):
    for line in (b'GET /<script>x</script> HTTP/1.1', b'<script> /status HTTP/1.1',
                 b'GET /status <script>', b'GET /status HTTP/<script>',
                 b'GET /pictures/<script>/raw HTTP/1.1'):
        answer = said(gateway, line + b'\r\nHost: localhost\r\n\r\n')
        assert answer.startswith((b'HTTP/1.1 4', b'HTTP/1.1 5'))
        assert b'script' not in answer
        assert b'Content-Type: application/json' in answer


@pytest.mark.parametrize(('data', 'code'), [
    (b'GET /status HTTP/1.1\r\nHost: localhost\r\nContent-Length: 4097\r\n\r\n', 413),
    (b'GET /status HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n', 400),
    (b'GET /status HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1\r\nContent-Length: 2\r\n\r\n',
     400),
    (b'GET /status HTTP/1.1\r\nHost: localhost\r\nContent-Length: 0x1\r\n\r\n', 400),
    (b'POST /capture HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n',
     411),
    (b'GET /' + 66000 * b'a' + b' HTTP/1.1\r\n\r\n', 414),
    (b'GET / HTTP/1.1\r\n' + 101 * b'a: b\r\n' + b'\r\n', 431),
    (b'GET / HTTP/1.1\r\na: ' + 66000 * b'a' + b'\r\n\r\n', 431),
    (b'GET / HTTP/3.0\r\n\r\n', 505),
])
def test_limits(gateway, data, code):
    answer = said(gateway, data)
    # What is left unread may reset the connection before the answer is read.
    assert answer == b'' or answer.startswith(b'HTTP/1.1 %d ' % code)
    assert requests.get(f'{gateway.url}/status', timeout=30).status_code == 200


def test_several_requests_on_one_connection_stay_in_step(gateway):
    body = b'GET /nonsense HTTP/1.1\r\nHost: localhost\r\n\r\n'
    answer = said(gateway, b'GET /pictures HTTP/1.1\r\nHost: localhost\r\nContent-Length: %d'
                           b'\r\n\r\n%sGET /status HTTP/1.1\r\nHost: localhost\r\n\r\n'
                  % (len(body), body))
    assert answer.count(b'HTTP/1.1 200 OK') == 2
    assert b'HTTP/1.1 404' not in answer


def test_a_token_is_needed(folder):
    with gateway_of(folder, token=TOKEN) as gateway:
        for headers in ({}, {'Authorization': f'Bearer {TOKEN}x'}, {'Authorization': 'Bearer '},
                        {'Authorization': f'Basic {TOKEN}'}, {'Authorization': TOKEN}):
            for method, path in (('GET', 'status'), ('POST', 'capture'), ('GET', 'x')):
                answer = requests.request(method, f'{gateway.url}/{path}', timeout=30,
                                          headers={'Idempotency-Key': 'k', **headers})
                assert answer.status_code == 401
                assert answer.headers['WWW-Authenticate'] == 'Bearer'
                assert TOKEN not in answer.text
        right = {'Authorization': f'Bearer {TOKEN}'}
        found = requests.get(f'{gateway.url}/pictures', headers=right, timeout=30).json()
        assert len(found) == 3


def test_a_folder_of_pictures_that_was_cleaned_up_is_made_again(tmp_path):
    cache = Cache(tmp_path)
    for folder in tmp_path.iterdir():
        shutil.rmtree(folder)
    kept = cache.put('a', {'raw': b'x'})['raw']
    assert kept.path.read_bytes() == b'x'
    cache.close()
    with pytest.raises(CameraError, match='cannot keep b'):  # it came too late
        cache.put('b', {'raw': b'x'})
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize('host', ['0.0.0.0', '::', ''])
def test_other_machines_need_a_token(host):
    service = Service(lambda: pytest.fail('asked'), Cache())
    with pytest.raises(SettingsError, match=r'--token-file|say which of the addresses'):
        GatewayServer(service, host, 0)
    if host == '0.0.0.0':
        with GatewayServer(service, host, 0, TOKEN) as server:
            assert server.url.startswith('http://0.0.0.0:')
    service.close()


@pytest.mark.parametrize(('host', 'port'), [('203.0.113.1', 0), ('127.0.0.1', 70000),
                                            ('no such host', 0)])
def test_an_address_that_is_not_ours(host, port):
    with pytest.raises(SettingsError, match='cannot serve at'):
        GatewayServer(Service(lambda: None, Cache()), host, port, TOKEN)


def test_web_pages_are_refused(gateway):
    for headers in ({'Origin': 'http://evil'}, {'Origin': 'null'}, {'Host': 'evil:80'},
                    {'Host': '[evil'}, {'Host': '192.168.0.1'}):
        answer = requests.get(f'{gateway.url}/status', headers=headers, timeout=30)
        assert answer.status_code == 403
        assert 'evil' not in answer.text
    for host in ('localhost:1', '127.0.0.1', '[::1]:80', 'LOCALHOST'):
        answer = requests.get(f'{gateway.url}/status', headers={'Host': host}, timeout=30)
        assert answer.status_code == 200


REQUESTS = [
    'GET /pictures/{}/txt HTTP/1.1\r\nHost: localhost\r\nRange: bytes=0-9\r\nIf-Range: "a"\r\n'
    'If-None-Match: "b"\r\nAuthorization: Bearer x\r\n\r\n',
    'POST /capture HTTP/1.1\r\nHost: localhost\r\nContent-Length: 2\r\n\r\nab'
    'HEAD /pictures HTTP/1.0\r\n\r\n']
FRACTION = st.floats(0, 1, exclude_max=True)
PATCHES = st.binary(max_size=8) | st.sampled_from([
    b'\r\n', b'\r\n\r\n', b'\0', b':', b' ', b'%2e%2e/', b'/', b'9' * 30, b'\xff',
    b'Content-Length: 9\r\n', b'Expect: 100-continue\r\n'])
STEPS = st.lists(st.tuples(st.sampled_from(['flip', 'cut', 'copy', 'put']), FRACTION, FRACTION,
                           PATCHES), min_size=1, max_size=4)


def mutated(data, steps):
    for kind, one, two, patch in steps:
        start, end = sorted((int(one * len(data)), int(two * len(data))))
        if kind == 'flip' and data:
            data = data[:start] + bytes([data[start] ^ 1 << end % 8]) + data[start + 1:]
        elif kind == 'cut':
            data = data[:start] + data[end:]
        elif kind == 'copy':
            data = data[:end] + data[start:]
        elif kind == 'put':
            data = data[:start] + patch + data[start:]
    return data


def test_mutated_requests(gateway, caplog):
    identity = ids(gateway)[0]
    requests.get(picture_url(gateway), timeout=30)
    codes = set()

    @settings(deadline=None, max_examples=150, database=None)
    @given(st.sampled_from(REQUESTS), STEPS)
    def run(request, steps):
        answer = said(gateway, mutated(request.format(identity).encode(), steps))
        if answer:
            assert answer.startswith(b'HTTP/1.1 ')
            codes.add(int(answer[9:12]))

    tracemalloc.start()
    with caplog.at_level(logging.WARNING):
        run()
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()
    assert codes <= {100, 200, 206, 304, 400, 403, 404, 405, 411, 413, 414, 416, 417, 431, 501,
                     505}
    assert {400, 404} <= codes
    assert not [each for each in caplog.records if each.levelno >= logging.ERROR]
    assert len(ids(gateway)) == 3
    assert requests.get(f'{gateway.url}/status', timeout=30).json()['link'] == 'up'
