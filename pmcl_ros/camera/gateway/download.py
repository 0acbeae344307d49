"""A file download that resumes after lost connections, checked by its SHA-256."""

import base64
import binascii
import hashlib
import re

import requests

from pmcl_ros.runtime.errors import CameraError, LinkError
from pmcl_ros.runtime.progress import BytesProgress

_BLOCK = 1 << 14  # bytes; a lost connection loses less than one block
_CONTENT_RANGE = re.compile(r'bytes ([0-9]{1,15})-[0-9]{1,15}/([0-9]{1,15})')
_DIGEST = re.compile(r'sha-256=:([A-Za-z0-9+/]{43}=):')


class LostError(LinkError):
    """No connection to the gateway, or it was lost; the request can be repeated."""


class Download:
    """A file of at most `largest` bytes, and its part that was received so far."""

    def __init__(self, name: str, largest: int, progress: BytesProgress | None = None) -> None:
        self._name, self._largest, self._progress = name, largest, progress
        self._got = bytearray()
        self._etag, self._total, self._digest = '', 0, b''
        self.most = 0  # most bytes that were received in any attempt

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the next request: the missing range, if the file is unchanged."""
        if not self._got:
            return {}
        return {'Range': f'bytes={len(self._got)}-', 'If-Range': self._etag}

    def take(self, response: requests.Response) -> bytes:
        """Read an answer and return the whole file.

        Raises LostError when the connection breaks, CameraError for an impossible answer.
        """
        if response.status_code == 206:
            self._continue(response)
        else:
            self._begin(response)
        for block in response.iter_content(_BLOCK):
            self._got += block
            if len(self._got) > self._total:
                raise CameraError(f'{self._name}: more than the {self._total} bytes announced')
            self.most = max(self.most, len(self._got))
            if self._progress is not None:
                self._progress(len(self._got), self._total)
        if len(self._got) < self._total:
            raise LostError(f'{self._name} ends after {len(self._got)} of {self._total} bytes')
        found = bytes(self._got)
        if hashlib.sha256(found).digest() != self._digest:
            self._got.clear()
            raise LostError(f"{self._name}: its SHA-256 differs from the gateway's")
        return found

    def _begin(self, response: requests.Response) -> None:
        self._got.clear()
        self._etag = response.headers.get('ETag', '')
        length = response.headers.get('Content-Length', '')
        digest = _DIGEST.fullmatch(response.headers.get('Repr-Digest', ''))
        if not re.fullmatch('[0-9]{1,15}', length) or digest is None or not self._etag:
            raise CameraError(f'{self._name}: the answer has no length, ETag or Repr-Digest')
        self._total = int(length)
        if self._total > self._largest:
            raise CameraError(f'{self._name} has {self._total} bytes, at most {self._largest} '
                              'are allowed')
        try:
            self._digest = base64.b64decode(digest[1], validate=True)
        except binascii.Error:
            raise CameraError(f'{self._name}: the answer has an impossible Repr-Digest') from None

    def _continue(self, response: requests.Response) -> None:
        found = _CONTENT_RANGE.fullmatch(response.headers.get('Content-Range', ''))
        expected = (len(self._got), self._total)
        if found is None or (int(found[1]), int(found[2])) != expected or not self._got:
            raise CameraError(f'{self._name}: asked for the bytes from {expected[0]} of '
                              f'{expected[1]}, the answer has others')
