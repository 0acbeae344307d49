"""The chart of how sure a pose is by each further view."""

from dataclasses import replace

import numpy as np
import pytest
import rclpy
import yaml
from geometry_msgs.msg import PoseStamped
from pmcl_scenes import cup, model_of
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from pmcl_ros.drawing import charts
from pmcl_ros.drawing.views_picture import sigmas_figure
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.messages.image import picture_from
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.nodes.pmcl_outputs.posed_views_outputs import PosedViewsOutputs
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.pmcl.multi_view.next_view import next_views
from pmcl_ros.runtime.settings import Settings

CUP = model_of(cup())


class Teller(StageNode):
    """Says how sure poses are."""

    name, settings_class = 'teller', Settings
    plan = ''

    def set_up(self, _):
        self.outputs = PosedViewsOutputs(self, True, PmclNodeSettings(
            roi_center=(0, 0, 0), next_view_plan=self.plan))  # where they look

    def start(self):
        self.outputs.start()


@pytest.fixture
def teller(user):
    """An active node, in this process."""
    context = Context()
    rclpy.init(context=context)
    node, executor = Teller(context=context), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    user.others.append(executor)
    node.trigger_configure()
    node.trigger_activate()
    yield node
    user.others.clear()
    executor.shutdown()
    node.close()
    rclpy.shutdown(context=context)


def estimate_of(millimetres, lost=False):
    return PoseEstimate(
        Header(1, 'base'), np.eye(4), np.eye(6) * (1e-3 * millimetres) ** 2, np.eye(4)[None],
        np.zeros(1), 1.0, lost, 'default')


def seen_from(edges, *places):
    """Views from there [m], half a metre before the origin, and their evidence."""
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, 0, 3], poses[:, 2, 3] = places, -0.5
    picture = np.full((edges.pinhole.height, edges.pinhole.width, 3), 0.5, np.float32)
    views = PosedViews(tuple(PosedView(Header(1, 'base'), picture, edges.pinhole, each)
                             for each in poses))
    return views, ViewsEvidence(Header(1, 'base'),
                                tuple(PosedEvidence(edges, each) for each in poses))


def test_the_chart_keeps_what_was_told_of_the_first_views_of_a_collection(
        teller, user, small_edges):
    drawn = user.listen(Image, 'pose/sigma_by_views', SMALL)

    def tell(number, millimetres, lost=False):
        evidence = ViewsEvidence(Header(1, 'base'), (PosedEvidence(small_edges, np.eye(4)),)
                                 * number)
        teller.outputs.on_estimate(evidence, estimate_of(millimetres, lost), CUP)
        teller.outputs.publish_chart()

    nan = np.nan
    steps = [((2, 4), [nan, 4]), ((3, 2), [nan, 4, 2]), ((4, 1), [nan, 4, 2, 1]),
             ((4, 0.8), [nan, 4, 2, 0.8]),  # a sharper view, or the same again
             ((3, 3), [nan, nan, 3]),  # another collection, of which the first were not searched
             ((2, 5), [nan, 5])]
    for number, (given, expected) in enumerate(steps, 1):
        tell(*given)
        user.wait(lambda number=number: len(drawn) == number, 'a chart')
        np.testing.assert_array_equal(
            picture_from(drawn[-1]), charts.picture(sigmas_figure(1e-3 * np.array(expected))))
    # Lost in the first views of another collection: the old number is not theirs.
    tell(2, 9, lost=True)
    tell(3, 2)
    user.wait(lambda: len(drawn) == len(steps) + 1, 'a chart')
    np.testing.assert_array_equal(
        picture_from(drawn[-1]), charts.picture(sigmas_figure(1e-3 * np.array([nan, nan, 2]))))


def test_a_pose_says_nothing_of_a_collection_that_is_being_searched(teller, user, small_edges):
    _, evidence = seen_from(small_edges, 0.0, 0.1)
    more, _ = seen_from(small_edges, 0.0, 0.1, 0.2)
    others, _ = seen_from(small_edges, 0.0, 0.15)

    def unknown():
        answer = user.call(Trigger, '/teller/next_view', Trigger.Request())
        return 'no pose has been found' in answer.message

    assert unknown()
    teller.outputs.on_estimate(evidence, estimate_of(3), CUP)
    teller.outputs.on_views(more)
    assert not unknown()
    teller.outputs.on_views(others)
    assert unknown()
    teller.outputs.on_views(more)
    assert not unknown()
    teller.outputs.on_estimate(evidence, estimate_of(3, lost=True), CUP)
    assert unknown()


def turned(degrees):
    """A camera that looks at the origin from half a metre away, as those of `seen_from`."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('y', degrees, degrees=True).as_matrix()
    pose[:3, 3] = -0.5 * pose[:3, 2]
    return pose


def test_a_next_view_is_one_of_a_plan(teller, user, small_edges, tmp_path):
    views, evidence = seen_from(small_edges, 0.0, 0.02)
    nexts = user.listen(PoseStamped, 'next_view', SMALL)
    plan = tmp_path / 'plan.yaml'

    def answer(cameras, **more):
        plan.write_text(yaml.safe_dump({'poses': [each.ravel().tolist() for each in cameras]}
                                       | more))
        teller.plan = str(plan)
        assert teller.trigger_deactivate() == teller.trigger_cleanup() == Result.SUCCESS
        assert teller.trigger_configure() == teller.trigger_activate() == Result.SUCCESS
        teller.outputs.on_views(views)
        teller.outputs.on_estimate(evidence, estimate_of(3), CUP)
        return user.call(Trigger, '/teller/next_view', Trigger.Request())

    cameras = [turned(3), turned(50), turned(20)]
    told = answer(cameras, frame='base')
    assert told.success, told.message
    user.wait(lambda: nexts, 'the next view')
    expected = next_views(evidence, CUP, teller.outputs.settings, np.eye(4), np.array(cameras),
                          small_edges.pinhole)[0]
    np.testing.assert_allclose(pose_from(nexts[0])[1], expected.camera, atol=1e-9)
    assert told.message == f'{1e3 * expected.now:.2f} mm now, {expected.describe()}'
    away = turned(50) @ np.diag([-1, 1, -1, 1])  # looks the other way
    assert 'or they do not see the object (next_view_plan)' in answer([away]).message
    assert answer(cameras, frame='map').message.endswith(
        "plan.yaml is in frame 'map', the views are in 'base': change one")
    assert len(nexts) == 1


def test_a_next_view_is_one_beside_those_that_show_the_object(teller, user, small_edges):
    """One that does not show it says nothing of how sure the pose is."""
    views, evidence = seen_from(small_edges, 0.0, 0.1, 0.2)

    def now(given, hidden=()):
        teller.outputs.on_views(views)
        teller.outputs.on_estimate(given, replace(estimate_of(3), hidden=hidden), CUP)
        answer = user.call(Trigger, '/teller/next_view', Trigger.Request())
        return answer.message.split(' mm now')[0]

    all_of_them, shown = float(now(evidence)), float(now(evidence, (1,)))
    assert shown == float(now(evidence.without((1,)))) != all_of_them
