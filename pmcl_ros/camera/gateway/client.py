"""A camera behind a gateway: an HTTP client that survives lost connections."""

import re
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar
from urllib.parse import quote, urlsplit

import requests
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from pmcl_ros.camera.client import CameraStatus, Picture, retry
from pmcl_ros.camera.gateway.download import Download, LostError
from pmcl_ros.camera.gateway.exchange import Exchange, ExchangeAdapter, Exchanges
from pmcl_ros.camera.gateway.settings import TIME_HEADER, GatewaySettings, check_token
from pmcl_ros.camera.lfp import LARGEST_RAW, LARGEST_TEXT
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import CameraError, LinkError, SettingsError
from pmcl_ros.runtime.progress import BytesProgress
from pmcl_ros.runtime.settings import explain

_DRIFT = 100e-6  # two quartzes, at worst
_LARGEST_ANSWER = 1 << 20  # bytes of JSON
_SLOWEST = 50_000  # bytes/s of an answer on the whole, as of a camera without a gateway
_LENGTH = re.compile('[0-9]{1,15}')
_TIME = re.compile('[0-9]{19}')
_Value = TypeVar('_Value')


@dataclass(frozen=True)
class ClockDifference:
    """Bounds of the gateway's clock minus this machine's, measured at `found_ns`.

    An interval that contains 0 counts as 0: clocks under NTP differ by less than a round trip.
    """

    low_ns: float = float('-inf')
    high_ns: float = float('inf')
    found_ns: int = 0

    @property
    def ahead_ns(self) -> int:
        """Estimate of the difference [ns]."""
        if self.low_ns <= 0 <= self.high_ns:
            return 0
        # Whole numbers, as a clock that is months off has more digits than a double.
        return int(self.low_ns) + round((self.high_ns - self.low_ns) / 2)

    def updated(self, asked_ns: int, remote_ns: int, now_ns: int) -> 'ClockDifference':
        """Add a measurement: the other clock was `remote_ns` between our `asked_ns` and `now_ns`.

        The narrower interval is kept; the older one widens with time by the clocks' drift.
        """
        new = ClockDifference(remote_ns - now_ns, remote_ns - asked_ns, now_ns)
        loss = _DRIFT * abs(now_ns - self.found_ns)
        set_anew = new.low_ns > self.high_ns + loss or new.high_ns < self.low_ns - loss
        if set_anew or now_ns - asked_ns <= self.high_ns - self.low_ns + 2 * loss:
            return new
        return self


class _Answer(BaseModel):
    model_config = ConfigDict(frozen=True, extra='ignore', allow_inf_nan=False)


class _Status(_Answer):
    link: str
    problem: str = ''
    serial: str = ''
    firmware: str = ''
    battery: float | None = None


class _Picture(_Answer):
    id: str = Field(min_length=1, max_length=64)
    shutter_ns: int


class _Problem(_Answer):
    error: str


_PICTURES = TypeAdapter(list[_Picture])


class GatewayClient(Closing):
    """A `CameraClient` behind a gateway (`pmcl camera gateway`); usable from several threads.

    url: as in http://192.168.1.7:5680. token: the content of the gateway's --token-file.
    Methods retry after lost connections for `settings.patience`, then raise LinkError; other
    errors, such as an answer that takes too long on the whole, are CameraError. Nothing is sent
    before the first call. Stamps are in this machine's clock.
    """

    def __init__(self, url: str, token: str | None = None,
                 settings: GatewaySettings | None = None) -> None:
        self._url, self._settings = _checked(url), settings or GatewaySettings()
        self._clock = ClockDifference()
        self._closed = threading.Event()
        self._exchanges = Exchanges()
        self._session = requests.Session()
        for scheme in ('http://', 'https://'):
            self._session.mount(scheme, ExchangeAdapter())
        self._session.trust_env = False  # no proxy lies between a robot and its gateway
        self._session.headers['Accept-Encoding'] = 'identity'
        if token is not None:
            self._session.headers['Authorization'] = f'Bearer {check_token(token)}'

    # CameraClient

    def status(self) -> CameraStatus:
        """Identity and state of the camera; LinkError when the gateway does not reach it."""
        found = self._get('/status', _Status.model_validate_json)
        if found.link != 'up':
            raise LinkError(f'gateway: {found.problem[:1000]}')
        return CameraStatus(found.serial, found.firmware, found.battery)

    def pictures(self) -> list[Picture]:
        """All pictures on the card, oldest first."""
        return [self._picture(each) for each in self._get('/pictures', _PICTURES.validate_json)]

    def capture(self) -> Picture:
        """Take a picture; returns when it can be fetched.

        Repeated requests have one Idempotency-Key: the gateway takes one picture.
        """
        self.pictures()  # compares the clocks, and fails before the shutter if nobody answers
        key = {'Idempotency-Key': uuid.uuid4().hex}

        def attempt() -> Picture:
            with self._ask('POST', '/capture', key) as response:
                return self._picture(_value(response, _Picture.model_validate_json))
        return self._retry(attempt)

    def fetch(self, picture: Picture, progress: BytesProgress | None = None) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON), checked by their SHA-256.

        progress: of the .RAW.
        """
        path = f'/pictures/{quote(picture.id, safe="")}'
        body = self._download(f'{path}/txt', Download(f'{picture.id}, text,', LARGEST_TEXT))
        try:
            text = body.decode('utf-8')
        except UnicodeDecodeError:
            raise CameraError(f'the text of {picture.id} is not text') from None
        image = CameraMetadata.parse(text).image
        expected = image.width * image.height * 3 // 2

        def report(got: int, total: int) -> None:
            self._check_open()
            if progress is not None:
                progress(got, total)

        raw = self._download(f'{path}/raw', Download(picture.id, LARGEST_RAW, report))
        if len(raw) != expected:
            raise CameraError(f'{picture.id} has {len(raw)} bytes, its metadata says {expected}')
        return raw, text

    def delete(self, picture: Picture) -> None:
        """CameraError: a gateway deletes no pictures."""
        raise CameraError(f'picture {picture.id} stays on the camera: a gateway deletes none')

    def close(self) -> None:
        """End every connection; calls that wait in other threads raise LinkError.

        At once where they wait for an answer, within `settings.timeout` where they connect.
        """
        self._closed.set()
        self._exchanges.end_all()
        self._session.close()

    def _get(self, path: str, read: Callable[[bytes], _Value]) -> _Value:
        def attempt() -> _Value:
            with self._ask('GET', path) as response:
                return _value(response, read)
        return self._retry(attempt)

    def _download(self, path: str, download: Download) -> bytes:
        def attempt() -> bytes:
            with self._ask('GET', path, download.headers) as response:
                return download.take(response)
        return self._retry(attempt, lambda: download.most)

    def _picture(self, found: _Picture) -> Picture:
        return Picture(found.id, found.shutter_ns - self._clock.ahead_ns)

    @contextmanager
    def _ask(self, method: str, path: str, headers: dict[str, str] | None = None
             ) -> Iterator[requests.Response]:
        """The answer with its body unread; LostError when the connection fails."""
        timeouts = self._settings.timeout, self._settings.answer_timeout
        with self._exchanges.begin(self._settings.answer_limit) as exchange:
            self._check_open()
            asked = time.time_ns()
            try:
                with self._session.request(
                        method, self._url + path, headers=headers, stream=True,
                        allow_redirects=False, timeout=timeouts) as response:
                    # Silence ends it first, as a lost connection, after which it is retried.
                    exchange.answers(self._settings.timeout, 2 * self._settings.timeout
                                     + _length(response) / _SLOWEST)
                    self._check_answer(response, asked)
                    yield response
            except (requests.RequestException, LostError) as error:
                self._check_open()
                if exchange.ended:
                    raise self._late(exchange, f'{method} {path}') from None
                if isinstance(error, LostError):
                    raise
                raise LostError(f'gateway {self._url}: {str(error)[:500]}') from None

    def _check_answer(self, response: requests.Response, asked: int) -> None:
        stamp = response.headers.get(TIME_HEADER, '')
        if not _TIME.fullmatch(stamp):  # its last line
            raise LostError(f'{self._url} answers as no gateway of pmcl_ros does, or its answer '
                            'was cut short')
        self._clock = self._clock.updated(asked, int(stamp), time.time_ns())
        if response.status_code not in (200, 201, 206):
            raise _refusal(response)

    def _late(self, exchange: Exchange, what: str) -> CameraError:
        return CameraError(f'gateway {self._url}: {what}: no complete answer within '
                           f'{round(exchange.limit, 1):g} s; look for a slow link, to it or to '
                           'its camera')

    def _check_open(self) -> None:
        if self._closed.is_set():
            raise LinkError(f'the connection to gateway {self._url} is closed')

    def _retry(self, attempt: Callable[[], _Value],
               received: Callable[[], int] = lambda: 0) -> _Value:
        return retry(attempt, LostError, self._settings.patience, self._closed, received)


def _checked(url: str) -> str:
    try:
        parts = urlsplit(url)
        right = parts.scheme in ('http', 'https') and parts.hostname and parts.port != 0
    except ValueError:
        right = False
    if not right or parts.path.strip('/') or parts.query or parts.fragment or parts.username:
        raise SettingsError(f'{url!r} is no address of a gateway: expected http://HOST:PORT')
    return url.rstrip('/')


def _length(response: requests.Response) -> int:
    """Length of the body, as far as an answer may be long; 0: not said."""
    length = response.headers.get('Content-Length', '')
    return min(int(length), LARGEST_RAW) if _LENGTH.fullmatch(length) else 0


def _value(response: requests.Response, read: Callable[[bytes], _Value]) -> _Value:
    """The value in a JSON answer; CameraError when it is invalid or too long."""
    body = b''
    for block in response.iter_content(_LARGEST_ANSWER):
        body += block
        if len(body) > _LARGEST_ANSWER:
            raise CameraError(f'the gateway answers more than {_LARGEST_ANSWER} bytes')
    if response.headers.get('Content-Length') != str(len(body)):
        raise LostError('an answer of the gateway was cut short')
    try:
        return read(body)
    except ValidationError as error:
        first = explain(error)[:500]
        raise CameraError(f'the gateway answers something else than expected: {first}') from None


def _refusal(response: requests.Response) -> CameraError:
    """The error for an answer with an error status."""
    code = response.status_code
    try:
        reason = _value(response, _Problem.model_validate_json).error[:1000]
    except LostError as error:
        return error
    except CameraError:
        reason = 'no reason given'
    if code in (409, 416):  # another client's capture; the file has changed
        return LostError(f'gateway: {reason}')
    if code == 503:
        return LinkError(f'gateway: {reason}')
    return CameraError(f'gateway: {reason} (HTTP {code})')
