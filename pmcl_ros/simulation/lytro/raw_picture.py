"""Raw pictures of scenes by a simulated Lytro: exposure, Bayer filter, noise, 12 bits."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.geometry.header import Header
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.scenes.rays import LightAlong
from pmcl_ros.simulation.scenes.sensor import exposure

_COLOURS = np.array([[2, 1], [1, 0]])  # BGGR: which of red, green, blue each phase is
_RAYS = 3_000_000  # at once, of a hundred bytes each
_METERED, _METERED_RAYS = 20_000, 4  # pixels that the exposure is measured from
_MOST = 4.0  # that a ray counts [1 at the sensor's white]


def raw_picture(camera: LytroCamera, light: LightAlong, rng: np.random.Generator,
                samples: int = 4, level: float = 0.3, is_white: bool = False,
                progress: Callable[[float], None] = lambda _: None) -> RawFrame:
    """The raw picture of a scene.

    light: along rays, of `fast_along` or `physical_along`. samples: rays of a raw pixel; a
    decoder sums some ten of them for a pixel of a view. level: mean of the
    sensor's colours that the exposure aims at, under the lenslets' centres, as of
    `sensor.exposure`. progress: called with the share done. The same scene and generator state
    give the same picture. No ray counts as more than four times white: light that a few paths find
    by chance would shine as dots.
    """
    gain = _metered(camera, light, rng, level)
    counts = np.empty((camera.height, camera.width), np.uint16)
    rows = max(1, _RAYS // (camera.width * samples))
    for top in range(0, camera.height, rows):
        y, x = np.mgrid[top:min(top + rows, camera.height), :camera.width]
        values = _values(camera, light, np.stack([x, y], axis=-1).reshape(-1, 2), samples, gain,
                         rng).reshape(x.shape)
        counts[top:top + rows] = _counts(camera, values, rng)
        progress(min(top + rows, camera.height) / camera.height)
    metadata = CameraMetadata.parse(camera.text(is_white))
    return RawFrame(Header(), counts, metadata)


def _metered(camera: LytroCamera, light: LightAlong, rng: np.random.Generator, level: float
             ) -> float:
    """The exposure: values at the sensor over radiances."""
    pixels = rng.integers([camera.width, camera.height], size=(_METERED, 2))
    origins, directions, weights = camera.rays(pixels, _METERED_RAYS, rng)
    is_in = (weights > 0).all(axis=1)
    found = light(origins[is_in].reshape(-1, 3), directions[is_in].reshape(-1, 3),
                  int(rng.integers(2 ** 31)))
    seen = found.reshape(-1, _METERED_RAYS, 3).mean(axis=1) @ camera.response.T
    return exposure(seen, level)


def _values(camera: LytroCamera, light: LightAlong, pixels: NDArray[np.integer], samples: int,
            gain: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """(n,) light of pixels (n, 2) behind their colour filters, 1 at the sensor's white."""
    origins, directions, weights = camera.rays(pixels, samples, rng)
    colours = _COLOURS[pixels[:, 1] % 2, pixels[:, 0] % 2]
    filters = (gain * camera.response).astype(np.float32)[colours]
    is_in = weights > 0
    found = light(origins[is_in], directions[is_in], int(rng.integers(2 ** 31)))
    number = np.nonzero(is_in)[0]
    seen = np.clip((found * filters[number]).sum(axis=1), 0, np.float32(_MOST)) * weights[is_in]
    total = np.bincount(number, seen, len(pixels)) / samples
    return np.asarray(total, np.float32)


def _counts(camera: LytroCamera, values: NDArray[np.float32], rng: np.random.Generator
            ) -> NDArray[np.uint16]:
    """With photon and read noise, in whole counts."""
    electrons = rng.poisson(camera.electrons * values) + camera.read * rng.standard_normal(
        values.shape, np.float32)
    counts = camera.black + (camera.white - camera.black) / camera.electrons * electrons
    return np.asarray(np.clip(np.rint(counts), 0, 4095), np.uint16)
