"""A light-field camera of known geometry, and its raw frames of a checkerboard, ray by ray."""

import functools
import json

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration

SIDE = 800  # raw px
BLACK, WHITE = 168, 4095
_DISC = 0.5  # view px: radius of the lenslets' discs, over which each gathers light
_NOISE = 2.5e-3  # of the sensor's range, at white
DARK, LIGHT, WALL = 0.08, 0.6, 0.75  # reflectances

CAMERA = {'width': SIDE // 10, 'height': SIDE // 10, 'fx': 231.0, 'fy': 231.0, 'cx': 40.3,
          'cy': 38.9, 'baseline': 0.0021, 'focus_distance': 0.42, 'serial': 'A7',
          'lattice': {'pitch_px': 9.97, 'row_step_px': 9.97 * 3 ** 0.5 / 2, 'rotation': -0.004,
                      'centre_px': (401.3, 398.2)}}


def pose(tilt, turn, distance, middle=(0.0, 0.0), board=(6, 5, 0.012)):
    """(4, 4) board to camera: the board's middle on a pixel's ray at a distance; angles in rad."""
    columns, rows, square = board
    result = np.eye(4)
    rotation = Rotation.from_euler('z', turn) * Rotation.from_rotvec([*tilt, 0])
    result[:3, :3] = rotation.as_matrix()
    half = np.array([(columns - 1) / 2, (rows - 1) / 2, 0]) * square
    result[:3, 3] = distance * np.array([*middle, 1]) - result[:3, :3] @ half
    return result


POSES = [pose((0.5, 0.1), 0.2, 0.36, (0.01, -0.01)), pose((-0.45, 0.2), -0.3, 0.40, (-0.02, 0.02)),
         pose((0.1, -0.55), 0.1, 0.44, (0.03, 0.0)), pose((0.2, 0.5), 0.5, 0.34, (0.0, 0.01)),
         pose((-0.3, -0.4), -0.1, 0.46, (0.0, -0.03))]


class BoardScene:
    """The camera of a `Calibration`; a board of columns x rows inner corners of a square [m].

    zoom: the metadata's zoom step. radius: [m] of the cylinder around which the board is bent, up
    at the ends of its rows.
    """

    def __init__(self, camera=None, board=(6, 5, 0.012), zoom=600, radius=np.inf):
        self.calibration = Calibration.make({**CAMERA, **(camera or {})}, 'scene')
        self.board = board
        self.zoom = zoom
        self.radius = radius
        raw = np.indices((SIDE, SIDE))[::-1].transpose(1, 2, 0).astype(float)
        i, j = np.meshgrid(np.arange(-50, 51), np.arange(-60, 61))
        centres = self.calibration.lattice.centres(i, j).reshape(-1, 2)
        self.owner = cKDTree(centres).query(raw)[1]  # its lenslet
        self.places = (centres - 4.5) / 10  # view px, of the lenslets
        self.offset = raw - centres[self.owner]  # view steps
        radius = np.hypot(*self.offset.T).T
        self.light = np.clip(4.9 - radius, 0.02, 1) * (1 - 0.01 * radius ** 2)

    def _on_board(self, board_to_camera, places):
        """Board coordinates (SIDE, SIDE, 2) [m] that each raw pixel sees, lenslets at places."""
        k = self.calibration
        seen = (places - [k.cx, k.cy]) / [k.fx, k.fy]
        ideal = seen
        for _ in range(20 if k.k1 or k.k2 else 0):
            square = (ideal ** 2).sum(axis=-1, keepdims=True)
            ideal = seen / (1 + k.k1 * square + k.k2 * square ** 2)
        ideal = ideal[self.owner]
        origin = k.baseline * self.offset
        direction = ideal - origin / k.focus_distance
        rotation, translation = board_to_camera[:3, :3], board_to_camera[:3, 3]
        start = (np.concatenate([origin, 0 * origin[..., :1]], -1) - translation) @ rotation
        along = np.concatenate([direction, 1 + 0 * direction[..., :1]], -1) @ rotation
        depth = -start[..., 2:] / along[..., 2:]
        if np.isinf(self.radius):
            return (start + depth * along)[..., :2]
        middle = np.array([(self.board[0] - 1) / 2 * self.board[2], 0])
        for _ in range(20):
            x = np.clip((start + depth * along)[..., :1] - middle[0], -0.9 * self.radius,
                        0.9 * self.radius)
            up = self.radius - np.sqrt(self.radius ** 2 - x ** 2)
            depth = (up - start[..., 2:]) / along[..., 2:]
        x, y = np.moveaxis((start + depth * along)[..., :2] - middle, -1, 0)
        turned = np.arcsin(np.clip(x / self.radius, -0.9, 0.9))
        return np.stack([self.radius * turned, y], axis=-1) + middle

    def reflectance(self, board_to_camera):
        """(SIDE, SIDE): light corner square first, a light margin one square wide, a wall."""
        columns, rows, square = self.board
        point = self._on_board(board_to_camera, self.places)
        # How steep the board's coordinates are in the view: an edge cuts the lenslet's disc.
        beside = [self._on_board(board_to_camera, self.places + step) - point
                  for step in ([1e-3, 0], [0, 1e-3])]
        steepness = np.hypot(*beside) / 1e-3  # m per view px
        waves = []
        for axis in (0, 1):
            phase = point[..., axis] / square
            nearest = np.rint(phase)
            t = np.clip((phase - nearest) * square / (_DISC * steepness[..., axis]),
                        -1, 1)
            part = 2 / np.pi * (t * np.sqrt(1 - t ** 2) + np.arcsin(t))  # of a disc cut at t
            waves.append(part * (-1) ** nearest)
        checks = waves[0] * waves[1]
        inside = ((point > -square) & (point < np.array([columns, rows]) * square)).all(-1)
        margin = ((point > -2 * square) & (point < np.array([columns + 1, rows + 1]) * square)
                  ).all(-1)
        middle, half = (LIGHT + DARK) / 2, (LIGHT - DARK) / 2
        return np.where(inside, middle + half * checks, np.where(margin, LIGHT, WALL))

    def picture(self, board_to_camera, seed=0):
        """The raw frame of a board at a pose."""
        return self.frame(self.reflectance(board_to_camera) * self.light, seed)

    def white(self, seed=99):
        """The white image."""
        return self.frame(0.8 * self.light, seed, white=True)

    def frame(self, values, seed=0, white=False):
        """Values (SIDE, SIDE) in [0, 1] with shot noise as a frame."""
        rng = np.random.default_rng(seed)
        noisy = values + _NOISE * np.sqrt(np.maximum(values, 0.02)) * rng.standard_normal(
            values.shape)
        counts = np.clip(np.rint(BLACK + (WHITE - BLACK) * noisy), 0, 4095).astype(np.uint16)
        return RawFrame(Header(), counts, CameraMetadata.parse(self.text(white)))

    def text(self, white=False):
        """The JSON beside a picture."""
        levels = {'r': BLACK, 'gr': BLACK, 'gb': BLACK, 'b': BLACK}
        metadata = {
            'image': {'width': SIDE, 'height': SIDE, 'rawDetails': {
                'pixelFormat': {'black': levels, 'white': dict.fromkeys(levels, WHITE)},
                'mosaic': {'tile': 'r,gr:gb,b', 'upperLeftPixel': 'b'}},
                'color': {'ccmRgbToSrgbArray': [1, 0, 0, 0, 1, 0, 0, 0, 1], 'gamma': 0.41666,
                          'whiteBalanceGain': dict.fromkeys(levels, 1.0)}},
            'devices': {'lens': {'zoomStep': self.zoom, 'focusStep': 700}}}
        frame = {'metadata': metadata,
                 'privateMetadata': {'camera': {'serialNumber': self.calibration.serial}}}
        picture = {'frameArray': [{'frame': frame}], 'parameters': {
            'vendorContent': {'com.lytro.tags': {'modulationFrame': white, 'darkFrame': False}}}}
        return json.dumps({'master': {'picture': picture}})

    def corners(self, board_to_camera):
        """(rows, columns, 2) positions and disparities of the corners, without distortion."""
        columns, rows, square = self.board
        k = self.calibration
        x, y = np.meshgrid(np.arange(columns) * square, np.arange(rows) * square)
        seen = np.stack([x, y, 0 * x], -1) @ board_to_camera[:3, :3].T + board_to_camera[:3, 3]
        positions = seen[..., :2] / seen[..., 2:] * [k.fx, k.fy] + [k.cx, k.cy]
        per_step = k.baseline * (1 / k.focus_distance - 1 / seen[..., 2:])
        return positions, per_step * [k.fx, k.fy]


@functools.cache
def plain():
    """A scene that several tests look at."""
    return BoardScene()


@functools.cache
def frame_of(index):
    """The frame of that scene with the board at POSES[index]."""
    return plain().picture(POSES[index], index)
