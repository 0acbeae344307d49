"""The stereo pairs of posed views: the reference view and each other."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.dlv.pairs import gradient_share
from pmcl_ros.dlv.pixel_grid import PixelGrid
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.runtime.errors import VolumeError

_ACROSS, _ALONG = 5, 33  # rays each way, and places along each, that tell how far views move


@dataclass(frozen=True)
class PosedPairs:
    """Views that the reference view is compared with.

    number: of the reference view, among all. others: the views without it. pixels: those of the
    reference view that get a volume.
    """

    number: int
    reference: PosedView
    others: tuple[PosedView, ...]
    pixels: PixelGrid

    @classmethod
    def from_views(cls, views: PosedViews, crop: tuple[int, int, int, int], stride: int,
                   reference: int | None = None) -> 'PosedPairs':
        """reference: number of the view; None: the `central` one.

        crop, stride: as of `PixelGrid.from_crop`. Raises VolumeError where there is one view only,
        or none of that number, or the crop is not in it.
        """
        count = len(views.views)
        if count < 2:
            raise VolumeError('there is one view only: a depth likelihood needs two or more')
        number = central(views) if reference is None else reference
        if not 0 <= number < count:
            raise VolumeError(f'there is no view {number} to be the reference of a volume: there '
                              f'are {count}, counted from 0')
        view = views.views[number]
        others = views.views[:number] + views.views[number + 1:]
        return cls(number, view, others, PixelGrid.from_crop(view.pinhole, crop, stride))

    @property
    def gamma(self) -> NDArray[np.float64]:
        """(pairs,) `gradient_share`, by where the cameras are."""
        return gradient_share(self._cameras[:, :2, 3])

    def homographies(self, depths: NDArray[np.floating]) -> NDArray[np.float64]:
        """(pairs, labels, 3, 3) by which planes across the reference camera at `depths` [m] map.

        A pixel (x, y, 1) of the reference view is seen at (u, v, 1) times a third coordinate,
        which is positive before a camera.
        """
        into = np.linalg.inv(self._cameras)[:, None]
        inverse = 1 / np.asarray(depths, float)[:, None, None]
        planes = into[..., :3, :3] + inverse * into[..., :3, 3:] * np.array([0, 0, 1.0])
        matrices = np.array([each.pinhole.matrix for each in self.others])[:, None]
        return np.asarray(matrices @ planes @ np.linalg.inv(self.reference.pinhole.matrix))

    def labels_needed(self, near: float, far: float) -> int:
        """How many labels from `near` to `far` [m] it takes for no view to move by more than 1 px
        from one to the next: between coarser ones, matches are missed."""
        x, y = (np.linspace(each[0], each[-1], _ACROSS)
                for each in (self.pixels.columns, self.pixels.rows))
        rays = np.stack([*np.meshgrid(x, y), np.ones((_ACROSS, _ACROSS))]).reshape(3, -1)
        maps = self.homographies(1 / np.linspace(1 / far, 1 / near, _ALONG))
        seen = np.moveaxis(maps @ rays, 2, -1)  # (pairs, places along rays, rays, 3)
        places = seen[..., :2] / np.where(seen[..., 2:] > 0, seen[..., 2:], np.nan)
        ends = np.array([(each.pinhole.width, each.pinhole.height) for each in self.others])
        inside = ((places >= 0) & (places < ends[:, None, None])).all(axis=-1)
        steps = np.abs(np.diff(places, axis=1)).max(axis=-1)[inside[:, 1:] & inside[:, :-1]]
        return int(np.ceil(steps.max(initial=0) * (_ALONG - 1))) + 1

    def within_reach(self, pixels: PixelGrid, depths: NDArray[np.floating], margin: int
                     ) -> 'PosedPairs':
        """The others cut to where they see `pixels` at `depths` [m], and `margin` px around that.

        A view stays whole where some of these points are behind its camera.
        """
        corners = np.array([[x, y, 1] for x in pixels.columns[[0, -1]]
                            for y in pixels.rows[[0, -1]]])
        seen = self.homographies(depths) @ corners.T  # (pairs, labels, 3, corners)
        cut = []
        for view, places in zip(self.others, np.moveaxis(seen, 2, -1), strict=True):
            size = np.array([view.pinhole.width, view.pinhole.height])
            before = places[..., 2] > 0
            if not before.any():
                view = view.crop(0, 0, 1, 1)
            elif before.all():
                ends = (places[..., :2] / places[..., 2:]).reshape(-1, 2)
                low = np.clip(np.floor(ends.min(axis=0)) - margin, 0, size - 1).astype(int)
                high = np.clip(np.ceil(ends.max(axis=0)) + 1 + margin, low + 1, size).astype(int)
                view = view.crop(*low.tolist(), *(high - low).tolist())
            cut.append(view)
        return replace(self, others=tuple(cut))

    @property
    def _cameras(self) -> NDArray[np.float64]:
        """(pairs, 4, 4) of the others, in the frame of the reference camera."""
        poses = np.array([each.camera_to_reference for each in self.others])
        return np.asarray(np.linalg.inv(self.reference.camera_to_reference) @ poses)


def central(views: PosedViews) -> int:
    """The number of the view whose camera is the nearest to those of all others, in sum.

    It sees most of what the others see, and from the least different sides. Places [m] and
    directions count alike: as is so for something a metre away.
    """
    poses = np.array([each.camera_to_reference for each in views.views])
    apart = sum(np.linalg.norm(part[:, None] - part, axis=2)
                for part in (poses[:, :3, 3], poses[:, :3, 2]))
    return int(np.argmin(np.sum(apart, axis=1)))
