"""pmcl_node follows an object through real topics, by what it is told of it.

test_sequence_replay.py has one that is hidden and found again.
"""

from functools import cache

import pytest
import trimesh
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import ACTIVATE, CONFIGURE, DEACTIVATE, Process
from std_msgs.msg import Float32MultiArray
from std_srvs.srv import Trigger

from pmcl_ros.evaluation.studies.tracking import edges_of
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.messages.bag_captures import pose_message
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.messages.volume import edges_to_message
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.simulation.files import FIXED_FRAME
from pmcl_ros.simulation.sequence import Sequence, SequenceSettings


class Session:
    """An active pmcl_node that is given a sequence, frame by frame: edges(number)."""

    def __init__(self, folder, user, sequence, edges, **values):
        self.sequence, self._edges, self._user = sequence, edges, user
        model = sequence.model
        trimesh.Trimesh(model.vertices, model.faces, process=False).export(folder / 'model.obj')
        self.process = Process(folder, 'pmcl_ros.nodes.pmcl_node', params={
            'object': f'{folder}/model.obj', 'roi_center': list(sequence.roi_center),
            'roi_size': list(sequence.roi_size), **values})
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), self.process.log
        self._publisher = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
        self.states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        self.poses = user.listen(PoseStamped, 'pose', SMALL)

    def show(self, number):
        """Publish a frame; what the node then says of it: level, message, values."""
        edges = self._edges(number)
        self._publisher.publish(edges_to_message(edges))
        stamp = edges.header.stamp_ns

        def told():
            return [each.status[0] for each in self.states
                    if f'in capture {stamp}' in each.status[0].message
                    and each.status[0].name == 'pmcl_node']

        status = self._user.wait(told, f'what is said of frame {number}')[0]
        return status.level, status.message, {each.key: each.value for each in status.values}

    def right(self, message, number):
        header, pose = pose_from(message)
        assert header.stamp_ns == self.sequence.header(number).stamp_ns
        error = pose_error(pose, self.sequence.poses[number], self.sequence.model.symmetry)
        return error.translation < 0.02 and error.rotation < 0.2


@pytest.fixture(scope='module')
def sequence():
    return Sequence(4, SequenceSettings(frames=6, occluded=2, size=128, object_speed=0.008))


@pytest.fixture(scope='module')
def edges(sequence):
    """A function number of a frame -> its evidence, made once."""
    return cache(lambda number: edges_of(sequence, sequence.frame(number)))


@pytest.fixture
def session(tmp_path, user, sequence, edges):
    """A function parameters -> Session; their processes end well."""
    sessions = []

    def session(**values):
        sessions.append(Session(tmp_path, user, sequence, edges, **values))
        return sessions[-1]

    yield session
    for each in sessions:
        with each.process:
            pass
        assert 'Traceback' not in each.process.log


def test_an_object_is_followed_until_it_is_forgotten(session, user, sequence):
    node = session(tracking='constant_pose', track_sigma_translation=0.006)
    said = [node.show(number) for number in (0, 1, 2)]
    assert [level for level, _, _ in said] == [
        DiagnosticStatus.OK, DiagnosticStatus.OK, DiagnosticStatus.WARN]
    assert [values['mode'] for _, _, values in said] == ['default', 'followed', 'predicted']
    assert 'predicted at (' in said[2][1]
    # Forgotten, the next capture is searched as the first.
    answer = user.call(Trigger, '/pmcl_node/reset', Trigger.Request())
    assert answer.success
    assert node.show(4)[2]['mode'] == 'default'
    user.wait(lambda: len(node.poses) == 3, 'the poses')
    assert all(node.right(*each) for each in zip(node.poses, (0, 1, 4), strict=True))
    assert user.change('pmcl_node', DEACTIVATE)


def test_the_camera_s_poses_are_taken_from_their_topic(session, user, sequence):
    node = session(tracking='camera', track_camera='topic', track_frame=FIXED_FRAME,
                   track_sigma_translation=0.02)
    publisher = user.publisher(PoseStamped, 'camera_pose', BIG)  # acknowledged at once
    for number in (0, 1):
        stamp = sequence.header(number).stamp_ns
        publisher.publish(pose_message('/camera_pose', Header(stamp, FIXED_FRAME),
                                            sequence.cameras[number]).cdr)
    user.delivered(publisher)
    assert [node.show(number)[2]['mode'] for number in (0, 1)] == ['default', 'followed']
    # Of the next one nothing is known: it is said, and the region is searched.
    assert node.show(4)[2]['mode'] == 'default'
    assert 'camera_pose: the pose nearest to the capture' in node.process.log
    publisher.publish(pose_message('/camera_pose', Header(1, 'map'),
                                        sequence.cameras[0]).cdr)
    refusal = "camera_pose is in frame 'map', expected track_frame 'odom'"
    user.wait(lambda: refusal in node.process.log, 'the refusal')
    assert user.change('pmcl_node', DEACTIVATE)
