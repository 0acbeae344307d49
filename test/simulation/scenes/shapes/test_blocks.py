"""Blocks with sharp edges, and the symmetries they are said to have."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.simulation.files import write_capture
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import render
from pmcl_ros.simulation.scenes.shapes.blocks import BLOCKS, random_block


@pytest.mark.parametrize('glass', [True, False])
def test_blocks_are_closed_and_look_as_their_symmetries_say(glass):
    rng = np.random.default_rng(3)
    names = set()
    for _ in range(30):
        thing = random_block(rng, glass)
        names.add(thing.name)
        mesh = trimesh.Trimesh(thing.vertices, thing.faces, process=False)
        assert mesh.is_volume
        assert mesh.volume > 0
        assert 0.04 < np.linalg.norm(mesh.extents) < 0.25
        np.testing.assert_array_equal(thing.discrete[0], np.eye(4))
        corners = cKDTree(thing.vertices)
        for each in thing.discrete:
            moved = thing.vertices @ each[:3, :3].T + each[:3, 3]
            assert corners.query(moved)[0].max() < 1e-6
        triangles = thing.solids[0].surface.corners
        whole = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(
            -1, 3))
        assert whole.is_watertight
        # A wall leaves less than the whole.
        assert (whole.volume < 0.98 * mesh.volume) == thing.name.startswith('hollow')
    assert len(names) == (7 if glass else len(BLOCKS))


def test_a_block_is_written_with_its_symmetries(tmp_path):
    settings = SceneSettings(views=3, size=16, clutter=0, kinds=('opaque block', 'glass block'))
    written = 0
    for seed in (1, 2):
        rng = np.random.default_rng(seed)
        scene = random_scene(rng, settings)
        target = scene.targets[0]
        capture = render(scene, rng, 1)
        write_capture(tmp_path / str(seed), scene, capture, seed)
        described = tmp_path / str(seed) / 'model.yaml'
        assert described.exists() == (len(target.discrete) > 1)
        assert len(capture.model(0).discrete) == len(target.discrete)
        if described.exists():
            written += 1
            model = ObjectModel.load(described)
            assert model.axis is None
            assert len(model.discrete) == len(target.discrete)
            assert len(Creases.from_model(model).ends) >= 9
    assert written == 1
