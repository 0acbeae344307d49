"""Described surroundings and the shadows of lamps, by path tracing beside the own renderer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from numpy.typing import NDArray
from plain_scenes import WHITE, plain_scene, plain_sensor, pose_at

from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.described.surroundings import (
    DescribedSettings,
    Surroundings,
    described_scene,
)
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.path_tracing.render import physical
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.materials import Opaque
from pmcl_ros.simulation.scenes.render import fast, first_surfaces
from pmcl_ros.simulation.scenes.scene import Scene, Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.world import World

CAMERA = OrdinaryCamera(width=64, height=48, fx=80.0, cx=31.5, cy=23.5)


def share_of_red(light: NDArray[np.float32]) -> NDArray[np.float32]:
    return np.asarray(light[..., 0] / np.maximum(light.sum(axis=-1), 1e-6))


@pytest.mark.parametrize('where', ['shelf', 'sink', 'tank', 'clutter'])
def test_the_object_is_in_path_traced_surroundings(tmp_path: Path, where: Surroundings) -> None:
    trimesh.creation.box(bounds=[[-0.03, -0.03, 0], [0.03, 0.03, 0.09]]).export(
        tmp_path / 'block.stl')
    path = tmp_path / 'block.yaml'
    path.write_text(yaml.safe_dump({'mesh': 'block.stl', 'scale': 1.0, 'appearance': {
        'material': 'opaque', 'colour': [0.6, 0.02, 0.02]}}))
    rng = np.random.default_rng(4)
    scene = described_scene(rng, load_object(path), where, CAMERA.sensor(rng),
                            DescribedSettings(attitude='upright', empty=0, outside=0))
    alone = replace(scene, solids=scene.solids[:1], owners=(0,))  # as water hides what is in it
    shows = first_surfaces(World.from_scene(alone), CAMERA.pinhole, np.zeros(1, np.int64))[0] == 0
    own, traced = (share_of_red(make(scene)(scene.sensor, 0, 0, 0, samples, 1))
                   for make, samples in ((fast, 4), (physical, 2)))
    assert shows.sum() > 100
    # By two paths a pixel, and in the tank behind a film, its red is still by far the deepest.
    assert np.median(traced[shows]) > np.median(traced[~shows]) + 0.2
    assert np.median(own[shows]) > np.median(own[~shows]) + 0.2
    assert np.median(traced[~shows]) == pytest.approx(np.median(own[~shows]), abs=0.03)


def lamp_lit(*solids: Solid) -> Scene:
    """Seen from above: a white sheet 0.5 m away, a lamp aside by 45 degrees, a dim room."""
    rows = 128
    size = np.pi / rows
    unlit = np.full((rows, 2 * rows, 3), 0.2, np.float32)
    panorama = unlit.copy()
    first, column = rows // 4 - 2, rows - 2  # of four by four texels about azimuth 0
    panorama[first:first + 4, column:column + 4] = 400
    lamp = [first * size, (first + 4) * size, -2 * size, 4 * size, 400, 400, 400]
    sheet = Sheet(pose_at(0, 0, 0.5), (4.0, 4.0), WHITE, 0.1)
    return replace(plain_scene(solids, (sheet,), sensor=plain_sensor(80, 3, 160.0, 0.0, 1e-6)),
                   environment=Environment(panorama, np.array([lamp]), unlit),
                   world_from_camera=np.diag([1.0, -1.0, -1.0]))


def test_a_lamps_shadow_is_that_of_the_own_renderer() -> None:
    """A black ball's, 0.06 m above the sheet: so far aside as the lamp's 45 degrees say."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 60)
    profile = 0.01 * np.stack([np.abs(np.cos(turn)), np.sin(turn)], axis=1)
    ball = Solid(Frusta.from_profile(profile, 0, 1), (Opaque(np.zeros_like(WHITE)),),
                 pose_at(0, 0, 0.44))
    v, u = np.mgrid[:80, :80]
    beside = np.hypot(v - 39.5, u - 39.5) > 8  # of the ball
    found = []
    for make, samples in ((fast, 16), (physical, 128)):
        bare, light = (make(scene)(scene.sensor, 1, 1, 0, samples, 1).mean(axis=2)
                       for scene in (lamp_lit(), lamp_lit(ball)))
        dark = np.where(beside, 1 - light / bare, 0)
        dark[dark < 0.1] = 0
        middle = (dark * u).sum() / dark.sum(), (dark * v).sum() / dark.sum()
        np.testing.assert_allclose(middle, [39.5 - 0.06 * 320, 39.5], atol=0.1)
        found.append([bare.mean(), dark.max(), dark.sum()])
    np.testing.assert_allclose(found[1], found[0], rtol=0.04)
