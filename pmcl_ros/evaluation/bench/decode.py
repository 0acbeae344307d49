"""Measures time and memory of the decode, against its plain form in numpy and scipy."""

import json
import tracemalloc

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve, map_coordinates

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import pack12, unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.bench.timing import Bench, best_ms
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.lytro.calibration import RAW_PITCH, Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.lenslets import DARKEST, Lenslets
from pmcl_ros.lightfield.light_field import ViewGrid

_BLACK, _WHITE = 168, 4095  # counts of a 12-bit sensor, as an F01's
_PUPIL = 4.4  # raw px: radius of the main lens' image under a lenslet
# Bilinear demosaicing: green from 4 neighbours, red and blue from 2 or 4.
_CROSS = np.array([[0, 1, 0], [1, 4, 1], [0, 1, 0]], np.float32) / 4
_SQUARE = np.array([[1, 2, 1], [2, 4, 2], [1, 2, 1]], np.float32) / 4


def bench_decode(repeats: int = 9, side: int = 3280) -> Bench:
    """Packed bytes of side x side raw pixels to 9x9 views, RGB, float32, of a made-up camera.

    side: a multiple of 10; by default that of an F01. The reference runs once. `mb`: what a
    decoder keeps, and how much more there is at most while it decodes (the counts and the views it
    makes of them are in that).
    """
    extent = side // RAW_PITCH  # px of a view
    calibration = Calibration(
        width=extent, height=extent, fx=945, fy=945, cx=(extent - 1) / 2, cy=(extent - 1) / 2,
        baseline=0.00074, focus_distance=0.55,
        lattice=Lattice(pitch_px=9.95, row_step_px=8.617, rotation=0.002,
                        centre_px=(side / 2 + 1.8, side / 2 - 2.2)))
    light = _light(calibration.lattice, side)
    data = pack12(_counts(light))
    metadata = CameraMetadata.parse(camera_text(side))

    def decode() -> None:
        decoder.decode(RawFrame(Header(), unpack12(data, side, side), metadata))

    Decoder(calibration, light)  # compiles
    tracemalloc.start()
    decoder = Decoder(calibration, light)
    kept = tracemalloc.get_traced_memory()[0]
    decode()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    plan, frame = decoder.plan, RawFrame(Header(), unpack12(data, side, side), metadata)
    samples = np.zeros(plan.factors.shape, np.float32)
    views = decoder.decode(frame).views
    ms = {'unpack': best_ms(lambda: unpack12(data, side, side), repeats),
          'sample': best_ms(lambda: plan.sample(frame, samples), repeats),
          'resample': best_ms(lambda: plan.resample(samples, views), repeats),
          'total': best_ms(decode, repeats)}
    ms['reference'] = best_ms(lambda: plain_decode(data, light, calibration, decoder.grid), 1)
    geometry = (f'{side}x{side} px of 12 bits, packed, to 9x9 views of {extent}x{extent}, '
                'RGB, float32')
    return Bench(geometry, ms, ms['reference'] / ms['total'],
                 {'decoder': kept / 1e6, 'decode': (peak - kept) / 1e6})


def _light(lattice: Lattice, side: int) -> NDArray[np.float32]:
    """(side, side) the light under round lenslets of a pupil with an edge of a pixel."""
    block = Lenslets.covering(lattice, 0, side - 1, 0, side - 1)
    y, x = np.indices((side, side), np.float64)
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    centres = block.centres[tuple(block.nearest(lattice, places).T)]
    distance = np.hypot(*(places - centres).T)
    return np.clip(_PUPIL + 0.5 - distance, 0.01, 1).astype(np.float32).reshape(side, side)


def _counts(light: NDArray[np.float32]) -> NDArray[np.uint16]:
    """A noisy picture of a pattern."""
    y, x = np.indices(light.shape) / len(light)
    pattern = 0.4 + 0.3 * np.sin(90 * x) * np.sin(70 * y)
    noise = np.random.default_rng(0).normal(0, 0.01, light.shape)
    values = _BLACK + (_WHITE - _BLACK) * (pattern * light + noise)
    return np.clip(np.rint(values), 0, 4095).astype(np.uint16)


def camera_text(side: int) -> str:
    """The JSON of a made-up camera of side x side pixels."""
    colours = ('r', 'gr', 'gb', 'b')
    levels = {'black': dict.fromkeys(colours, _BLACK), 'white': dict.fromkeys(colours, _WHITE)}
    return json.dumps({'image': {
        'width': side, 'height': side,
        'rawDetails': {'pixelFormat': levels,
                       'mosaic': {'tile': 'r,gr:gb,b', 'upperLeftPixel': 'b'}},
        'color': {'ccmRgbToSrgbArray': [1, 0, 0, 0, 1, 0, 0, 0, 1], 'gamma': 0.41666,
                  'whiteBalanceGain': dict.fromkeys(colours, 1.0)}}})


def plain_decode(data: bytes, light: NDArray[np.float32], calibration: Calibration, grid: ViewGrid
                 ) -> NDArray[np.float32]:
    """Views (rows, columns, height, width, 3) of a packed picture.

    Unpacked; divided by the white image; demosaiced linearly, across the lenslets' borders; read
    at an offset from every lenslet's centre; interpolated along the lattice's rows, then across.
    """
    height, width = light.shape
    linear = _unpack(data, width, height) - np.float32(_BLACK)
    linear *= np.float32(1 / (_WHITE - _BLACK))
    colours = _demosaic(linear / np.maximum(light, np.float32(DARKEST)))
    lattice = calibration.lattice
    i0, i1, j0, j1 = lattice.index_range(width, height)
    i0, i1, j0, j1 = i0 - 8, i1 + 8, j0 - 8, j1 + 8
    x, y = np.moveaxis(lattice.centres(*np.meshgrid(np.arange(i0, i1), np.arange(j0, j1))), -1, 0)
    pinhole, pitch = grid.pinhole, width / grid.pinhole.width
    focus = calibration.baseline / calibration.focus_distance
    cos, sin = np.cos(lattice.rotation), np.sin(lattice.rotation)
    v, u = np.indices((pinhole.height, pinhole.width), np.float64)
    views = np.zeros((*grid.shape, pinhole.height, pinhole.width, 3), np.float32)
    for row, column in np.argwhere(grid.weights > 0):
        a, b = column - grid.centre[1], row - grid.centre[0]
        samples = [map_coordinates(each, [y + b, x + a], order=1, mode='nearest')
                   for each in colours]
        shift_x, shift_y = grid.positions[row, column] * [pinhole.fx * focus, pinhole.fy * focus]
        raw_x = (u + shift_x + 0.5) * pitch - 0.5 - lattice.centre_px[0]
        raw_y = (v + shift_y + 0.5) * pitch - 0.5 - lattice.centre_px[1]
        across = (cos * raw_y - sin * raw_x) / lattice.row_step_px
        along = (cos * raw_x + sin * raw_y) / lattice.pitch_px
        upper = np.floor(across)
        part = (across - upper).astype(np.float32)
        for colour, each in enumerate(samples):
            first, second = (map_coordinates(each, [j - j0, along - j % 2 / 2 - i0], order=1)
                             for j in (upper, upper + 1))
            views[row, column, :, :, colour] = (1 - part) * first + part * second
    return views


def _unpack(data: bytes, width: int, height: int) -> NDArray[np.uint16]:
    first, second, third = np.frombuffer(data, np.uint8).reshape(-1, 3).astype(np.uint16).T
    counts = np.stack([first << 4 | second >> 4, (second & 15) << 8 | third], axis=1)
    return counts.reshape(height, width)


def _demosaic(mosaic: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    """Red, green and blue (height, width) of BGGR."""
    planes = [np.zeros_like(mosaic) for _ in range(3)]
    planes[0][1::2, 1::2] = mosaic[1::2, 1::2]
    planes[1][::2, 1::2], planes[1][1::2, ::2] = mosaic[::2, 1::2], mosaic[1::2, ::2]
    planes[2][::2, ::2] = mosaic[::2, ::2]
    return [convolve(plane, kernel, mode='nearest')
            for plane, kernel in zip(planes, (_SQUARE, _CROSS, _SQUARE), strict=True)]
