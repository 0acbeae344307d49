"""PosedViews: `posed_views`, and its `camera_info`, `poses` and `sigma`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.messages.camera_info import pinhole_from, pinhole_to_message
from pmcl_ros.messages.header import check_same, header_from, header_to_message, promised_by
from pmcl_ros.messages.image import image_message, pixels_of
from pmcl_ros.messages.pose import poses_from, poses_to_messages
from pmcl_ros.messages.types import Buffer, CameraInfo, Image, PoseArray
from pmcl_ros.runtime.errors import MessageError

_WHITE = 65535  # count of a picture's 1: of 16 bits


class PosedViewsMessages(NamedTuple):
    """The four messages, in the order in which they are published."""

    camera_info: CameraInfo
    poses: PoseArray
    sigma: Image
    views: Image


def posed_views_to_messages(views: PosedViews) -> PosedViewsMessages:
    """Some views of one scene. All have the stamp of the last, and the reference frame.

    posed_views: rgb16, the pictures one below the other, gamma encoded, 65535 at white. Where a
        view has a mask: rgba16, alpha 0 where a mask is False, else 65535.
    camera_info: the pinhole of each, that of the first view; pictures of other pinholes are
        resampled to it.
    poses: of the cameras' optical frames in the reference frame.
    sigma: 32FC5, a row for each view: standard deviations of its pose's position [m] and rotation
        [rad], the share of their variance that is common to its group, the group's number, from 1
        (0: the view has no group), and the standard deviation by which the object may have moved
        since [m].
    """
    return PosedViewsMessages(info_to_message(views), poses_to_message(views),
                              sigma_to_message(views), mosaic_to_message(views))


def info_to_message(views: PosedViews) -> CameraInfo:
    """`posed_views/camera_info` alone."""
    return pinhole_to_message(views.header, views.views[0].pinhole)


def poses_to_message(views: PosedViews) -> PoseArray:
    """`posed_views/poses` alone."""
    return PoseArray(header=header_to_message(views.header), poses=poses_to_messages(
        np.array([each.camera_to_reference for each in views.views])))


def sigma_to_message(views: PosedViews) -> Image:
    """`posed_views/sigma` alone."""
    message, rows = image_message(views.header, '32FC5', (len(views.views), 1), None)
    names = list(dict.fromkeys(each.group for each in views.views if each.group))
    rows[:, 0] = [(*each.sigma, each.common, names.index(each.group) + 1 if each.group else 0,
                   each.drift) for each in views.views]
    return message


def mosaic_to_message(views: PosedViews, buffer: Buffer | None = None) -> Image:
    """`posed_views` alone."""
    pinhole = views.views[0].pinhole
    masked = any(each.mask is not None for each in views.views)
    message, mosaic = image_message(
        views.header, 'rgba16' if masked else 'rgb16',
        (len(views.views) * pinhole.height, pinhole.width), buffer)
    tiles = mosaic.reshape(-1, pinhole.height, pinhole.width, 4 if masked else 3)
    for tile, view in zip(tiles, views.views, strict=True):
        lens = Lens(view.pinhole)
        tile[..., :3] = np.rint(lens.undistorted(view.picture, pinhole) * np.float32(_WHITE))
        if masked:
            tile[..., 3] = _WHITE * (1 if view.mask is None else lens.undistorted_mask(
                view.mask, pinhole))
    return message


def posed_views_from(camera_info: CameraInfo, poses: PoseArray, sigma: Image, views: Image
                     ) -> PosedViews:
    """The inverse of `posed_views_to_messages`: four messages of one capture.

    MessageError where they contradict each other.
    """
    header = header_from(views.header)
    for name, other in (('camera_info', camera_info), ('poses', poses), ('sigma', sigma)):
        check_same(f'posed_views/{name}', header_from(other.header), header)
    pinhole = pinhole_from(camera_info)
    cameras, rows, mosaic = cameras_from(poses), sigmas_from(sigma), mosaic_from(views)
    expected = len(cameras) * pinhole.height, pinhole.width
    if mosaic.shape[:2] != expected or len(rows) != len(cameras):
        raise MessageError(
            f'posed_views is {mosaic.shape[1]}x{mosaic.shape[0]} px with {len(rows)} rows of '
            f'posed_views/sigma; {len(cameras)} poses (posed_views/poses) of '
            f'{pinhole.width}x{pinhole.height} px (posed_views/camera_info) make '
            f'{expected[1]}x{expected[0]} and {len(cameras)} rows')
    tiles = mosaic.reshape(-1, pinhole.height, pinhole.width, mosaic.shape[2])
    with promised_by('posed_views'):
        return PosedViews(tuple(
            PosedView(header, tile[..., :3].astype(np.float32) / np.float32(_WHITE), pinhole,
                      camera, (position, rotation), f'group {number:.0f}' if number else '',
                      common, drift, f'view {place}', _mask_of(tile))
            for place, (tile, camera, (position, rotation, common, number, drift))
            in enumerate(zip(tiles, cameras, rows.astype(float).tolist(), strict=True))))


def cameras_from(message: PoseArray) -> NDArray[np.float64]:
    """(n, 4, 4) of a `posed_views/poses` message; MessageError where there is none."""
    if not message.poses:
        raise MessageError('posed_views/poses holds no pose; expected one for each view')
    return poses_from(message.poses, 'posed_views/poses')


def sigmas_from(message: Image) -> NDArray[np.float32]:
    """(n, 5) of a `posed_views/sigma` message, as `posed_views_to_messages` says.

    32FC4, of bags of former versions, lacks the last number: the object rests.
    """
    former = message.encoding == '32FC4'
    rows = pixels_of(message, '32FC4' if former else '32FC5', 'posed_views/sigma')
    if former:
        rows = np.pad(rows, ((0, 0), (0, 0), (0, 1)))
    if rows.shape[1] != 1:
        raise MessageError(f'posed_views/sigma has {rows.shape[1]} columns; expected one, and a '
                           'row for each view')
    if not (np.isfinite(rows).all() and (rows >= 0).all() and (rows[..., 2] <= 1).all()
            and (rows[..., 3] % 1 == 0).all()):
        raise MessageError('posed_views/sigma holds NaN, infinity, a negative number, a share '
                           'above 1 or half a group; expected sigmas [m, rad], a share, the '
                           'whole number of a group and a drift [m]')
    return np.asarray(rows[:, 0])


def mosaic_from(message: Image) -> NDArray[np.uint16]:
    """(n * height, width, 3 or, with masks, 4) of a `posed_views` message, not copied."""
    return pixels_of(message, 'rgba16' if message.encoding == 'rgba16' else 'rgb16',
                     'posed_views')


def _mask_of(tile: NDArray[np.uint16]) -> NDArray[np.bool_] | None:
    """Of a view (height, width, 3 or 4); None where nothing is left out."""
    mask = np.asarray(tile[..., 3:].any(axis=2))
    return None if tile.shape[2] < 4 or mask.all() else mask
