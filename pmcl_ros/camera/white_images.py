"""Choice of the white image for a picture among those of its camera (lytro_f01.md, B4)."""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pmcl_ros.camera.files import list_pictures, read_metadata, read_raw_frame
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.runtime.errors import CameraError

_LOG = logging.getLogger(__name__)

# Steps of the zoom motor. The camera's own white images lie up to some 120 steps from a picture
# (a real F01: 860 for 982); twice that changes the focal length, and with it which rays the lens
# lets through to a lenslet, by about half.
_FARTHEST = 240
# Of the sensor's range, at the centres of lenslets: darker is noise, brighter is saturated.
DARKEST_WHITE, BRIGHTEST_WHITE = 0.02, 0.99


@dataclass(frozen=True)
class WhiteChoice:
    """A white image, and the reason of its choice as a message for the user."""

    path: Path
    frame: RawFrame
    why: str


class _Candidate(NamedTuple):
    path: Path
    metadata: CameraMetadata


class WhiteImages:
    """The white images at `path`: one file, or all in a folder and its subfolders.

    In a folder (such as the camera's T1CALIB) a white image is a picture that is marked as
    modulationFrame or named MOD_*. Metadata are read at once, pixels when an image is chosen.
    Raises CameraError when there is no white image.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._unusable: dict[Path, str] = {}  # why
        self._last: tuple[Path, RawFrame] | None = None
        files = list_pictures(self.path)
        if self.path.is_file():
            self._candidates = [_Candidate(self.path, read_metadata(self.path))]
            return
        self._candidates = [each for each in map(self._candidate, files) if each is not None]
        if not self._candidates:
            reasons = [f'{path.name}: {why}' for path, why in self._unusable.items()]
            raise CameraError('; '.join([
                f'no white image in {self.path}: none of its {len(files)} pictures is called '
                'MOD_* or marked modulationFrame in its .TXT; give the file itself', *reasons]))

    @property
    def serials(self) -> list[str]:
        """Serial numbers of their cameras, sorted; unknown ones are left out."""
        return sorted({each.metadata.serial for each in self._candidates} - {''})

    @property
    def first(self) -> CameraMetadata:
        """The metadata of the first by name."""
        return self._candidates[0].metadata

    def choose(self, picture: CameraMetadata) -> WhiteChoice:
        """The white image for a picture: nearest zoom, then nearest focus, then longest exposure.

        Images that are too dark or saturated are skipped. Raises CameraError when no image has the
        picture's camera and about its zoom, and where the metadata leave this open.
        """
        found = self._near(self._of_camera(picture), picture)
        found.sort(key=lambda each: (_distance(each.metadata.zoom, picture.zoom),
                                     _distance(each.metadata.focus, picture.focus),
                                     -(each.metadata.exposure or 0)))
        for each in found:
            frame = self._read(each.path)
            if frame is not None:
                why = _why(each, picture, len(self._candidates))
                passed = self._skipped(before.path for before in found[:found.index(each)])
                return WhiteChoice(each.path, frame, '; '.join([why, *passed]))
        reasons = '; '.join(self._skipped(each.path for each in found))
        raise CameraError(f'no usable white image at {self.path}: {reasons}')

    def _candidate(self, path: Path) -> _Candidate | None:
        try:
            metadata = read_metadata(path)
        except CameraError as error:
            if _called_white(path):
                self._unusable[path] = str(error)
            return None
        white = metadata.tags.modulationFrame
        marked = _called_white(path) if white is None else white
        return _Candidate(path, metadata) if marked and not metadata.tags.darkFrame else None

    def _of_camera(self, picture: CameraMetadata) -> list[_Candidate]:
        if not picture.serial:
            if len(self.serials) > 1:
                raise CameraError(
                    f"the picture's metadata have no serial number, and {self.path} has white "
                    f'images of {", ".join(self.serials)}; give the folder of the right camera')
            return self._candidates
        same = [each for each in self._candidates if each.metadata.serial == picture.serial]
        same = same or [each for each in self._candidates if not each.metadata.serial]
        if not same:
            raise CameraError(
                f'the picture is from camera {picture.serial}, the white images at {self.path} '
                f'are of {", ".join(self.serials)}; use those of the same camera')
        return same

    def _near(self, found: list[_Candidate], picture: CameraMetadata) -> list[_Candidate]:
        """Candidates of about the picture's zoom."""
        known = [each for each in found if each.metadata.zoom is not None]
        zooms = sorted({each.metadata.zoom for each in known if each.metadata.zoom is not None})
        if picture.zoom is None:
            if len(zooms) > 1:
                raise CameraError(
                    f"the picture's metadata have no zoom step, and {self.path} has white images "
                    f'of zoom steps {_listed(zooms)}; give the file of the right one')
            return found
        near = [each for each in known if _distance(each.metadata.zoom, picture.zoom) <= _FARTHEST]
        if known and not near:
            nearest = min(zooms, key=lambda zoom: _distance(zoom, picture.zoom))
            raise CameraError(
                f'the picture was taken at zoom step {picture.zoom:g}, the nearest white image at '
                f'{self.path} at zoom step {nearest:g}: more than {_FARTHEST} steps apart the '
                'lens is another; use a white image, and a calibration, of the same zoom')
        return near or found

    def _read(self, path: Path) -> RawFrame | None:
        """Read an image; None when it cannot be used."""
        if path in self._unusable:
            return None
        if self._last is None or self._last[0] != path:
            try:
                frame = read_raw_frame(path)
                _check_exposure(frame)
            except CameraError as error:
                self._unusable[path] = str(error)
                return None
            self._last = path, frame
        return self._last[1]

    def _skipped(self, paths: Iterable[Path]) -> list[str]:
        return [f'skipped {path.name}: {self._unusable[path]}' for path in paths]


def choose_white(path: Path | str, picture: CameraMetadata) -> WhiteChoice:
    """The white image for one picture from a file or a folder; see `WhiteImages.choose`.

    The choice is logged.
    """
    choice = WhiteImages(path).choose(picture)
    _LOG.info('white image: %s', choice.why)
    return choice


def _called_white(path: Path) -> bool:
    return path.name.upper().startswith('MOD_')


def _check_exposure(frame: RawFrame) -> None:
    """Raise CameraError where a phase of the mosaic is too dark or saturated at its brightest."""
    black, white = frame.metadata.black, frame.metadata.white
    for row, column in np.ndindex(2, 2):
        counts = np.percentile(frame.counts[row::8, column::8], 99)
        part = (float(counts) - black) / (white - black)
        if not DARKEST_WHITE < part < BRIGHTEST_WHITE:
            state = 'too dark' if part <= DARKEST_WHITE else 'saturated'
            raise CameraError(f"{state}, at {100 * part:.0f} % of the sensor's range where it is "
                              'brightest')


def _distance(one: float | None, other: float | None) -> float:
    """Distance of two motor steps; 0 where either is unknown."""
    return 0 if one is None or other is None else abs(one - other)


def _why(chosen: _Candidate, picture: CameraMetadata, count: int) -> str:
    white = chosen.metadata
    among = f'nearest of {count}' if count > 1 else 'the only one'
    exposure = 'unknown exposure' if white.exposure is None else f'{white.exposure:g} s'
    return (f'{chosen.path.name} of camera {white.serial or "unknown"}, {among}: zoom step '
            f'{_step(white.zoom)} (picture: {_step(picture.zoom)}), focus step '
            f'{_step(white.focus)} (picture: {_step(picture.focus)}), {exposure}')


def _step(step: float | None) -> str:
    return 'unknown' if step is None else f'{step:g}'


def _listed(numbers: Sequence[float]) -> str:
    return ', '.join(f'{each:g}' for each in numbers)
