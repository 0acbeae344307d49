"""The requests of one connection to the gateway: admission, answers, byte ranges."""

import base64
import hmac
import io
import ipaddress
import json
import logging
import re
import time
from collections.abc import Callable
from datetime import datetime, timezone
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import TYPE_CHECKING, Any, BinaryIO, TypeVar
from urllib.parse import unquote, urlsplit

from pmcl_ros.camera.gateway.head import HeadError, read_head
from pmcl_ros.camera.gateway.interim import interim_answers
from pmcl_ros.camera.gateway.service import BusyError, CachedFile, CapturedPicture
from pmcl_ros.camera.gateway.settings import TIME_HEADER
from pmcl_ros.runtime.errors import CameraError, LinkError

if TYPE_CHECKING:
    from pmcl_ros.camera.gateway.server import GatewayServer

_RANGE = re.compile(r'bytes=(?:([0-9]{1,15})-([0-9]{1,15})?|-([0-9]{1,15}))')
_LONGEST_BODY = 4096  # bytes; no request needs any
_SILENCE = 30.0  # seconds without a byte, either way
_BLOCK = 1 << 18  # bytes of a file that are in memory at once
_KEY = re.compile(r'[\x21-\x7e]{1,128}')
# Nothing is read after these: who is not admitted waits no more, and where the next request of
# what was not understood begins is unknown.
_LAST = (HTTPStatus.BAD_REQUEST, HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN,
         HTTPStatus.LENGTH_REQUIRED, HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
_TYPES = {'raw': 'application/octet-stream', 'txt': 'text/plain; charset=utf-8'}

_LOG = logging.getLogger(__name__)
_Value = TypeVar('_Value')


class UnsatisfiableError(ValueError):
    """The requested range contains no byte of the file."""


def selected(header: str | None, size: int) -> range | None:
    """The bytes of a file of `size` bytes that a Range header requests; None: all.

    Unsupported headers, such as several ranges, are ignored (RFC 9110, section 14). Raises
    UnsatisfiableError when the range lies beyond the file.
    """
    found = _RANGE.fullmatch(header.replace(' ', '')) if header else None
    if found is None:
        return None
    first, last, suffix = (None if each is None else int(each) for each in found.groups())
    if first is None:
        wanted = range(max(0, size - (suffix or 0)), size)
    else:
        if last is not None and last < first:
            return None
        wanted = range(first, size if last is None else min(last + 1, size))
    if not wanted:
        raise UnsatisfiableError
    return wanted


class _RefusedError(Exception):
    """A refused request, with status and reason of the answer."""

    def __init__(self, status: HTTPStatus, reason: str, **headers: str) -> None:
        super().__init__(reason)
        self.status, self.headers = status, headers


class Handler(BaseHTTPRequestHandler):
    """One connection.

    interim_pause: seconds between interim answers while the camera works: a robot waits for 90 in
    silence, for 900 on the whole, and some versions of Python's http.client skip 99 of them.
    """

    server: 'GatewayServer'
    interim_pause = 20.0
    protocol_version, default_request_version = 'HTTP/1.1', 'HTTP/1.0'
    server_version, sys_version = 'pmcl_gateway', ''
    timeout = _SILENCE

    def handle_one_request(self) -> None:
        """Read a request and answer it."""
        self.server.connections.reads(self.connection)
        super().handle_one_request()

    def parse_request(self) -> bool:
        """Read the header lines within their limits, then parse them."""
        self.command, self.request_version, self.requestline = '', '', ''
        stream = self.rfile
        try:
            self.rfile = io.BytesIO(read_head(stream))
            return super().parse_request()
        except HeadError as error:
            self.close_connection = True
            self._send_problem(error.status, str(error))
            return False
        finally:
            self.rfile = stream

    def do_GET(self) -> None:
        """Handle all methods: the path decides which are allowed."""
        try:
            self._read_body()
            self._admit()
            self.server.connections.answers(self.connection)
            self._answer()
        except _RefusedError as error:
            self.close_connection |= error.status in _LAST
            self._send_problem(error.status, str(error), error.headers)
        except BusyError as error:
            self._send_problem(HTTPStatus.CONFLICT, str(error), {'Retry-After': '1'})
        except LinkError as error:
            self._send_problem(HTTPStatus.SERVICE_UNAVAILABLE, str(error), {'Retry-After': '2'})
        except CameraError as error:
            self._send_problem(HTTPStatus.BAD_GATEWAY, str(error))

    do_HEAD = do_POST = do_PUT = do_DELETE = do_PATCH = do_OPTIONS = do_GET  # noqa: N815

    def send_error(self, code: int, *_: Any, **__: Any) -> None:
        """Answer requests that the base class refuses, without an echo of the request."""
        self.close_connection = True
        status = HTTPStatus(code)
        self._send_problem(status, status.description or status.phrase)

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Log a line for each request."""
        _LOG.debug('%s: ' + format, self.client_address[0], *args)

    def _read_body(self) -> None:
        """Take an unused body off the connection: the next request follows it."""
        hosts = len(self.headers.get_all('Host', []))
        if hosts > 1 or (hosts == 0 and self.request_version > 'HTTP/1.0'):
            raise _RefusedError(HTTPStatus.BAD_REQUEST, 'a request names one Host')
        if 'Transfer-Encoding' in self.headers:
            raise _RefusedError(HTTPStatus.LENGTH_REQUIRED, 'a request has no chunks here')
        lengths = self.headers.get_all('Content-Length', ['0'])
        if len(lengths) != 1 or not re.fullmatch('[0-9]{1,15}', lengths[0].strip()):
            raise _RefusedError(HTTPStatus.BAD_REQUEST, 'impossible Content-Length')
        if int(lengths[0]) > _LONGEST_BODY:
            raise _RefusedError(HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                                f'a request has at most {_LONGEST_BODY} bytes here')
        self.rfile.read(int(lengths[0]))

    def _admit(self) -> None:
        """Refuse web pages, foreign host names and wrong tokens."""
        if 'Origin' in self.headers:  # a web page in a browser on this machine
            raise _RefusedError(HTTPStatus.FORBIDDEN, 'this is no service for web pages')
        if self.server.token is None:
            if self.server.local_only and not _is_loopback(self.headers.get('Host')):
                raise _RefusedError(HTTPStatus.FORBIDDEN, 'ask for this machine by its address, '
                                    '127.0.0.1 or localhost')
            return
        shown = self.headers.get('Authorization', '').encode('utf-8', 'replace')
        expected = f'Bearer {self.server.token}'.encode()
        if not hmac.compare_digest(shown, expected):
            raise _RefusedError(
                HTTPStatus.UNAUTHORIZED, 'missing or wrong token: send Authorization: Bearer with '
                "the token of the gateway's --token-file", **{
                    'WWW-Authenticate': 'Bearer'})

    def _answer(self) -> None:
        parts = [unquote(part) for part in self.path.split('?', 1)[0].split('/')[1:]]
        if parts == ['status']:
            self._allow('GET', 'HEAD')
            self._send_json(HTTPStatus.OK, self._worked(self._status))
        elif parts == ['pictures']:
            self._allow('GET', 'HEAD')
            pictures = self._worked(self.server.service.pictures)
            self._send_json(HTTPStatus.OK, [
                {'id': each.id, 'shutter_ns': each.shutter_ns} for each in pictures])
        elif parts == ['capture']:
            self._allow('POST')
            self._send_json(HTTPStatus.CREATED, self._capture())
        elif len(parts) == 3 and parts[0] == 'pictures' and parts[2] in _TYPES:
            self._allow('GET', 'HEAD')
            self._send_picture(parts[1], parts[2])
        else:
            raise _RefusedError(HTTPStatus.NOT_FOUND, 'there are GET /status, GET /pictures, '
                                'POST /capture, GET /pictures/ID/raw and GET /pictures/ID/txt')

    def _worked(self, work: Callable[[], _Value]) -> _Value:
        """The result of what may wait for the camera; the client hears meanwhile that it does."""
        if self.request_version < 'HTTP/1.1':  # it knows no interim answers
            return work()
        with interim_answers(self.wfile.write, self.interim_pause):
            return work()

    def _allow(self, *methods: str) -> None:
        if self.command not in methods:
            raise _RefusedError(HTTPStatus.METHOD_NOT_ALLOWED, f'only {" and ".join(methods)}',
                                Allow=', '.join(methods))

    def _status(self) -> dict[str, Any]:
        service = self.server.service
        try:
            status, pictures = service.status(), service.pictures()
        except LinkError as error:
            return {'link': 'down', 'problem': str(error)}
        return {'link': 'up', 'serial': status.serial, 'firmware': status.firmware,
                'battery': status.battery, 'pictures': len(pictures)}

    def _capture(self) -> dict[str, Any]:
        key = self.headers.get('Idempotency-Key', '')
        if not _KEY.fullmatch(key):
            raise _RefusedError(
                HTTPStatus.BAD_REQUEST, 'send an Idempotency-Key, any word that was not used '
                'before: the request can be repeated with it without taking a second picture')
        return _described(self._worked(lambda: self.server.service.capture(key)))

    def _send_picture(self, identity: str, kind: str) -> None:
        found = self._worked(lambda: self.server.service.open(identity, kind))
        if found is None:
            raise _RefusedError(HTTPStatus.NOT_FOUND, 'no such picture; GET /pictures lists them')
        file, stream = found
        with stream:
            self._send_file(file, stream, _TYPES[kind])

    def _send_file(self, file: CachedFile, stream: BinaryIO, kind: str) -> None:
        etag = f'"{file.sha256}"'
        digest = base64.b64encode(bytes.fromhex(file.sha256)).decode()
        headers = {'ETag': etag, 'Accept-Ranges': 'bytes', 'Content-Type': kind,
                   'Repr-Digest': f'sha-256=:{digest}:', 'Cache-Control': 'private'}
        if _names(self.headers.get('If-None-Match'), etag):
            self._send_head(HTTPStatus.NOT_MODIFIED, headers)
            return
        wanted = None
        # A Range is of GET alone (RFC 9110, 14.2).
        if self.command == 'GET' and self.headers.get('If-Range', etag).strip() == etag:
            try:
                wanted = selected(self.headers.get('Range'), file.size)
            except UnsatisfiableError:
                raise _RefusedError(HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE,
                                    f'the file has {file.size} bytes', **{
                                        'Content-Range': f'bytes */{file.size}'}) from None
        if wanted is None:
            status, wanted = HTTPStatus.OK, range(file.size)
        else:
            status = HTTPStatus.PARTIAL_CONTENT
            headers['Content-Range'] = f'bytes {wanted.start}-{wanted.stop - 1}/{file.size}'
        self._send_head(status, {**headers, 'Content-Length': str(len(wanted))})
        if self.command == 'HEAD':
            return
        stream.seek(wanted.start)
        left = len(wanted)
        while left:
            block = stream.read(min(left, _BLOCK))
            if not block:
                raise ConnectionError('a kept file was cut short')
            self.wfile.write(block)
            left -= len(block)

    def _send_problem(self, status: HTTPStatus, reason: str,
                      headers: dict[str, str] | None = None) -> None:
        self._send_json(status, {'error': reason}, headers)

    def _send_json(self, status: HTTPStatus, value: Any,
                   headers: dict[str, str] | None = None) -> None:
        body = json.dumps(value).encode('ascii')
        self._send_head(status, {'Content-Type': 'application/json', 'Cache-Control': 'no-store',
                                 'Content-Length': str(len(body)), **(headers or {})})
        if self.command != 'HEAD':
            self.wfile.write(body)

    def _send_head(self, status: HTTPStatus, headers: dict[str, str]) -> None:
        self.send_response(status)
        self.send_header('X-Content-Type-Options', 'nosniff')
        for name, value in headers.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header('Connection', 'close')
        # The last header: a client that has it has received all others.
        self.send_header(TIME_HEADER, f'{time.time_ns():019d}')
        self.end_headers()


def _described(capture: CapturedPicture) -> dict[str, Any]:
    picture = capture.picture
    shutter = datetime.fromtimestamp(picture.shutter_ns / 1e9, timezone.utc)
    found: dict[str, Any] = {'id': picture.id, 'shutter_ns': picture.shutter_ns,
                             'shutter': shutter.isoformat(timespec='milliseconds')}
    for kind, file in capture.files.items():
        found[kind] = {'size': file.size, 'sha256': file.sha256, 'etag': f'"{file.sha256}"'}
    if capture.problem:
        found['problem'] = capture.problem
    return found


def _names(header: str | None, etag: str) -> bool:
    """Whether an If-None-Match header contains this entity tag."""
    tags = [each.strip().removeprefix('W/') for each in (header or '').split(',')]
    return etag in tags or tags == ['*']


def _is_loopback(host: str | None) -> bool:
    """Whether a Host header names this machine; a web page's own name may resolve to it too."""
    try:
        name = urlsplit(f'//{host or "localhost"}').hostname or ''
        return name == 'localhost' or ipaddress.ip_address(name).is_loopback
    except ValueError:
        return False
