"""The chart of how sure a pose is by each further view."""

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image

from pmcl_ros.drawing import charts
from pmcl_ros.drawing.views_picture import sigmas_figure
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.image import picture_from
from pmcl_ros.nodes.pmcl_settings import PmclNodeSettings
from pmcl_ros.nodes.posed_views_outputs import PosedViewsOutputs
from pmcl_ros.nodes.runtime.base import SMALL, StageNode
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.runtime.settings import Settings


class Teller(StageNode):
    """Says how sure poses are."""

    name, settings_class = 'teller', Settings

    def set_up(self, _):
        self.outputs = PosedViewsOutputs(self, None, PmclNodeSettings())

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


def test_the_chart_keeps_what_was_told_of_the_first_views_of_a_collection(
        teller, user, small_edges):
    drawn = user.listen(Image, 'pose/sigma_by_views', SMALL)

    def tell(number, millimetres, lost=False):
        evidence = ViewsEvidence(Header(1, 'base'), (PosedEvidence(small_edges, np.eye(4)),)
                                 * number)
        teller.outputs.on_estimate(evidence, PoseEstimate(
            Header(1, 'base'), np.eye(4), np.eye(6) * (1e-3 * millimetres) ** 2, np.eye(4)[None],
            np.zeros(1), 1.0, lost, 'default'))
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
