"""Pictures of two textured planes, one before the other, by cameras around them."""

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView

PINHOLE = Pinhole(320, 240, 300.0, 300.0, 160.0, 120.0)
MIDDLE = np.array([0, 0, 0.6])  # m, of what is seen
_PIXEL = 0.001  # m, of the textures
_PLANES = ((0.75, np.array([-0.5, -0.5])), (0.5, np.array([0.0, -0.5])))  # depth, corner [m]


def around(angles):
    """Cameras (n, 4, 4) on an arc about `MIDDLE`."""
    cameras = np.tile(np.eye(4), (len(angles), 1, 1))
    turns = Rotation.from_rotvec(np.deg2rad(angles)[:, None] * [0.1, 1, 0]).as_matrix()
    cameras[:, :3, :3] = turns
    cameras[:, :3, 3] = MIDDLE - turns @ MIDDLE
    return cameras


def views_of_planes(cameras, told=None, seed=0, contrast=1.0):
    """Posed views by cameras (n, 4, 4); told: the poses that they have, if not the same."""
    rng = np.random.default_rng(seed)
    textures = [_texture(rng, contrast) for _ in _PLANES]
    views = []
    for camera, pose in zip(cameras, cameras if told is None else told, strict=True):
        picture = np.full((PINHOLE.height, PINHOLE.width), 0.5, np.float32)
        before = np.linalg.inv(camera)
        for texture, (depth, corner) in zip(textures, _PLANES, strict=True):
            # Pixels (u, v, 1) of the texture -> points of the plane -> pixels of the camera.
            points = before[:3, :3] @ [[_PIXEL, 0, corner[0]], [0, _PIXEL, corner[1]],
                                       [0, 0, depth]]
            points[:, 2] += before[:3, 3]
            cv2.warpPerspective(texture, PINHOLE.matrix @ points, (PINHOLE.width, PINHOLE.height),
                                dst=picture, borderMode=cv2.BORDER_TRANSPARENT)
        picture = (picture + rng.normal(0, 0.005, picture.shape)).clip(0, 1)
        views.append(PosedView(Header(7, 'base'), np.repeat(
            picture[..., None], 3, axis=2).astype(np.float32), PINHOLE, pose))
    return views


def _texture(rng, contrast):
    noise = cv2.GaussianBlur(rng.normal(size=(1000, 1000)), (0, 0), 2.5)
    return (0.5 + contrast * 0.2 * noise / noise.std()).clip(0, 1).astype(np.float32)
