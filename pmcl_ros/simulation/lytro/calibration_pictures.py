"""What a camera is calibrated with: its white image, and pictures of a checkerboard."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import write_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.runtime.outputs import Results, write_file
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.rays import fast_along
from pmcl_ros.simulation.scenes.scene import Scene, Sheet
from pmcl_ros.simulation.scenes.textures import SIZE, Texture
from pmcl_ros.simulation.simulated_captures import is_there

BOARD = Checkerboard(10, 7, 0.011)  # as of `pmcl evaluate`
_COMMAND = 'simulate'  # of whom the files are the results
_DARK, _LIGHT, _WALL = 0.08, 0.6, 0.75  # reflectances; the room is one even grey
_BEHIND = 1e-4  # m: of the board's white margin
_LEVEL = 0.75  # of a white image
_SAMPLES = 8  # rays of a raw pixel: nothing but boards is cheap
_TILTS = (0.5, 0.6, 0.45, 0.55, 0.35, 0.5, 0.6, 0.4)  # rad
_DISTANCES = (0.78, 0.86, 0.95, 1.05, 1.16, 1.28, 1.42, 1.6)  # focus distances
_TURN = 2.4  # rad, between the directions of two tilts: the golden angle
COUNT = 1 + len(_TILTS)  # of the pictures: the white one, and boards

Progress = Callable[[float], None]  # called with the share done of a picture


def white_picture(camera: LytroCamera, rng: np.random.Generator, samples: int = _SAMPLES,
                  progress: Progress = lambda _: None) -> RawFrame:
    """The white image."""
    empty = _scene(camera, ())
    return raw_picture(camera, fast_along(empty), rng, samples, _LEVEL, is_white=True,
                       progress=progress)


def board_picture(camera: LytroCamera, board: Checkerboard, pose: NDArray[np.float64],
                  rng: np.random.Generator, progress: Progress = lambda _: None) -> RawFrame:
    """A raw picture of a board with a light margin, before a wall.

    pose: (4, 4) to the camera, of the frame of `Checkerboard.points`, z into the board.
    """
    middle = np.eye(4)
    middle[:2, 3] = np.array([board.columns - 1, board.rows - 1]) / 2 * board.square
    behind = middle.copy()
    behind[2, 3] = _BEHIND
    squares = np.array([board.columns, board.rows]) + 1
    width, height = (squares * board.square).tolist()
    wide, high = ((squares + 2) * board.square).tolist()
    paper = np.full((SIZE, SIZE, 3), _LIGHT, np.float32)
    sheets = (Sheet(pose @ middle, (width, height), _squares(board), 2 * board.square),
              Sheet(pose @ behind, (wide, high), paper, 1.0))
    return raw_picture(camera, fast_along(_scene(camera, sheets)), rng, _SAMPLES,
                       progress=progress)


def board_poses(camera: LytroCamera) -> Iterator[NDArray[np.float64]]:
    """Eight poses (4, 4) of `BOARD`, at 0.8 to 1.6 focus distances, tilted to all sides, in view.

    Boards beyond the focus fill the picture's corners in turn.
    """
    calibration = camera.calibration
    half = np.array([BOARD.columns - 1, BOARD.rows - 1, 0]) / 2 * BOARD.square
    reach = float(np.linalg.norm(half)) + BOARD.square
    field = min(calibration.width, calibration.height) / 2 / calibration.fx
    nearest = reach / field
    for number, (tilt, distance) in enumerate(zip(_TILTS, _DISTANCES, strict=True)):
        way = np.array([np.cos(_TURN * number), np.sin(_TURN * number), 0])
        depth = max(distance * camera.focus, nearest)
        aside = (field * depth - reach) * np.array([(-1) ** number, (-1) ** (number // 2)]) * 0.7
        turned = Rotation.from_rotvec(tilt * way) * Rotation.from_euler('z', 0.2 * number - 0.7)
        pose = pose_of(turned, np.array([*aside, depth]))
        pose[:3, 3] -= pose[:3, :3] @ half
        yield pose


def write_calibration(folder: Path, camera: LytroCamera, force: bool = False,
                      progress: Progress = lambda _: None) -> None:
    """Write what a decoder needs into a folder: calibration.yaml, the exact one, and white/.

    white/ has IMG.RAW, IMG.TXT, truth.json; one that is there is kept. Raises OutputError where a
    file is there that no earlier run wrote, unless `force`.
    """
    with Results(folder, _COMMAND, force) as out:
        camera.calibration.save(out.path('calibration.yaml'), 'Of a simulated camera: exact.')
    lattice = camera.lattice.model_dump(mode='json')
    if not is_there(folder / 'white'):
        frame = white_picture(camera, np.random.default_rng(0), progress=progress)
        _write(folder / 'white', frame, {'lattice': lattice}, force)


def write_calibration_pictures(folder: Path, camera: LytroCamera, force: bool = False,
                               progress: Progress = lambda _: None) -> Iterator[Path]:
    """Write white/, board1/ ... board8/ and calibration.yaml, the exact one, into a folder.

    The folder of each of the `COUNT` pictures as it is ready: IMG.RAW, IMG.TXT, truth.json. Those
    that are there are kept, unless `force`. Raises as `write_calibration`.
    """
    if force:
        (folder / 'white' / 'truth.json').unlink(missing_ok=True)  # so it is not kept
    write_calibration(folder, camera, force, progress)
    yield folder / 'white'
    for number, pose in enumerate(board_poses(camera), 1):
        place = folder / f'board{number}'
        if force or not is_there(place):
            frame = board_picture(camera, BOARD, pose, np.random.default_rng(number),
                                  progress=progress)
            _write(place, frame, {'board_to_camera': pose.tolist()}, force)
        yield place


def pictures_to_make(folder: Path, force: bool = False) -> int:
    """How many of the `COUNT` pictures `write_calibration_pictures` makes."""
    names = 'white', *(f'board{number}' for number in range(1, COUNT))
    return sum(force or not is_there(folder / each) for each in names)


def _write(folder: Path, frame: RawFrame, truth: dict[str, object], force: bool) -> None:
    with Results(folder, _COMMAND, force) as out:
        out.reserve('IMG.TXT')
        write_raw_frame(out.path('IMG.RAW'), frame, force=True)
        write_file(out.path('truth.json'), json.dumps(truth, indent=1) + '\n')


def _scene(camera: LytroCamera, sheets: tuple[Sheet, ...]) -> Scene:
    wall = Environment(np.full((8, 16, 3), _WALL, np.float32))
    return Scene('calibration', (), sheets, wall, np.eye(3),
                 camera.sensor(np.random.default_rng(0)), (), ())


def _squares(board: Checkerboard) -> Texture:
    """Two by two squares, so placed that a sheet's first corner square is light.

    Sheets have their texture's origin in their middle.
    """
    at = 2 * np.pi * np.arange(SIZE) / SIZE
    waves = []
    for squares in (board.columns + 1, board.rows + 1):
        first = np.pi * (0.5 - squares / 2)
        wave, sign = (np.cos, np.cos(first)) if squares % 2 else (np.sin, np.sin(first))
        waves.append(np.sign(np.round(wave(at), 9)) * np.sign(sign))
    light = 0.5 + 0.5 * waves[1][:, None] * waves[0]
    shown = _DARK + (_LIGHT - _DARK) * light
    return np.repeat(shown[..., None], 3, axis=-1).astype(np.float32)
