"""A vessel of a known profile, and three exactly drawn pictures of it."""

import cv2
import numpy as np
import pytest
import trimesh

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
    return Revolution.from_curve(frame, heights, radius(heights), 40)


@pytest.fixture(scope='session')
def vessel(true_surface):
    wall = true_surface.wall
    profile = np.concatenate([[[0, wall[0, 1]]], wall, [[0, wall[-1, 1]]]])
    mesh = trimesh.creation.revolve(profile, sections=128)
    return ObjectModel('vessel', np.asarray(mesh.vertices), np.asarray(mesh.faces), UP, True)


@pytest.fixture(scope='session')
def masks(vessel):
    """Of three views over 60 degrees: (zoomed height, zoomed width) what the vessel covers."""
    pose = np.eye(4)
    pose[:3, 3] = PLACE
    return [silhouette(PINHOLE, vessel, np.linalg.inv(camera(azimuth)) @ pose, _ZOOM)
            for azimuth in (-0.5, 0.0, 0.5)]


@pytest.fixture(scope='session')
def views(masks):
    shown = []
    for mask, azimuth in zip(masks, (-0.5, 0.0, 0.5), strict=True):
        picture = np.where(mask[..., None], np.float32([0.25, 0.3, 0.2]),
                           np.float32([0.7, 0.7, 0.75]))
        picture = cv2.resize(picture, (PINHOLE.width, PINHOLE.height),
                             interpolation=cv2.INTER_AREA)
        shown.append(PosedView(Header(frame_id='base'), picture, PINHOLE, camera(azimuth)))
    return shown


@pytest.fixture(scope='session')
def boxes(masks):
    """About the vessel in the first and the last view, some pixels off."""
    found = {}
    for number in (0, 2):
        rows, columns = (np.flatnonzero(masks[number].any(axis=axis)) / _ZOOM for axis in (1, 0))
        found[number] = (columns[0] - 3.0, rows[0] - 2.0, np.ptp(columns) + 4, np.ptp(rows) + 5)
    return found
