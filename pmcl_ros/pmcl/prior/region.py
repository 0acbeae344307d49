"""The region of interest: a box that holds the object's origin."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.pmcl.prior.odd_poses import likely_mistake, sees, without_mistakes
from pmcl_ros.pmcl.render.scene import Window, sphere_bounds
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.runtime.errors import LocalizationError

Given = TypeVar('Given', bound=PmclSettings)
_REACH = 0.1, 3.0  # m: depths at which a table is looked at, where none are given
_SLACK = 0.02  # m: by which a table's plane may be off
_RAYS, _STEPS = 25, 25  # places of a view: across and down, along each ray


@dataclass(frozen=True)
class Box:
    """A box along the axes of the frame that poses are in: center and size [m]."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not np.isfinite([*self.center, *self.size]).all() or min(self.size) <= 0:
            raise LocalizationError(f'region of interest at {self.center} m of size {self.size} '
                                    'm: every number must be finite and every size positive')

    @property
    def low(self) -> NDArray[np.float64]:
        """(3,) its least corner [m]."""
        return np.array(self.center) - np.array(self.size) / 2

    @property
    def high(self) -> NDArray[np.float64]:
        """(3,) its greatest corner [m]."""
        return np.array(self.center) + np.array(self.size) / 2

    @property
    def corners(self) -> NDArray[np.float64]:
        """(8, 3) all of them [m]."""
        return np.array(list(itertools.product(*zip(self.low, self.high, strict=True))))

    def contains(self, points: NDArray[np.floating]) -> NDArray[np.bool_]:
        """(n,) which points (n, 3) lie in the box."""
        reach = np.array(self.size) / 2 + 1e-9
        return (np.abs(points - np.array(self.center)) <= reach).all(axis=-1)

    def clip(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Points (n, 3), those outside the box moved onto its surface."""
        return np.clip(points, self.low, self.high)


@dataclass(frozen=True)
class Region(Box):
    """A box in the camera's optical frame, in front of the camera."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.near <= 0.02:
            raise LocalizationError(f'region of interest begins at {self.near:.3f} m: it must lie '
                                    'in front of the camera (z forward)')

    @classmethod
    def before_camera(cls, camera: NDArray[np.float64], center: tuple[float, float, float],
                      size: tuple[float, float, float]) -> 'Region':
        """The box along the axes of a camera (4, 4) that holds a box of the camera's reference.

        camera: to that frame. Raises LocalizationError where it reaches behind the camera.
        """
        seen = (Box(center, size).corners - camera[:3, 3]) @ camera[:3, :3]
        low, high = seen.min(axis=0), seen.max(axis=0)
        x, y, z = ((low + high) / 2).tolist()
        width, height, depth = (high - low).tolist()
        return cls((x, y, z), (width, height, depth))

    @property
    def near(self) -> float:
        """Smallest depth of the box [m]."""
        return self.center[2] - self.size[2] / 2

    @property
    def far(self) -> float:
        """Largest depth of the box [m]."""
        return self.center[2] + self.size[2] / 2

    def grown(self, radius: float) -> tuple[float, float]:
        """Depths (near, far) that hold an object of this radius whose origin is in the box [m]."""
        return max(self.near - radius, 0.2 * self.near), self.far + radius

    def depths(self, step: float) -> NDArray[np.float64]:
        """Depths over the box, a factor of about 1 + step apart, [m]."""
        count = max(1, math.ceil(math.log(self.far / self.near) / math.log1p(step)))
        edges = np.geomspace(self.near, self.far, count + 1)
        return np.sqrt(edges[1:] * edges[:-1])

    def footprint(self, pinhole: Pinhole, depth: float) -> tuple[float, float, float, float]:
        """Left, top, right, bottom pixel of the box at a depth, not cut at the image's border."""
        (left, top), (right, bottom) = pinhole.project(
            np.array([[*self.low[:2], depth], [*self.high[:2], depth]]))
        return left, top, right, bottom

    def window(self, pinhole: Pinhole, radius: float) -> Window:
        """The part of the image that an object of this radius, its origin in the box, can cover.

        Raises LocalizationError when that is outside the image.
        """
        bounds = sphere_bounds(pinhole, self.corners, radius)
        left, top = np.clip(np.floor(bounds[:, :2].min(axis=0)), 0, None)
        right, bottom = np.clip(np.ceil(bounds[:, 2:].max(axis=0)) + 1, None,
                                (pinhole.width, pinhole.height))
        if left >= right or top >= bottom:
            raise self.out_of_view(pinhole)
        return Window(int(left), int(top), (int(right - left), int(bottom - top)))

    def middle_out_of_view(self, pinhole: Pinhole) -> str:
        """In words, that the box's middle is outside of the image; empty where it is not."""
        if sees(pinhole, np.eye(4), self.center):
            return ''
        x, y = pinhole.project(np.array(self.center))
        return (f'the middle of the region of interest, {_told(self.center)} m, is outside of the '
                f'image: at ({x:.0f}, {y:.0f}) px of {pinhole.width}x{pinhole.height}; it is in '
                'the optical frame of the camera: x right, y down, z forward')

    def check_depths(self, depths: NDArray[np.float64]) -> None:
        """Raise LocalizationError unless labels (far to near) reach into the region [m]."""
        far, near = depths[0], depths[-1]
        if far <= self.near or near >= self.far:
            raise LocalizationError(
                f'the depth labels span {near:.3f} to {far:.3f} m, the region of interest '
                f'{self.near:.3f} to {self.far:.3f} m; set near and far around the region')

    def out_of_view(self, pinhole: Pinhole) -> LocalizationError:
        """The error for a box in which the object cannot be seen anywhere."""
        return LocalizationError(
            f'the region of interest at {_told(self.center)} m of size {_told(self.size)} m is '
            f'outside the image ({pinhole.width}x{pinhole.height}); it is in the optical frame of '
            'the camera: x right, y down, z forward')


def regions_before(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                   settings: PmclSettings, radius: float, frame_id: str) -> dict[int, Region]:
    """Boxes before cameras that hold the region of interest, by the numbers of the cameras.

    Only of cameras that can see an object in it. cameras: each with its pose (4, 4) in the
    reference frame frame_id. radius: of the object [m]. Raises LocalizationError where none can.
    """
    seen = _before(cameras, settings, radius)[0]
    if not seen:
        raise LocalizationError(
            f'none of the {len(cameras)} views sees the region of interest at '
            f'{_told(settings.roi_center)} m of size {_told(settings.roi_size)} m in the frame '
            f'{frame_id!r}: {_why_unseen(cameras, settings.roi_center)}')
    return seen


def windows_before(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                   settings: PmclSettings, radius: float, frame_id: str) -> dict[int, Window]:
    """What the object can cover of each picture that sees the region, as `regions_before`."""
    seen = regions_before(cameras, settings, radius, frame_id)
    return {number: region.window(cameras[number][0], radius) for number, region in seen.items()}


def out_of_view(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]], settings: PmclSettings,
                radius: float) -> dict[int, str]:
    """Why cameras do not see the region of interest, by their numbers, as `regions_before`."""
    return _before(cameras, settings, radius)[1]


def _before(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]], settings: PmclSettings,
            radius: float) -> tuple[dict[int, Region], dict[int, str]]:
    seen, unseen = {}, {}
    for number, (pinhole, camera) in enumerate(cameras):
        try:
            region = Region.before_camera(camera, settings.roi_center, settings.roi_size)
            region.window(pinhole, radius)
        except LocalizationError as error:
            unseen[number] = str(error)
        else:
            seen[number] = region
    return seen, unseen


def _told(values: Sequence[float]) -> str:
    return f'({", ".join(f"{each:.3g}" for each in values)})'


def _why_unseen(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                center: tuple[float, float, float]) -> str:
    """The likely reason why no camera sees a region with this middle, or a question."""
    if any(sees(*each, center) for each in cameras):
        return ('its middle is in view, but it reaches to the cameras or behind them: make it '
                'smaller')
    odd = next((each for each, _ in cameras if each.off_middle > 0.5), None)
    return likely_mistake(cameras, center) if odd is None else (
        f'the principal point ({odd.cx:g}, {odd.cy:g}) is outside of {odd.width}x{odd.height} px: '
        'is the calibration of another resolution?')


def size_in_view(diameter: float, center: tuple[float, float, float], pinhole: Pinhole,
                 camera: NDArray[np.float64]) -> float:
    """How large an object in the middle of a region is in a camera's picture [px].

    diameter: of the object. center: of the region, in the reference frame of the camera (4, 4)
    [m]. 0 behind the camera.
    """
    depth = float((np.array(center) - camera[:3, 3]) @ camera[:3, 2])
    return max(pinhole.fx, pinhole.fy) * diameter / depth if depth > 0 else 0.0


def with_region(settings: Given, cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]],
                radius: float) -> Given:
    """Settings with the box that `roi_depths` and `roi_table` mean in the views of some cameras.

    It holds all places that all of the cameras see. A table's normal is the `roi_up` that was not
    given. cameras: each with its pose (4, 4)
    in the reference frame. radius: of the object, whose origin is at most this high above a table
    [m]. Raises LocalizationError where there is no such place.
    """
    if not settings.region_in_view:
        return settings
    near, far = settings.roi_depths if any(settings.roi_depths) else _REACH
    places = _seen_by_all(cameras, near, far, settings.roi_table, radius)
    if not len(places):
        table = f' on the table {settings.roi_table}' if any(settings.roi_table) else ''
        questions = [f'{mistake} there is one' for mistake, mended in without_mistakes(cameras)
                     if len(_seen_by_all(mended, near, far, settings.roi_table, radius))]
        raise LocalizationError(
            f'no place {near:g} to {far:g} m away{table} is in view of all {len(cameras)} '
            'cameras; ' + '; '.join(
                questions or ['are depths and table right? Else give the box']))
    low, high = places.min(axis=0), places.max(axis=0)
    upright = settings.is_oriented and not any(settings.roi_up)
    return settings.model_copy(update={
        'roi_up': settings.roi_table[3:] if upright else settings.roi_up,
        'roi_center': tuple(((low + high) / 2).tolist()), 'roi_size': tuple((high - low).tolist()),
        'roi_depths': (0.0, 0.0), 'roi_table': (0.0,) * 6})


def _seen_by_all(cameras: Sequence[tuple[Pinhole, NDArray[np.float64]]], near: float, far: float,
                 table: tuple[float, ...], radius: float) -> NDArray[np.float64]:
    """(n, 3) places where the object's origin may be that all of the cameras see."""
    places = np.concatenate([_places(*each, near, far, table, radius) for each in cameras])
    for each in cameras:
        places = places[_in_view(*each, places, near, far)]
    return places


def _places(pinhole: Pinhole, camera: NDArray[np.float64], near: float, far: float,
            table: tuple[float, ...], radius: float) -> NDArray[np.float64]:
    """(n, 3) places all over a camera's view where the object's origin may be."""
    across, down = (np.linspace(-0.5, count - 0.5, _RAYS)
                    for count in (pinhole.width, pinhole.height))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    rays = pinhole.rays(pixels) @ camera[:3, :3].T
    begin, end = np.full(len(rays), near), np.full(len(rays), far)
    if any(table):
        up = np.array(table[3:]) / np.linalg.norm(table[3:])
        above, slope = (camera[:3, 3] - table[:3]) @ up, rays @ up
        slope = np.where(slope == 0, 1e-12, slope)
        ends = (np.array([[-_SLACK], [radius + _SLACK]]) - above) / slope
        begin, end = np.maximum(begin, ends.min(axis=0)), np.minimum(end, ends.max(axis=0))
    hit = begin <= end
    depths = np.linspace(begin[hit], end[hit], _STEPS)
    return np.asarray((camera[:3, 3] + depths[..., None] * rays[hit]).reshape(-1, 3))


def _in_view(pinhole: Pinhole, camera: NDArray[np.float64], places: NDArray[np.float64],
             near: float, far: float) -> NDArray[np.bool_]:
    """(n,) which of places (n, 3) a camera sees, its borders included."""
    seen = (places - camera[:3, 3]) @ camera[:3, :3]
    off = np.abs(pinhole.project(seen) - (np.array([pinhole.width, pinhole.height]) - 1) / 2)
    inside = (off <= np.array([pinhole.width, pinhole.height]) / 2 + 1e-6).all(axis=1)
    return np.asarray(inside & (seen[:, 2] >= near - 1e-9) & (seen[:, 2] <= far + 1e-9))
