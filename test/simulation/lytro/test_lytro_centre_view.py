"""The centre view of a simulated Lytro, rendered directly, beside that of its raw picture."""

import functools
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.simulation.lytro.calibration_pictures import white_picture
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.lytro.centre_view import centre_view
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.manipulation.camera_kinds import WIDE_F01
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.rays import fast_along
from pmcl_ros.simulation.scenes.scene import Scene, Sheet
from pmcl_ros.simulation.scenes.textures import random_texture

CAMERA = LytroCamera.make(WIDE_F01.model_dump() | {'width': 400, 'height': 400})
QUIET = LytroCamera.make(CAMERA.model_dump() | {'electrons': 1e7, 'read': 0})
SPOT = np.array([0.012, -0.008, 0.45])


def room(*sheets: Sheet) -> Scene:
    """Sheets in an even, bright room."""
    return Scene('room', (), sheets, Environment(np.ones((8, 16, 3), np.float32)), np.eye(3),
                 CAMERA.sensor(np.random.default_rng(3)), (), ())


@functools.cache
def decoder() -> Decoder:
    """Of both cameras."""
    return Decoder(QUIET.calibration, white_picture(QUIET, np.random.default_rng(0), 16))


def both(camera: LytroCamera, scene: Scene, seed: int = 1, samples: int = 16
         ) -> tuple[np.ndarray, np.ndarray]:
    """The picture by way of the raw one, and directly; without the edge, that few pixels make."""
    scene = replace(scene, sensor=camera.sensor(np.random.default_rng(3)))
    raw = raw_picture(camera, fast_along(scene), np.random.default_rng(seed), samples,
                      scene.sensor.level)
    direct = centre_view(scene, camera, np.random.default_rng(seed), 4 * samples)
    return tuple(each[2:-2, 2:-2].astype(float) for each in (decoder().decode(raw).picture(),
                                                             direct))


def test_it_shows_what_the_raw_picture_shows() -> None:
    texture = random_texture(np.random.default_rng(3), ('leaves',))
    wall = Sheet(pose_of(Rotation.from_rotvec([0.5, 0.2, 0.1]), np.array([0, 0, 0.4])),
                 (0.8, 0.8), texture, 0.06)
    decoded, direct = both(QUIET, room(wall))
    assert decoded.std() > 5  # there is something to see
    assert np.abs(decoded - direct).mean() < 1
    assert np.corrcoef(decoded.ravel(), direct.ravel())[0, 1] > 0.99


def test_its_noise_is_that_of_the_raw_picture() -> None:
    noises = [np.std([a - b for a, b in zip(one, two, strict=True)], axis=(0, 1))
              for one, two in zip(both(CAMERA, room(), 1, 4), both(CAMERA, room(), 2, 4),
                                  strict=True)]
    np.testing.assert_allclose(noises[1], noises[0], rtol=0.15)


def test_the_pinhole_projects_a_point_to_where_both_show_it() -> None:
    dark = Sheet(pose_of(Rotation.identity(), SPOT), (0.006, 0.006),
                 np.zeros((8, 8, 3), np.float32), 1.0)
    fx, fy, cx, cy = (getattr(CAMERA.calibration, each) for each in ('fx', 'fy', 'cx', 'cy'))
    expected = fx * SPOT[0] / SPOT[2] + cx, fy * SPOT[1] / SPOT[2] + cy
    for picture in both(CAMERA, room(dark)):
        grey = picture.mean(axis=-1)
        missing = np.where(grey < grey.max() / 2, grey.max() - grey, 0)
        v, u = np.indices(grey.shape) + 2  # of the edge
        found = (u * missing).sum() / missing.sum(), (v * missing).sum() / missing.sum()
        np.testing.assert_allclose(found, expected, atol=0.2)


def test_a_zoomed_out_f01_is_39_degrees_wide() -> None:
    assert np.degrees(2 * np.arctan(WIDE_F01.field / 2)) == pytest.approx(39, abs=0.5)
    assert (WIDE_F01.calibration.width, WIDE_F01.calibration.height) == (328, 328)
