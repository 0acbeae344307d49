"""Scenes of several things: all in view, some before others, none in another."""

import numpy as np
import pytest

from pmcl_ros.pmcl.multi_object.penetration import Interior, deepest_penetration
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.prior.region import Region
from pmcl_ros.simulation.scenes.group_scene import group_scene, seen_overlap
from pmcl_ros.simulation.scenes.random_scene import SceneSettings

SETTINGS = SceneSettings(near=0.5, far=0.8)


@pytest.mark.parametrize(('seed', 'count'), [(1007, 3), (1011, 2)])
def test_things_overlap_in_view_and_nowhere_else(seed, count):
    group = group_scene(np.random.default_rng(seed), count, SETTINGS)
    targets, pinhole = group.scene.targets, group.scene.sensor.grid.pinhole
    assert len(targets) == len(group.copies) == count
    assert 0.1 <= seen_overlap(targets, pinhole) <= 0.6
    corner = np.array([pinhole.width, pinhole.height]) - 1
    for each in targets:
        pixels = pinhole.project(each.vertices @ each.pose[:3, :3].T + each.pose[:3, 3])
        assert ((pixels >= 0) & (pixels <= corner)).all()
        assert Region(each.roi_center, each.roi_size).contains(each.pose[None, :3, 3]).all()
    models = [ObjectModel('it', each.vertices, each.faces, each.axis, True) for each in targets]
    solids = [(Interior.from_model(model), each.pose)
              for model, each in zip(models, targets, strict=True)]
    assert deepest_penetration(solids) < 0.0005
    first = {id(each.vertices): k for k, each in reversed([*enumerate(targets)])}
    assert tuple(first[id(each.vertices)] for each in targets) == group.copies


def test_the_same_seed_gives_the_same_scene_and_some_have_copies():
    first, again = (group_scene(np.random.default_rng(1007), 3, SETTINGS) for _ in range(2))
    for one, other in zip(first.scene.targets, again.scene.targets, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
    assert first.copies == (0, 0, 2)
    assert first.scene.targets[0].vertices is first.scene.targets[1].vertices
