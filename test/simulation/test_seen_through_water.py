"""The renderer of scenes and the one that scores poses agree on what shows through water."""

import numpy as np
import pytest
import trimesh
from plain_scenes import WHITE, plain_scene, plain_sensor, pose_at
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.interface import Interface
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.simulation.described.place import Frame
from pmcl_ros.simulation.described.substances import WATER
from pmcl_ros.simulation.described.water import submerged
from pmcl_ros.simulation.scenes.materials import Opaque
from pmcl_ros.simulation.scenes.render import fast
from pmcl_ros.simulation.scenes.scene import Solid
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles


def test_a_ball_under_water_shows_where_the_interface_says():
    # A world whose z is up, 0.5 m in front of a camera that looks down at 40 degrees.
    world = pose_of(Rotation.from_euler('x', 180 - 50, degrees=True), np.array([0, 0.02, 0.5]))
    frame = Frame(world)
    water = frame.box(np.array([-2.0, -2, -0.5]), np.array([2.0, 2, 0]), WATER)
    floor = frame.level((-3, -3), (3, 3), -0.12, WHITE, 1.0)
    interface = Interface(world[:3, 3][None], world[:3, 2][None], WATER.index)
    found, expected, dry = _ball(world @ pose_at(0.01, 0.02, -0.06), water, floor, interface)
    np.testing.assert_allclose(found[:2], expected[:2], atol=0.1)  # px
    np.testing.assert_allclose(found[2:], expected[2:], rtol=0.01)
    assert abs(dry[1] - found[1]) > 3  # without the interface it is rows away


@pytest.mark.parametrize('height', [-0.05, 0.004], ids=['below the surface', 'just above it'])
def test_a_ball_in_a_tank_shows_through_the_front(height):
    # The camera looks 8 degrees down, from `height` above the surface, at a front 0.3 m ahead,
    # which it does not face squarely.
    tilt = Rotation.from_euler('XZ', [180 - 82, 20], degrees=True)
    world = pose_of(tilt, np.zeros(3))
    up, front, level = world[:3, 2], -world[:3, 1], -height
    frame = Frame(world)
    water = frame.box(np.array([-1.0, 0.3, -0.5]), np.array([1.0, 1.0, level]), WATER)
    back = frame.across_y((-3, 3), 1.5, (-1.0, 1.0), WHITE, 1.0)
    interface = Interface(np.stack([level * up, -0.3 * front]), np.stack([up, front]), WATER.index)
    where = world @ pose_at(0.16, 0.42, level - 0.08)
    found, expected, dry = _ball(where, water, back, interface)
    np.testing.assert_allclose(found[:2], expected[:2], atol=0.1)  # px
    np.testing.assert_allclose(found[2:], expected[2:], rtol=0.01)
    assert np.linalg.norm(dry[:2] - found[:2]) > 3


def _ball(where, water, behind, interface):
    """A black ball in water: `_moments` of what the renderer of scenes shows, of what is
    expected, of what would be without the interface.
    """
    sensor = plain_sensor(size=160, views=1, fx=260.0)
    ball = trimesh.creation.icosphere(4, 0.04)
    black = Solid(Triangles(np.array(ball.triangles), 0, 1), (Opaque(0 * WHITE, 1.0),), where)
    light = fast(plain_scene((water, submerged(black)), (behind,), sensor=sensor))(
        sensor, 0, 0, 0, 16, 1)[..., 1]
    shown = (light < (np.median(light) + light.min()) / 2).astype(float)
    model = ObjectModel('ball', np.asarray(ball.vertices), np.asarray(ball.faces), None, True)
    camera = sensor.grid.pinhole

    def outline_of(through):
        window = Window(0, 0, (camera.width, camera.height))
        drawn = Scene(model, camera, window, 0.1, 1.0, through)
        return (NumbaRenderer().depths(drawn, where[None])[0] > 0).astype(float)

    return [_moments(each) for each in (shown, outline_of(interface), outline_of(None))]


def _moments(mask):
    """Centre (x, y) and widths of what a mask covers [px]."""
    rows, columns = np.indices(mask.shape)
    total = mask.sum()
    x, y = (columns * mask).sum() / total, (rows * mask).sum() / total
    spread = [np.sqrt(((each - middle) ** 2 * mask).sum() / total)
              for each, middle in ((columns, x), (rows, y))]
    return np.array([x, y, *spread])
