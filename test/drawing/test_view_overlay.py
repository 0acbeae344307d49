"""Overlays of posed views: what a mask leaves out is dark, beside the drawn object."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import cup, model_of

from pmcl_ros.drawing.view_overlay import outlines_in_view, overlay_in_view
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView

CUP = model_of(cup(), [0, 0, 1])
PINHOLE = Pinhole(640, 480, 600.0, 600.0, 320.0, 240.0)
POSE = np.eye(4)
POSE[2, 3] = 0.5


@pytest.mark.parametrize('draw', [
    lambda view: overlay_in_view(view, CUP, POSE, None),
    lambda view: outlines_in_view(view, [(CUP, POSE, 'cup')], None)], ids=['one', 'several'])
def test_what_a_mask_leaves_out_is_dark(draw):
    picture = np.random.default_rng(0).random((480, 640, 3), np.float32)
    view, shown = PosedView(Header(), picture, PINHOLE), np.ones((480, 640), bool)
    shown[400:] = False
    bare, masked = draw(view), draw(replace(view, mask=shown))
    np.testing.assert_array_equal(masked[:780], bare[:780])  # twice as large
    assert 0.9 < 4 * masked[820:].mean() / bare[820:].mean() < 1.1
