"""Proposals of what is in water are where refraction shows it."""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.interface import Interface
from pmcl_ros.pmcl.multi_view.sunken import with_sunken
from pmcl_ros.pmcl.object_model import ObjectModel

TUBE = trimesh.creation.cylinder(0.03, 0.1, sections=24)
MODEL = ObjectModel('tube', np.asarray(TUBE.vertices), np.asarray(TUBE.faces), None, True)
# A front 0.3 m ahead that the camera does not face squarely.
FRONT = Interface(np.array([[0, 0, 0.3]]),
                  Rotation.from_euler('y', 25, degrees=True).as_matrix()[None, :, 2] * -1, 1.333)


def test_where_it_is_appears_where_the_template_fits():
    true = np.tile(np.eye(4), (40, 1, 1))
    rng = np.random.default_rng(0)
    true[:, :3, 3] = rng.uniform([-0.05, -0.05, 0.48], [0.05, 0.05, 0.6], (40, 3))
    true[:, :3, :3] = Rotation.random(40, random_state=1).as_matrix()
    fitted = true.copy()  # a template is rigid: it fits the mean of what is seen
    for pose, shown in zip(true, fitted, strict=True):
        points = MODEL.vertices @ pose[:3, :3].T + pose[:3, 3]
        shown[:3, 3] += (FRONT.apparent(points) - points).mean(axis=0)
    assert np.linalg.norm(fitted[:, :3, 3] - true[:, :3, 3], axis=1).min() > 0.03
    proposed = with_sunken(fitted, MODEL, FRONT)
    np.testing.assert_array_equal(proposed[:40], fitted)
    assert len(proposed) == 80
    off = np.linalg.norm(proposed[40:, :3, 3] - true[:, :3, 3], axis=1)
    assert off.max() < 0.01
    np.testing.assert_array_equal(proposed[40:, :3, :3], true[:, :3, :3])


def test_in_the_air_there_is_nothing_to_add():
    pose = np.eye(4)[None].copy()
    pose[:, 2, 3] = 0.2
    assert len(with_sunken(pose, MODEL, FRONT)) == 1
    assert with_sunken(pose, MODEL, None) is pose
