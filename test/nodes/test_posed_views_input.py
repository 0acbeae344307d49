"""Posed views come once, by reference, as messages or both ways."""

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Image

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.nodes.posed_views_input import subscribe_posed_views
from pmcl_ros.nodes.runtime.base import BIG, StageNode
from pmcl_ros.nodes.view_outputs import posed_view_outputs
from pmcl_ros.runtime.settings import Settings

PINHOLE = Pinhole(8, 6, 9.0, 9.0, 4.0, 3.0)


class Giver(StageNode):
    """Publishes posed views."""

    name, settings_class = 'giver', Settings

    def set_up(self, _):
        self.outputs = posed_view_outputs(self)

    def start(self):
        pass

    def give(self, views):
        for each in self.outputs:
            each.publish(views)


class Taker(StageNode):
    """Keeps the posed views that come."""

    name, settings_class = 'taker', Settings

    def set_up(self, _):
        self.views = []

    def start(self):
        subscribe_posed_views(self, self.views.append)


def views_at(stamp):
    """Two views, the last at a stamp."""
    rng = np.random.default_rng(stamp)
    return PosedViews(tuple(PosedView(
        Header(each, 'base'), rng.integers(0, 65536, (6, 8, 3)).astype(np.float32) / 65535,
        PINHOLE) for each in (stamp - 1, stamp)))


@pytest.fixture(params=['by reference', 'as messages'])
def nodes(request, user):
    """An active giver and taker, of one process or as if of two."""
    context = Context()
    rclpy.init(context=context)
    giver = Giver(context=context)
    taker = Taker(bus=giver.bus if request.param == 'by reference' else None, context=context)
    executor = SingleThreadedExecutor(context=context)
    for each in (giver, taker):
        executor.add_node(each)
        each.trigger_configure()
        each.trigger_activate()
    user.others.append(executor)
    yield giver, taker, request.param == 'by reference'
    user.others.clear()
    executor.shutdown()
    taker.close()
    giver.close()
    rclpy.shutdown(context=context)


def test_each_that_is_published_comes_once_and_again_when_it_is_published_again(nodes, user):
    giver, taker, by_reference = nodes
    elsewhere = user.listen(Image, 'posed_views', BIG)  # so it is sent as a message too
    user.wait(lambda: giver.count_subscribers('posed_views') == 2, 'both subscribers')
    first, second = views_at(2), views_at(5)
    given = [first, first, second]  # again, as by ~/finish
    for number, views in enumerate(given, 1):
        giver.give(views)
        user.wait(lambda number=number: len(taker.views) == len(elsewhere) == number, 'views')
    for _ in range(20):
        user.spin()
    assert len(taker.views) == 3
    for found, views in zip(taker.views, given, strict=True):
        assert (found is views) == by_reference
        assert found.header == views.header
        for one, other in zip(found.views, views.views, strict=True):
            np.testing.assert_allclose(one.picture, other.picture, atol=1e-6)
    assert taker.health.dropped == 0
