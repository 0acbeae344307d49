"""Pictures that nobody rendered: a stereo pair whose depths were measured with structured light.

Scharstein et al., "High-resolution stereo datasets with subpixel-accurate ground truth" (2014), a
quarter of the size, as scikit-image has it; its documentation has the calibration.
"""

import logging

import cv2
import numpy as np
import pytest

from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.posed_pairs import PosedPairs
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews, encoded

_LOG = logging.getLogger(__name__)
FOCAL, CX, CY, APART, BASELINE = 994.978, 311.193, 254.877, 31.086, 0.193001  # px; m
NEAR, FAR, WINDOW = 2.0, 5.5, 11


def test_depths_of_a_real_stereo_pair_are_as_good_as_those_of_block_matching():
    data = pytest.importorskip('skimage.data')
    left, right, disparity = data.stereo_motorcycle()
    height, width = disparity.shape
    views = []
    for picture, along in ((left, 0.0), (right, BASELINE)):
        pose = np.eye(4)
        pose[0, 3] = along
        pinhole = Pinhole(width, height, FOCAL, FOCAL, CX + (APART if along else 0), CY)
        views.append(PosedView(Header(0, 'room'), encoded(np.ascontiguousarray(picture), 2.2),
                               pinhole, pose))
    pair = PosedViews(tuple(views))
    labels = PosedPairs.from_views(pair, (0, 0, 0, 0), 1, 0).labels_needed(NEAR, FAR)
    volume = build_volume_of_views(
        pair, DlvSettings(near=NEAR, far=FAR, labels=labels, window=WINDOW), 0)
    matcher = cv2.StereoBM_create(80, WINDOW)
    theirs = matcher.compute(*(cv2.cvtColor(each, cv2.COLOR_RGB2GRAY) for each in (left, right)))

    measured = np.isfinite(disparity)

    def off(found):
        return np.abs(found - disparity)[measured]

    ours = off(FOCAL * BASELINE / volume.depth_map() - APART)
    assert np.median(ours) < 0.4  # px; labels are one apart
    for limit in (1, 2, 4):
        one, other = (ours > limit).mean(), (off(theirs / 16) > limit).mean()
        _LOG.info('off by more than %d px: %.0f %% by the plane sweep, %.0f %% by block matching',
                  limit, 100 * one, 100 * other)
        assert one < other < 0.35
