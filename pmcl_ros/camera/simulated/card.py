"""The memory of the simulated camera: it serves pictures from disk, and makes their previews."""

import hashlib
import json
import logging
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timezone
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.files import list_pictures, read_metadata, read_picture
from pmcl_ros.camera.lytro.protocol import PictureRecord, encode_files
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import unpack12

FILES_PER_FOLDER = 9999  # the number in a name has four digits

_BLACK, _WHITE = 168, 4095  # counts
_CALIBRATION = 'C:\\T1CALIB\\'
_DIGITS = {'0': 'JPG', '1': 'RAW', '2': 'TXT', '3': '128'}  # of C2 00 05

_LOG = logging.getLogger(__name__)


def jpeg(raw: bytes, width: int, height: int, side: int = 328) -> bytes:
    """A JPEG of `side` x `side` pixels; raw: packed counts, BGGR."""
    _, data = cv2.imencode('.jpg', _bgr(raw, width, height, side))
    return data.tobytes()


def thumbnail(raw: bytes, width: int, height: int, side: int = 128) -> bytes:
    """`side` x `side` pixels, two in four bytes: Y0 U Y1 V (YUY2)."""
    luma, red, blue = np.moveaxis(
        cv2.cvtColor(_bgr(raw, width, height, side), cv2.COLOR_BGR2YCrCb), 2, 0)
    packed = np.empty((side, side // 2, 4), np.uint8)
    packed[..., 0], packed[..., 2] = luma[:, ::2], luma[:, 1::2]
    packed[..., 1], packed[..., 3] = blue[:, ::2], red[:, ::2]
    return packed.tobytes()


def _bgr(raw: bytes, width: int, height: int, side: int) -> NDArray[np.uint8]:
    """(side, side, 3) uint8; a pixel of each 2x2 tile, averaged, with a gamma of 1/2.2."""
    counts = unpack12(raw, width, height)
    blue, green, red = counts[0::2, 0::2], counts[0::2, 1::2], counts[1::2, 1::2]
    linear = np.stack([cv2.resize(each.astype(np.float32), (side, side),
                                  interpolation=cv2.INTER_AREA) for each in (blue, green, red)],
                      axis=2)
    light = np.clip((linear - _BLACK) / (_WHITE - _BLACK), 0, 1)
    return np.round(255 * light ** (1 / 2.2)).astype(np.uint8)


@dataclass(frozen=True)
class StoredPicture:
    """A picture on disk that the simulated camera serves as its own."""

    path: Path
    metadata: CameraMetadata

    def file(self, extension: str) -> bytes:
        """The file with this upper-case extension; KeyError where a camera has none."""
        if extension == 'TXT':
            return self.metadata.text.encode()
        raw, image = _raw_bytes(self.path), self.metadata.image
        if extension == 'RAW':
            return raw
        return {'JPG': jpeg, '128': thumbnail}[extension](raw, image.width, image.height)


@lru_cache(maxsize=4)
def _raw_bytes(path: Path) -> bytes:
    return read_picture(path)[0]


class Card:
    """The camera's memory.

    pictures: captures in turn. whites: served as calibration files. empty: start with an empty
    card, else all pictures are stored in the order of their names.
    """

    def __init__(self, pictures: list[StoredPicture], whites: list[StoredPicture], *,
                 empty: bool = False) -> None:
        self._captures = pictures
        self._whites = whites
        self._next = 0
        self._number = 0
        self._stored: dict[str, tuple[PictureRecord, StoredPicture]] = {}  # by id, oldest first
        newest = 0.0
        for capture in () if empty else pictures:
            newest = max(newest, capture.path.stat().st_mtime)
            self.store(*self.expose(datetime.fromtimestamp(newest, timezone.utc)))

    @classmethod
    def from_folder(cls, folder: Path | str, *, empty: bool = False) -> 'Card':
        """The pictures at `folder` and in its subfolders; CameraError when there is none.

        Pictures marked as white (modulationFrame) are calibration files, unless there are no
        others.
        """
        captures = [StoredPicture(path, read_metadata(path)) for path in list_pictures(folder)]
        whites = [each for each in captures if each.metadata.tags.modulationFrame]
        pictures = [each for each in captures if not each.metadata.tags.modulationFrame]
        _LOG.info('%d pictures and %d white images in %s', len(pictures), len(whites), folder)
        return cls(pictures or whites, whites, empty=empty)

    @property
    def serial(self) -> str:
        """Serial number of the camera that took the pictures."""
        return self._captures[0].metadata.serial or 'A000000000'

    @property
    def records(self) -> list[PictureRecord]:
        """The picture list, newest first."""
        return [record for record, _ in reversed(self._stored.values())]

    def expose(self, moment: datetime) -> tuple[PictureRecord, StoredPicture]:
        """Take the next picture in turn, without storing it."""
        capture = self._captures[self._next]
        self._next = (self._next + 1) % len(self._captures)
        self._number += 1
        folder, number = divmod(self._number - 1, FILES_PER_FOLDER)
        date = moment.isoformat(timespec='milliseconds').replace('+00:00', 'Z')
        digest = hashlib.sha1(f'{self.serial} {self._number} {capture.path.name} {date}'.encode())
        return PictureRecord(100 + folder, number + 1, f'sha1-{digest.hexdigest()}', date), capture

    def store(self, record: PictureRecord, capture: StoredPicture) -> None:
        """Store a picture: it can be downloaded from now on."""
        self._stored[record.id] = (record, capture)

    def delete(self, key: bytes) -> PictureRecord | None:
        """Delete by the first 24 bytes of a record; the deleted record, if any."""
        for record, _ in self._stored.values():
            if record.key == key:
                return self._stored.pop(record.id)[0]
        return None

    def file(self, path: str) -> Callable[[], bytes] | None:
        r"""Reader of a file by its path on the camera, with any slashes and letter case."""
        path = path.replace('/', '\\').upper()
        extension = path.rpartition('.')[2]
        for record, capture in self._stored.values():
            if extension in _DIGITS.values() and record.path(extension).upper() == path:
                return _reader(capture, extension)
        return self._calibration().get(path)

    def picture(self, identity: str, digit: str) -> Callable[[], bytes] | None:
        """Reader of a picture's file by its id and the digit of C2 00 05."""
        if identity not in self._stored or digit not in _DIGITS:
            return None
        return _reader(self._stored[identity][1], _DIGITS[digit])

    def calibration(self) -> bytes:
        """The data of C2 00 06."""
        return encode_files({path: read() for path, read in self._calibration().items()})

    def _calibration(self) -> dict[str, Callable[[], bytes]]:
        files: dict[str, Callable[[], bytes]] = {
            f'{_CALIBRATION}MLACALIBRATION.TXT': self._lenslets}
        for number, white in enumerate(self._whites):
            for extension in ('TXT', 'RAW'):
                files[f'{_CALIBRATION}MOD_{number:04d}.{extension}'] = _reader(white, extension)
        return files

    def _lenslets(self) -> bytes:
        """The lenslets' part of the metadata, as JSON."""
        found: Any = json.loads(self._captures[0].metadata.text)
        for step in ('master', 'picture', 'frameArray', 0, 'frame', 'metadata', 'devices', 'mla'):
            try:
                found = found[step]
            except (KeyError, IndexError, TypeError):
                return b'{}'
        return json.dumps({'mla': found}, indent=1).encode()


def _reader(capture: StoredPicture, extension: str) -> Callable[[], bytes]:
    return lambda: capture.file(extension)
