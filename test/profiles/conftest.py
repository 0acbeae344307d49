"""A vessel of a known profile, and three exactly drawn pictures of it."""

import cv2
import numpy as np
import pytest
import trimesh
import yaml

from pmcl_ros.drawing.pictures import silhouette
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.profiles.revolution import Revolution

PINHOLE = Pinhole(400, 360, 420.0, 420.0, 199.5, 179.5)
UP = np.array([0, 0, 1.0])
PLACE = np.array([0.4, -0.1, 0.07])  # m: of the vessel's middle in the reference frame
_ZOOM = 4


def radius(height):
    """Of the vessel, at heights of -0.05 to 0.05 m [m]."""
    return 0.027 + 0.004 * np.sin(50 * height) + 0.06 * height


def camera(azimuth, steep=0.35, distance=0.26):
    """(4, 4) that looks at the vessel from an azimuth [rad]."""
    ahead = -np.array([np.cos(steep) * np.cos(azimuth), np.cos(steep) * np.sin(azimuth),
                       np.sin(steep)])
    right = np.cross(ahead, UP) / np.cos(steep)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    pose[:3, 3] = PLACE - distance * ahead
    return pose


@pytest.fixture(scope='session')
def true_surface():
    frame = np.eye(4)
    frame[:3, 3] = PLACE
    heights = np.linspace(-0.05, 0.05, 60)
    return Revolution.from_curve(frame, heights, radius(heights), 0.0025)


def solid(wall):
    """The model of a closed solid with a wall (n, 2) of radii and heights [m]."""
    profile = np.concatenate([[[0, wall[0, 1]]], wall, [[0, wall[-1, 1]]]])
    mesh = trimesh.creation.revolve(profile, sections=128)
    return ObjectModel('vessel', np.asarray(mesh.vertices), np.asarray(mesh.faces), UP, True)


def masks_of(model, cameras):
    """(zoomed height, zoomed width) each, of what a model at PLACE covers."""
    pose = np.eye(4)
    pose[:3, 3] = PLACE
    return [silhouette(PINHOLE, model, np.linalg.inv(each) @ pose, _ZOOM) for each in cameras]


def pictured(masks, cameras, shade=(0.25, 0.3, 0.2), before=None):
    """Views of what masks cover, before a plain background or on pictures `before`."""
    shown = []
    for number, (mask, each) in enumerate(zip(masks, cameras, strict=True)):
        behind = np.float32([0.7, 0.7, 0.75]) if before is None else cv2.resize(
            before[number].picture, mask.shape[::-1])
        picture = np.where(mask[..., None], np.float32(shade), behind)
        picture = cv2.resize(picture, (PINHOLE.width, PINHOLE.height),
                             interpolation=cv2.INTER_AREA)
        shown.append(PosedView(Header(frame_id='base'), picture, PINHOLE, each))
    return shown


def boxes_about(masks):
    """About what masks cover in the first and the last view, some pixels off."""
    found = {}
    for number in (0, 2):
        rows, columns = (np.flatnonzero(masks[number].any(axis=axis)) / _ZOOM for axis in (1, 0))
        found[number] = (columns[0] - 3.0, rows[0] - 2.0, np.ptp(columns) + 4, np.ptp(rows) + 5)
    return found


@pytest.fixture(scope='session')
def vessel(true_surface):
    return solid(true_surface.wall)


@pytest.fixture(scope='session')
def masks(vessel):
    """Of three views over 60 degrees."""
    return masks_of(vessel, [camera(azimuth) for azimuth in (-0.5, 0.0, 0.5)])


@pytest.fixture(scope='session')
def views(masks):
    return pictured(masks, [camera(azimuth) for azimuth in (-0.5, 0.0, 0.5)])


@pytest.fixture(scope='session')
def boxes(masks):
    return boxes_about(masks)


@pytest.fixture(scope='session')
def folder(views, tmp_path_factory):
    """The views on disk, with views.yaml."""
    path = tmp_path_factory.mktemp('views')
    for number, view in enumerate(views):
        cv2.imwrite(str(path / f'{number}.png'), view.displayed()[..., ::-1])
    of = PINHOLE
    (path / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'arm': {'fx': of.fx, 'fy': of.fy, 'cx': of.cx, 'cy': of.cy,
                            'width': of.width, 'height': of.height}},
        'reference': 'base',
        'views': [{'file': f'{number}.png', 'camera': 'arm',
                   'camera_to_reference': view.camera_to_reference.ravel().tolist()}
                  for number, view in enumerate(views)]}))
    return path
