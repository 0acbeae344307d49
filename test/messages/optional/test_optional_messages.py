"""Detections and collision objects, by the definitions of packages that need not be installed."""

from dataclasses import replace

import numpy as np
import pytest
from optional_types import HASHES, STORE, wired
from pmcl_scenes import bracket, cup, model_of, pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.optional.collision_object import CollisionObjects
from pmcl_ros.messages.optional.detection import estimates_to_detections
from pmcl_ros.messages.pose import poses_from
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode

HEADER = Header(1_700_000_000_123_456_789, 'lytro_optical_frame')
NAMES = ['cup', 'bracket', 'cup_2']
classes = STORE.types.__getitem__


@pytest.fixture(scope='module')
def models():
    """Two copies of a cup, and a bracket whose box is not about its origin."""
    vessel, other = model_of(cup(), name='cup'), bracket()
    other.apply_translation([0.01, -0.02, 0.03])
    return [vessel, model_of(other, name='bracket'), vessel]


@pytest.fixture
def estimates():
    """Of a capture; the first is lost."""
    rng = np.random.default_rng(3)

    def estimate(share, lost=False):
        pose = pose_of(Rotation.random(None, rng), rng.normal(size=3))
        factor = rng.normal(size=(6, 6))
        modes = (PoseMode(pose, share, 1234.5), PoseMode(pose, 1 - share, 1200.0))
        return PoseEstimate(HEADER, pose, factor @ factor.T, pose[None], np.zeros(1), 1234.5, lost,
                            'default', modes if share < 1 else ())

    return [estimate(0.6, lost=True), estimate(0.75), estimate(1.0)]


def corners(message):
    return np.array([[each.x, each.y, each.z] for each in message])


def matrix(pose):
    return poses_from([pose], 'pose')[0]


@pytest.mark.parametrize('name', HASHES)
def test_the_definitions_are_those_of_the_packages(name):
    assert STORE.hash_rihs01(name) == HASHES[name]


def test_detections_are_what_was_found(models, estimates):
    message = wired(estimates_to_detections(classes, NAMES, models, estimates))
    assert header_from(message.header) == HEADER
    assert [(each.id, each.results[0].hypothesis.class_id, each.results[0].hypothesis.score)
            for each in message.detections] == [('bracket', 'bracket', 0.75), ('cup_2', 'cup', 1)]
    for each, model, estimate in zip(message.detections, models[1:], estimates[1:], strict=True):
        assert header_from(each.header) == HEADER
        found, = each.results
        np.testing.assert_allclose(matrix(found.pose.pose), estimate.pose, atol=1e-12)
        np.testing.assert_array_equal(found.pose.covariance.reshape(6, 6), estimate.covariance)
        # the box touches the mesh on each side
        to_box = np.linalg.inv(matrix(each.bbox.center)) @ estimate.pose
        inside = model.vertices @ to_box[:3, :3].T + to_box[:3, 3]
        half = corners([each.bbox.size])[0] / 2
        np.testing.assert_allclose([inside.min(axis=0), inside.max(axis=0)], [-half, half],
                                   atol=1e-12)


def test_no_detection_where_all_are_lost(models, estimates):
    lost = [replace(each, lost=True) for each in estimates]
    message = wired(estimates_to_detections(classes, NAMES, models, lost))
    assert header_from(message.header) == HEADER
    assert message.detections == []


def test_a_collision_object_is_the_mesh_at_its_pose(models, estimates):
    scene = CollisionObjects(classes, NAMES, models, {})
    messages = [wired(each) for each in scene.update(estimates)]
    assert [(each.id, each.type.key) for each in messages] == [
        ('bracket', 'bracket'), ('cup_2', 'cup')]
    for each, model, estimate in zip(messages, models[1:], estimates[1:], strict=True):
        assert header_from(each.header) == HEADER
        assert each.operation == each.ADD == 0
        mesh, = each.meshes
        np.testing.assert_array_equal(corners(mesh.vertices), model.vertices)
        np.testing.assert_array_equal([part.vertex_indices for part in mesh.triangles],
                                      model.faces)
        placed = matrix(each.pose) @ matrix(each.mesh_poses[0])
        np.testing.assert_allclose(placed, estimate.pose, atol=1e-12)
        assert each.primitives == each.planes == each.subframe_names == []


def test_what_was_added_is_removed_once(models, estimates):
    scene = CollisionObjects(classes, NAMES, models, {})

    def told(messages):
        return [(each.id, each.operation) for each in map(wired, messages)]

    add, remove = 0, 1
    assert scene.clear() == []
    assert told(scene.update(estimates)) == [('bracket', add), ('cup_2', add)]
    lost = [*estimates[:2], replace(estimates[2], lost=True)]
    assert told(scene.update(lost)) == [('bracket', add), ('cup_2', remove)]
    assert told(scene.update(lost)) == [('bracket', add)]
    gone, = scene.clear()
    assert told([gone]) == [('bracket', remove)]
    assert wired(gone).meshes == []  # as MoveIt wants it
    assert scene.clear() == []
