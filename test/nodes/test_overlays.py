"""Drawings on the picture of a capture whose search has lasted."""

from types import SimpleNamespace

import numpy as np
import pytest

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.image import picture_from, picture_to_message
from pmcl_ros.nodes.pmcl_outputs.overlays import Overlays

SMALL, LARGE = (48, 64, 3), (2000, 3000, 3)


@pytest.fixture
def drawn():
    """Overlays of a node with a subscriber; what it publishes and its warnings are in lists."""
    found, warnings = [], []
    publisher = SimpleNamespace(get_subscription_count=lambda: 1, publish=found.append)
    logger = SimpleNamespace(warning=lambda text, once: warnings.append((text, once)))
    node = SimpleNamespace(publisher=lambda *_: publisher, get_logger=lambda: logger)
    return Overlays(node), found, warnings


@pytest.mark.parametrize(('shape', 'later', 'newer'), [
    (SMALL, 0, 0), (SMALL, 255, 0), (SMALL, 256, 256), (LARGE, 3, 0), (LARGE, 40, 7)])
def test_a_picture_waits_for_its_search_as_far_as_the_memory_goes(drawn, shape, later, newer):
    """newer: pictures that are kept where it has not waited."""
    overlays, found, warnings = drawn
    for number in range(1, 2 + later):
        picture = np.full(shape, number % 256, np.uint8)
        overlays.on_picture(picture_to_message(Header(number), picture))
    pinhole = Pinhole(shape[1], shape[0], 100, 100, shape[1] / 2, shape[0] / 2)
    overlays.publish(Header(1), pinhole, lambda picture, _: picture)
    overlays.publish(Header(2 + later), pinhole, lambda picture, _: picture)  # it has not come
    assert len(found) == (not newer)
    if not newer:
        assert (picture_from(found[0]) == 1).all()
        assert not warnings
    else:
        (text, once), = warnings
        assert f'no overlay of capture 1: {newer} newer center/image have come since' in text
        assert once


def test_it_is_drawn_by_the_camera_of_the_picture_not_by_that_of_a_coarser_volume(drawn):
    overlays, found, warnings = drawn
    own, coarse = Pinhole(64, 48, 100, 100, 30, 20), Pinhole(32, 24, 50, 50, 15, 10)
    for number in (1, 2, 3):  # the second has no camera_info
        overlays.on_picture(picture_to_message(Header(number), np.zeros(SMALL, np.uint8)))
        if number != 2:
            overlays.on_camera(pinhole_to_message(Header(number), own))
    cameras = []
    for number in (1, 2, 3):
        overlays.publish(Header(number), coarse,
                         lambda picture, camera: cameras.append(camera) or picture)
    assert cameras == [own, own]
    assert len(found) == 2
    (text, _), = warnings
    assert 'center/image is not of the size of the volume' in text
