"""Topics whose packages may be missing: silent, unless they were asked for."""

import sys
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
from optional_types import STORE, wired
from pmcl_scenes import cup, model_of, pose_of
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.graph import OPTIONAL
from pmcl_ros.nodes.pmcl_outputs import optional_outputs
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.pmcl.estimate import PoseEstimate

PACKAGES = {each.name: each.type.partition('/')[0] for each in OPTIONAL}


def published(node):
    return {each.topic_name.lstrip('/') for each in node.publishers} & {*PACKAGES}


def test_missing_packages_are_told_only_where_they_were_asked_for(make_pmcl_node, monkeypatch,
                                                                  capfd):
    for package in PACKAGES.values():
        monkeypatch.setitem(sys.modules, package, None)  # as if it were not installed
    node = make_pmcl_node()
    for topic, package in PACKAGES.items():
        node.set_parameters([Parameter(topic, value='always')])
        assert node.trigger_configure() == Result.FAILURE
        error = capfd.readouterr().err
        assert error.count(f"parameter '{topic}' is 'always', but message type {package}/") == 1
        assert f'install ros-jazzy-{package.replace("_", "-")}' in error
        assert 'Traceback' not in error
        node.set_parameters([Parameter(topic, value='auto')])
    assert node.trigger_configure() == Result.SUCCESS
    assert not published(node)
    assert 'is not installed' not in capfd.readouterr().err


def test_what_is_never_wanted_is_not_published(make_pmcl_node):
    node = make_pmcl_node(**dict.fromkeys(PACKAGES, 'never'))
    assert node.trigger_configure() == Result.SUCCESS
    assert not published(node)


@pytest.mark.skipif(not all(map(find_spec, PACKAGES.values())),
                    reason='vision_msgs and moveit_msgs are part of a full ROS, not on PyPI')
def test_what_is_installed_is_published(make_pmcl_node):
    node = make_pmcl_node()
    assert node.trigger_configure() == Result.SUCCESS
    assert published(node) == {*PACKAGES}


class Listener:
    """In place of a node with one publisher, whose type needs a package: it keeps the messages."""

    def __init__(self):
        self.heard, self.listening = {}, False

    def publisher(self, kind, topic, _):
        self.heard[topic] = []
        said = self.heard[topic]

        class Publisher:
            def publish(_, message):  # noqa: N805
                assert isinstance(message, kind)
                said.append(wired(message))

            def get_subscription_count(_):  # noqa: N805
                return int(self.listening)

        return Publisher()


def test_who_listens_hears_of_each_capture_and_of_a_reset(monkeypatch):
    monkeypatch.setattr(optional_outputs, 'message_class', STORE.types.__getitem__)
    node = Listener()
    outputs = optional_outputs.OptionalOutputs(
        node, PmclNodeSettings(), ['cup'], [model_of(cup(), name='cup')], {})
    found = PoseEstimate(Header(7, 'camera'), np.eye(4), np.eye(6), np.eye(4)[None], np.zeros(1),
                         1.0, False, 'default')

    def told(*estimates):
        for said in node.heard.values():
            said.clear()
        for each in estimates:
            outputs.publish([each])
        return ([[each.id for each in message.detections] for message in node.heard['detections']],
                [each.operation for each in node.heard['collision_object']])

    assert told(found) == ([], [])
    node.listening = True
    assert told(found, replace(found, lost=True)) == ([['cup'], []], [0, 1])
    assert told(found) == ([['cup']], [0])
    outputs.clear()
    assert [each.operation for each in node.heard['collision_object']] == [0, 1]


def test_what_was_found_before_a_configuration_is_removed_after_it(monkeypatch):
    monkeypatch.setattr(optional_outputs, 'message_class', STORE.types.__getitem__)
    node, in_scene = Listener(), {}
    node.listening = True
    found = PoseEstimate(Header(7, 'camera'), np.eye(4), np.eye(6), np.eye(4)[None], np.zeros(1),
                         1.0, False, 'default')

    def configured(*names):
        return optional_outputs.OptionalOutputs(
            node, PmclNodeSettings(), names, [model_of(cup(), name=each) for each in names],
            in_scene)

    configured('cup', 'jar').publish([found, found])
    configured('cup').publish([replace(found, lost=True)])
    said = [(each.id, each.operation) for each in node.heard['collision_object']]
    assert said == [('jar', 1), ('cup', 1)]
    configured('cup').clear()
    assert not node.heard['collision_object']


def test_where_the_pose_of_the_camera_is_known_the_scene_gets_the_fixed_frame(monkeypatch):
    """Detections stay in the frame of the capture."""
    monkeypatch.setattr(optional_outputs, 'message_class', STORE.types.__getitem__)
    node = Listener()
    node.listening = True
    outputs = optional_outputs.OptionalOutputs(
        node, PmclNodeSettings(track_frame='base_link'), ['cup'], [model_of(cup(), name='cup')],
        {})
    pose, camera = (pose_of(Rotation.from_euler('xyz', turn), shift) for turn, shift in (
        ([0.1, 0.2, 0.3], [0.1, 0.2, 0.5]), ([3.0, 0.4, -0.2], [0.6, -0.3, 0.9])))
    found = PoseEstimate(Header(7, 'camera'), pose, np.eye(6), pose[None], np.zeros(1), 1.0,
                         False, 'default')
    outputs.publish([found], camera)
    outputs.publish([found])  # its pose is not known
    seen, = {each.header.frame_id for each in node.heard['detections']}
    assert seen == 'camera'
    placed = [pose_from(each) for each in node.heard['collision_object']]
    for (header, there), frame, expected in zip(placed, ('base_link', 'camera'),
                                                (camera @ pose, pose), strict=True):
        assert header == Header(7, frame)
        np.testing.assert_allclose(there, expected, atol=1e-12)
