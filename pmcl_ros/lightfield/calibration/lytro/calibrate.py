"""Raw frames of a board -> Calibration of a light-field camera, with its uncertainty."""

import logging
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import list_pictures, read_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.board_search import find_board, oriented
from pmcl_ros.lightfield.calibration.lytro.bundle import Fit, select_model
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH, Calibration
from pmcl_ros.lightfield.calibration.lytro.camera_model import PARAMETERS, Model
from pmcl_ros.lightfield.calibration.lytro.corners import CornerMeter, Corners
from pmcl_ros.lightfield.calibration.lytro.initial_guess import initial_guess
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice
from pmcl_ros.lightfield.calibration.lytro.observations import Observations
from pmcl_ros.lightfield.calibration.lytro.uncertainty import Uncertainty, uncertainty
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.white_image import is_white_image
from pmcl_ros.runtime.errors import CalibrationError, CameraError, LightFieldError

_LOG = logging.getLogger(__name__)

_FEWEST = 3  # boards
_LEAST_USED = 0.5  # least share of a board's corners that agree with the camera
_SURE = 0.05  # largest useful relative standard deviation of focal length, baseline, focus
_ADVICE = ('photograph the board at several distances (half to twice the focus distance), tilted '
           'by 20 to 40 degrees to different sides, filling different parts of the picture')


class LeftOut(NamedTuple):
    """A picture that was not used, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class BoardView:
    """One picture's board.

    picture: (height, width, 3) uint8, the centre view for display. setting: zoom and focus step.
    """

    name: str
    corners: Corners
    picture: NDArray[np.uint8]
    setting: tuple[float | None, float | None]


@dataclass(frozen=True)
class CalibrationResult:
    """A calibration, with its data and its uncertainty.

    fit: boards in the order of `boards`. gains: of the models tried, see `bundle.select_model`.
    """

    calibration: Calibration
    boards: tuple[BoardView, ...]
    left_out: tuple[LeftOut, ...]
    fit: Fit
    gains: dict[Model, float]
    uncertainty: Uncertainty

    @property
    def poses(self) -> NDArray[np.float64]:
        """(n, 4, 4) board to camera: x along the columns, y along the rows, z into the board. It
        begins where the first inner corner is while the board is flat."""
        return pose_of(Rotation.from_rotvec(self.fit.poses[:, :3]), self.fit.poses[:, 3:])

    @property
    def board(self) -> NDArray[np.float64]:
        """(m, 3) the board's corners as they lie [m]: paper is bent. z = 0 is the plane through
        them."""
        return self.fit.observations.sheet.points(self.fit.bend)

    @property
    def residuals(self) -> NDArray[np.float64]:
        """(n, m, 4) measured minus predicted position [px] and disparity [px per step]; NaN: the
        corner was not measured."""
        observations = self.fit.observations
        left = np.full(observations.values.shape, np.nan)
        valid = observations.valid
        left[valid] = np.linalg.solve(observations.whitening[valid],
                                      self.fit.residuals[valid][..., None])[..., 0]
        return left


class Calibrator:
    """Finds boards in raw frames of one camera at one zoom and focus, and calibrates it.

    lattice, white: of the camera. Raises LightFieldError when they do not fit each other.
    """

    def __init__(self, white: RawFrame, board: Checkerboard,
                 lattice: Lattice | None = None) -> None:
        self._lattice = lattice or fit_lattice(white).lattice
        self._board = board
        self._serial = white.metadata.serial
        height, width = white.counts.shape
        aligned = Calibration.aligned(self._lattice, width // RAW_PITCH, height // RAW_PITCH)
        self._decoder = Decoder(aligned, white)
        self._meter = CornerMeter(self._lattice, self._decoder.light)

    def look(self, name: str, frame: RawFrame) -> BoardView:
        """The board in a frame.

        Raises LightFieldError when there is none, not all of it, or another camera's.
        """
        serial = frame.metadata.serial
        if serial and self._serial and serial != self._serial:
            raise LightFieldError(f'of camera {serial}, the white image is of {self._serial}')
        if is_white_image(frame):
            raise LightFieldError('a white image')
        light_field = self._decoder.decode(frame)
        corners = self._meter.measure(frame, *find_board(self._board, light_field))
        return BoardView(name, oriented(self._board, corners), light_field.picture(),
                         (frame.metadata.zoom, frame.metadata.focus))

    def calibrate(self, boards: Sequence[BoardView],
                  left_out: Iterable[LeftOut] = ()) -> CalibrationResult:
        """Fit the camera to the boards; boards of another zoom or focus are left out.

        Raises CalibrationError when they are too few or do not determine the geometry.
        """
        boards, others = _of_one_setting(boards)
        left_out = (*left_out, *others)
        pinhole = self._decoder.grid.pinhole
        while True:
            if len(boards) < _FEWEST:
                reasons = ''.join(f'\n  {each.name}: {each.reason}' for each in left_out)
                raise CalibrationError(
                    f'{len(boards)} pictures with a complete board of {self._board.columns}x'
                    f'{self._board.rows} inner corners, at least {_FEWEST} are needed (8 are '
                    f'good): {_ADVICE}{reasons}')
            observations = Observations.from_corners([each.corners for each in boards],
                                                     self._board.square)
            try:
                guess = initial_guess(observations, pinhole.width, pinhole.height)
                fit, gains = select_model(observations, *guess)
            except LightFieldError as error:
                raise CalibrationError(f'{error}; {_ADVICE}') from None
            odd = fit.observations.valid.mean(axis=1) < _LEAST_USED
            if not odd.any():
                break
            left_out = (*left_out, *(
                LeftOut(each.name, 'most of its corners contradict the other boards')
                for each, out in zip(boards, odd, strict=True) if out))
            boards = [each for each, out in zip(boards, odd, strict=True) if not out]
        sure = _sure(fit)
        values = dict(zip(PARAMETERS, fit.camera.tolist(), strict=True))
        values['focus_distance'] = 1 / values.pop('focus')
        calibration = Calibration.make(
            {'width': pinhole.width, 'height': pinhole.height, **values,
             'lattice': self._lattice.model_dump(), 'serial': self._serial,
             **dict(zip(('zoom', 'focus'), boards[0].setting, strict=True))}, 'the estimate')
        _LOG.info('calibrated from %d boards: %s', len(boards), calibration)
        return CalibrationResult(calibration, tuple(boards), left_out, fit, gains, sure)


def calibrate_folder(white: RawFrame, folder: Path | str, board: Checkerboard,
                     looked: Callable[[Path, int, str], None] | None = None,
                     ) -> CalibrationResult:
    """Calibrate from all pictures of a board in a folder and its subfolders.

    looked: is called after each picture with its path, the number of pictures and why it is left
        out (empty: it is not).
    Raises CalibrationError when too few show the board, CameraError when there are no pictures.
    """
    calibrator = Calibrator(white, board)
    boards: list[BoardView] = []
    left_out: list[LeftOut] = []
    paths = list_pictures(folder)
    seen: dict[int, str] = {}
    for path in paths:
        name = str(path.relative_to(folder))
        try:
            frame = read_raw_frame(path)
            same = seen.setdefault(hash(frame.counts.tobytes()), name)
            if same != name:
                raise LightFieldError(f'the same picture as {same}')
            boards.append(calibrator.look(name, frame))
            found = ''
        except (CameraError, LightFieldError) as error:
            found = str(error)
            left_out.append(LeftOut(name, found))
        if looked is not None:
            looked(path, len(paths), found)
    return calibrator.calibrate(boards, left_out)


def _of_one_setting(boards: Sequence[BoardView]) -> tuple[list[BoardView], list[LeftOut]]:
    """The boards of the most frequent zoom and focus; a calibration holds for one setting."""
    if not boards:
        return [], []
    usual = Counter(each.setting for each in boards).most_common(1)[0][0]
    return ([each for each in boards if each.setting == usual],
            [LeftOut(each.name, f'taken at zoom and focus step {each.setting}, most boards at '
                     f'{usual}') for each in boards if each.setting != usual])


def _sure(fit: Fit) -> Uncertainty:
    """The uncertainty of a fit; CalibrationError when it is too large."""
    try:
        sure = uncertainty(fit, np.random.default_rng(0))
    except np.linalg.LinAlgError:
        raise CalibrationError(
            f'the boards do not separate focal length, baseline and focus; {_ADVICE}') from None
    relative = sure.expected[[0, 4, 5]] / fit.camera[[0, 4, 5]]
    if not (np.abs(relative) < _SURE).all():
        focal, baseline, focus = 100 * np.abs(relative)
        raise CalibrationError(
            f'the boards determine the focal length to {focal:.0f} %, the baseline to '
            f'{baseline:.0f} % and the focus to {focus:.0f} %; {_ADVICE}')
    return sure
