"""The wine glass that the package ships: what the nodes shall find in its bag."""

import numpy as np
from harness import ROOT

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.messages import bags
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.pmcl.object_model import ObjectModel

BAG = ROOT / 'bags' / 'wine_glass'
NEAR, UPRIGHT = 0.02, 10.0  # [m], [degrees] from the truth


def check_pose(message):
    """Assert that a PoseStamped is the true pose, of the bag's capture."""
    header, pose = pose_from(message)
    assert header == Header(next(bags.read(BAG)).time_ns, 'lytro_optical_frame')
    symmetry = ObjectModel.load(ROOT / 'models' / 'wine_glass.obj').symmetry
    error = pose_error(pose, Truth.load(BAG / 'truth.json').pose, symmetry)
    assert error.translation < NEAR
    assert np.degrees(error.rotation) < UPRIGHT
