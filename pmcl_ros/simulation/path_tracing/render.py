"""Radiance of a view's pixels by path tracing."""

from collections.abc import Sequence
from functools import partial
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.path_tracing.integrator import radiance
from pmcl_ros.simulation.path_tracing.translate import to_mitsuba
from pmcl_ros.simulation.path_tracing.variant import is_compiled, mitsuba
from pmcl_ros.simulation.scenes.rays import LightAlong
from pmcl_ros.simulation.scenes.render import LightOfView
from pmcl_ros.simulation.scenes.scene import Scene, Target
from pmcl_ros.simulation.scenes.sensor import Sensor

_PASSES = 8  # at most: the median over them tells outliers
_MOST = 2.0  # that a pass counts, in medians of all passes
_LESS = 4  # times fewer samples get pixels beside the regions
_LEAST = 4  # paths of a pixel in a pass
_WAVEFRONT = 4_000_000  # paths at once, of a few hundred bytes each
_TENT = 2.0  # view steps: how far from its position a view gathers light


def physical(scene: Scene) -> LightOfView:
    """Path tracing by Mitsuba: shadows, interreflections, rough glass, some caustics.

    Pixels that show no part of the targets' regions get a quarter of the samples. Raises
    SimulationError where Mitsuba is missing, and as `to_mitsuba`.
    """
    return partial(light_of_view, to_mitsuba(scene), scene.targets)


def light_of_view(loaded: Any, targets: Sequence[Target], sensor: Sensor, row: int, column: int,
                  margin: int, samples: int, seed: int) -> NDArray[np.float32]:
    """(height + 2 margin, width + 2 margin, 3) mean radiance of a view's pixels, noise-free.

    loaded: of `to_mitsuba`. The rest is as of `scenes.render.light_of_view`. samples: paths per
    pixel, in up to eight passes. A pixel is the mean of its passes, none of which counts as more
    than twice their median: light that a few paths find by chance, as most of what glass focuses
    on a table, is left out instead of shining as dots.
    Where Mitsuba is not compiled (`is_compiled`), views are sharp at all depths.
    """
    of = sensor.grid.pinhole
    pinhole = of.crop(-margin, -margin, of.width + 2 * margin, of.height + 2 * margin)
    place = sensor.grid.baseline * sensor.grid.positions[row, column]
    rng = np.random.default_rng(seed)
    left, top, right, bottom = _shown(targets, pinhole)
    inside = pinhole.crop(left, top, right - left, bottom - top)
    if inside == pinhole:
        return _light(loaded, sensor, pinhole, place, samples, rng)
    picture = _light(loaded, sensor, pinhole, place, -(-samples // _LESS), rng)
    picture[top:bottom, left:right] = _light(loaded, sensor, inside, place, samples, rng)
    return picture


def physical_along(scene: Scene) -> LightAlong:
    """As `physical`, one path along each given ray, nothing left out.

    Raises SimulationError where Mitsuba is missing or not compiled, and as `to_mitsuba`.
    """
    prepare(along=True)
    return partial(light_along, to_mitsuba(scene))


def prepare(along: bool = False) -> None:
    """Load Mitsuba ahead of the first scene.

    along: for `physical_along`. Raises SimulationError where that, or `physical`, does not run.
    """
    mitsuba()
    if along and not is_compiled():
        raise SimulationError('raw pictures by path tracing need an LLVM library: apt install '
                              'libllvm15 or newer, or choose --renderer fast')


def light_along(loaded: Any, origins: NDArray[np.float64], directions: NDArray[np.float64],
                seed: int) -> NDArray[np.float32]:
    """(n, 3) radiance by one path along each ray; loaded: of `to_mitsuba`."""
    mi = mitsuba()
    light = np.empty((len(origins), 3), np.float32)
    for number, start in enumerate(range(0, len(origins), _WAVEFRONT)):
        part = slice(start, start + _WAVEFRONT)
        sampler = mi.load_dict({'type': 'independent'})
        sampler.seed(seed % 2 ** 31 + number, len(light[part]))
        # Dr.Jit may read arrays later: they are kept until the light has come back.
        starts, ways = (np.ascontiguousarray(each[part].T, np.float32)
                        for each in (origins, directions))
        ray = mi.Ray3f(mi.Point3f(starts), mi.Vector3f(ways))
        light[part] = np.array(radiance(loaded, sampler, ray)).T
    return light


def _shown(targets: Sequence[Target], pinhole: Pinhole) -> tuple[int, int, int, int]:
    """Left, top, right and bottom of the pixels that show a target, and a region about it [px].

    The whole picture where there is no target, or none in view.
    """
    everything = 0, 0, pinhole.width, pinhole.height
    seen = []
    for each in targets:
        reach = np.array(each.roi_size) / 2 + np.linalg.norm(each.vertices, axis=1).max()
        corners = each.pose[:3, 3] + reach * np.array(list(product((-1, 1), repeat=3)))
        if corners[:, 2].min() <= 0:
            return everything
        seen.append(pinhole.project(corners))
    if not seen:
        return everything
    size = [pinhole.width, pinhole.height]
    low = np.floor(np.concatenate(seen).min(axis=0)).clip(0, size).astype(int)
    high = np.ceil(np.concatenate(seen).max(axis=0) + 1).clip(0, size).astype(int)
    return (*low.tolist(), *high.tolist()) if (high > low).all() else everything


def _light(loaded: Any, sensor: Sensor, pinhole: Pinhole, place: NDArray[np.float64],
           samples: int, rng: np.random.Generator) -> NDArray[np.float32]:
    """Of a pinhole's pixels, seen from a place (2,) in the plane of the pupil [m]."""
    passes = int(np.clip(samples // _LEAST, 1, _PASSES))
    each = -(-samples // passes)
    seeds = rng.integers(2 ** 31, size=passes).tolist()
    if is_compiled():
        rows = max(1, _WAVEFRONT // (pinhole.width * each))
        bands = [pinhole.crop(0, top, pinhole.width, min(rows, pinhole.height - top))
                 for top in range(0, pinhole.height, rows)]
        pictures = [np.concatenate([_pass(loaded, sensor, band, place, each, number + of)
                                    for of, band in enumerate(bands)]) for number in seeds]
    else:
        camera = mitsuba().load_dict(_perspective(pinhole, place))
        pictures = [np.array(mitsuba().render(loaded, sensor=camera, spp=each, seed=number))
                    for number in seeds]
    most = _MOST * np.median(pictures, axis=0)
    return np.minimum(pictures, most).mean(axis=0).astype(np.float32)


def _pass(loaded: Any, sensor: Sensor, pinhole: Pinhole,
          place: NDArray[np.float64], samples: int, seed: int) -> NDArray[np.float32]:
    """(height, width, 3) mean of `samples` paths, from points of a view's part of the pupil.

    place: (2,) of the view [m]. All rays of a pixel meet in the plane of focus.
    """
    import drjit as dr  # only where Mitsuba is
    mi = mitsuba()
    pixels = pinhole.height * pinhole.width
    sampler = mi.load_dict({'type': 'multijitter', 'sample_count': samples})
    samples = sampler.sample_count()  # it may need some more
    sampler.set_samples_per_wavefront(samples)
    # Numbers that Dr.Jit knows are compiled in: each pass would be compiled by itself.
    sampler.seed(dr.opaque(mi.UInt32, seed), pixels * samples)
    x, y, reach, focus, fx, fy, cx, cy = (dr.opaque(mi.Float, float(each)) for each in (
        *place, _TENT * sensor.grid.baseline, sensor.focus, pinhole.fx, pinhole.fy, pinhole.cx,
        pinhole.cy))
    width = dr.opaque(mi.UInt32, pinhole.width)
    number = dr.arange(mi.UInt32, pixels * samples) // samples
    within, first, second = sampler.next_2d(), sampler.next_2d(), sampler.next_2d()
    aside = [x + reach * (first[0] + second[0] - 1), y + reach * (first[1] + second[1] - 1)]
    at = [x + focus * (number % width + within[0] - 0.5 - cx) / fx,
          y + focus * (number // width + within[1] - 0.5 - cy) / fy]
    way = dr.normalize(mi.Vector3f(at[0] - aside[0], at[1] - aside[1], focus))
    ray = mi.Ray3f(mi.Point3f(aside[0], aside[1], 0), way)
    mean = np.array(radiance(loaded, sampler, ray)).reshape(3, pixels, samples).mean(axis=2)
    return np.asarray(mean.T.reshape(pinhole.height, pinhole.width, 3), np.float32)


def _perspective(pinhole: Pinhole, place: NDArray[np.float64]) -> dict[str, object]:
    """A pinhole in Mitsuba's terms; SimulationError unless its pixels are square."""
    if not np.isclose(pinhole.fx, pinhole.fy):
        raise SimulationError(f'fx {pinhole.fx:g} and fy {pinhole.fy:g} px: without an LLVM '
                              'library both must be the same; apt install libllvm15 or newer')
    width, height = pinhole.width, pinhole.height
    turn = np.diag([-1.0, -1, 1, 1])  # Mitsuba's x to the left and y up become right and down
    turn[:2, 3] = place
    return {'type': 'perspective', 'near_clip': 1e-3, 'far_clip': 100.0,
            'fov_axis': 'x', 'fov': float(2 * np.rad2deg(np.arctan(width / (2 * pinhole.fx)))),
            'to_world': mitsuba().ScalarTransform4f(turn),
            'principal_point_offset_x': ((width - 1) / 2 - pinhole.cx) / width,
            'principal_point_offset_y': ((height - 1) / 2 - pinhole.cy) / height,
            'film': {'type': 'hdrfilm', 'width': width, 'height': height,
                     'rfilter': {'type': 'box'}, 'pixel_format': 'rgb',
                     'component_format': 'float32'},
            'sampler': {'type': 'independent'}}
