"""Times and memory of the decode."""

import json
import tracemalloc

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import pack12, unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.bench.plain_decode import plain_decode
from pmcl_ros.evaluation.bench.result import Bench, best_ms
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.calibration.calibration import Calibration
from pmcl_ros.lightfield.calibration.lattice import Lattice
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.lenslets import Lenslets

_SIDE = 3280  # raw px
_BLACK, _WHITE = 168, 4095
_PUPIL = 4.4  # raw px: radius of the main lens' image under a lenslet


def bench_decode(repeats: int = 9) -> Bench:
    """Packed bytes to 9x9 views of 328x328, RGB, float32, of a made-up camera.

    The reference runs once. `mb`: what a decoder keeps, and how much more there is at most while
    it decodes (the counts and the views it makes of them are in that).
    """
    calibration = Calibration(
        fx=945, fy=945, cx=163.5, cy=163.5, baseline=0.00074, focus_distance=0.55,
        lattice=Lattice(pitch_px=9.95, row_step_px=8.617, rotation=0.002,
                        centre_px=(1641.8, 1637.8)))
    light = _light(calibration.lattice)
    data = pack12(_counts(light))
    metadata = CameraMetadata.parse(_text())

    def decode() -> None:
        decoder.decode(RawFrame(Header(), unpack12(data, _SIDE, _SIDE), metadata))

    Decoder.of_light(calibration, light)  # compiles
    tracemalloc.start()
    decoder = Decoder.of_light(calibration, light)
    kept = tracemalloc.get_traced_memory()[0]
    decode()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    plan, frame = decoder.plan, RawFrame(Header(), unpack12(data, _SIDE, _SIDE), metadata)
    samples = np.zeros(plan.factors.shape, np.float32)
    views = decoder.decode(frame).views
    ms = {'unpack': best_ms(lambda: unpack12(data, _SIDE, _SIDE), repeats),
          'sample': best_ms(lambda: plan.sample(frame, samples), repeats),
          'resample': best_ms(lambda: plan.resample(samples, views), repeats),
          'total': best_ms(decode, repeats)}
    ms['reference'] = best_ms(lambda: plain_decode(
        data, _BLACK, _WHITE, light, calibration, decoder.grid), 1)
    geometry = f'{_SIDE}x{_SIDE} px of 12 bits, packed, to 9x9 views of 328x328, RGB, float32'
    return Bench(geometry, ms, ms['reference'] / ms['total'],
                 {'decoder': kept / 1e6, 'decode': (peak - kept) / 1e6})


def _light(lattice: Lattice) -> NDArray[np.float32]:
    """(height, width) the light under round lenslets of a pupil with an edge of a pixel."""
    block = Lenslets.covering(lattice, 0, _SIDE - 1, 0, _SIDE - 1)
    y, x = np.indices((_SIDE, _SIDE), np.float64)
    places = np.stack([x, y], axis=-1).reshape(-1, 2)
    centres = block.centres[tuple(block.nearest(lattice, places).T)]
    distance = np.hypot(*(places - centres).T)
    return np.clip(_PUPIL + 0.5 - distance, 0.01, 1).astype(np.float32).reshape(_SIDE, _SIDE)


def _counts(light: NDArray[np.float32]) -> NDArray[np.uint16]:
    """A noisy picture of a pattern."""
    y, x = np.indices(light.shape) / _SIDE
    pattern = 0.4 + 0.3 * np.sin(90 * x) * np.sin(70 * y)
    noise = np.random.default_rng(0).normal(0, 0.01, light.shape)
    values = _BLACK + (_WHITE - _BLACK) * (pattern * light + noise)
    return np.clip(np.rint(values), 0, 4095).astype(np.uint16)


def _text() -> str:
    """The JSON of the made-up camera."""
    levels = dict.fromkeys(('r', 'gr', 'gb', 'b'), _BLACK)
    return json.dumps({'image': {
        'width': _SIDE, 'height': _SIDE,
        'rawDetails': {'pixelFormat': {'black': levels, 'white': dict.fromkeys(levels, _WHITE)},
                       'mosaic': {'tile': 'r,gr:gb,b', 'upperLeftPixel': 'b'}},
        'color': {'ccmRgbToSrgbArray': [1, 0, 0, 0, 1, 0, 0, 0, 1], 'gamma': 0.41666,
                  'whiteBalanceGain': dict.fromkeys(levels, 1.0)}}})
