"""What the mask of a camera leaves out is no evidence, as if it were out of view."""

from dataclasses import replace

import numpy as np
from contour_maps import map_seen
from pmcl_scenes import CAMERA, cup, depth_of, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.posed_view import PosedView
from pmcl_ros.pmcl.multi_view.localizer import MultiViewLocalizer
from pmcl_ros.pmcl.settings import PmclSettings

CUP = model_of(cup(), [0, 0, 1])
MIDDLE = np.array([0.01, -0.005, 0.45])
NOISE = np.random.default_rng(0).random((CAMERA.height, CAMERA.width, 3), np.float32)


def scene(angles=(-20, 0, 20)):
    """The cup's pose, and cameras about it, in the frame of the middle one."""
    truth, cameras = np.eye(4), np.tile(np.eye(4), (len(angles), 1, 1))
    truth[:3, :3] = Rotation.from_euler('xz', [100, 20], degrees=True).as_matrix()
    truth[:3, 3] = MIDDLE
    cameras[:, :3, :3] = Rotation.from_rotvec(np.deg2rad(angles)[:, None] * [0, 1, 0]).as_matrix()
    cameras[:, :3, 3] = MIDDLE - cameras[:, :3, :3] @ MIDDLE
    return truth, cameras


def evidence(context, truth, cameras, covered=None, masked=False):
    """Contour maps. covered: (height, width) where something without contours is before the cup;
    masked: the views say so."""
    views = []
    for camera in cameras:
        seen = map_seen(depth_of(context, CUP, np.linalg.inv(camera) @ truth, CAMERA, 4) > 0,
                        CAMERA, 0.3, 0.6)
        view = PosedView(Header(7, 'base'), NOISE, CAMERA, camera)
        if covered is not None:
            nothing = map_seen(np.zeros((4 * CAMERA.height, 4 * CAMERA.width), bool), CAMERA,
                               0.3, 0.6)
            tensor = np.where(covered[..., None, None], 0 if masked else nothing.tensor,
                              seen.tensor)
            seen = replace(seen, tensor=tensor.astype(np.float32))
            view = replace(view, mask=~covered if masked else None)
        views.append(PosedEvidence(seen, camera, view=view))
    return ViewsEvidence(Header(7, 'base'), tuple(views))


def found(of):
    settings = PmclSettings(roi_center=tuple(MIDDLE), roi_size=(0.12, 0.1, 0.14), proposals=200)
    with MultiViewLocalizer(CUP, settings) as localizer:
        return localizer.localize(of, np.random.default_rng(0))


def gripper(truth):
    """(height, width) a finger that covers the left part of the cup in the middle view."""
    x, y = CAMERA.project(truth[None, :3, 3])[0]
    covered = np.zeros((CAMERA.height, CAMERA.width), bool)
    covered[int(y) - 5:, int(x) - 60:int(x)] = True
    return covered


def test_a_masked_part_takes_nothing_from_the_evidence_of_the_rest(context):
    truth, cameras = scene()
    finger = gripper(truth)
    whole = found(evidence(context, truth, cameras))
    bare = found(evidence(context, truth, cameras, finger))
    masked = found(evidence(context, truth, cameras, finger, masked=True))
    assert not masked.lost
    off = CUP.symmetry.local(masked.pose[None], truth)[0]
    assert np.linalg.norm(off[:3]) < 1e-3
    # A pixel of what is left has as much as before; a finger without a mask speaks against it.
    assert masked.evidence > 0.9 * whole.evidence
    assert masked.support > bare.support
    assert masked.evidence > bare.evidence + 0.2 * whole.evidence
    assert np.trace(masked.covariance[:3, :3]) > np.trace(whole.covariance[:3, :3])


def test_a_mask_beside_the_object_changes_nothing(context):
    truth, cameras = scene()
    covered = np.zeros((CAMERA.height, CAMERA.width), bool)
    covered[:, :3] = True
    given = evidence(context, truth, cameras)
    views = tuple(replace(each, view=replace(each.view, mask=~covered)) for each in given.views)
    assert isinstance(views[0].evidence, ContourMap)
    np.testing.assert_array_equal(found(replace(given, views=views)).pose, found(given).pose)
