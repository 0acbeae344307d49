"""A picture and the pose of its camera: what is kept, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import GAMMA, PosedView
from pmcl_ros.runtime.errors import LightFieldError

PINHOLE = Pinhole(5, 4, 10, 10, 2, 1.5)
PICTURE = np.random.default_rng(0).random((4, 5, 3)).astype(np.float32)


def test_light_and_what_a_screen_shows_are_those_of_the_picture():
    view = PosedView(Header(), PICTURE, PINHOLE)
    np.testing.assert_allclose(view.linear(), PICTURE.astype(float) ** GAMMA, rtol=1e-5)
    assert abs(view.displayed() / 255 - PICTURE).max() <= 0.5 / 255 + 1e-6
    np.testing.assert_array_equal(view.camera_to_reference, np.eye(4))


def posed(rotation=None, last=(0, 0, 0, 1), position=(1, 2, 3)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec([1, -2, 0.5]).as_matrix() if rotation is None else rotation
    pose[:3, 3], pose[3] = position, last
    return pose


def test_a_rounded_rotation_is_one():
    PosedView(Header(), PICTURE, PINHOLE, posed().round(4))


@pytest.mark.parametrize(('change', 'reason'), [
    ({'picture': PICTURE[:3]}, r'float32 of shape \(3, 5, 3\), its camera says .*\(4, 5, 3\)'),
    ({'picture': PICTURE[..., 0]}, r'shape \(4, 5\)'),
    ({'picture': PICTURE.astype(float)}, 'is float64'),
    ({'picture': PICTURE * np.float32(2)}, 'not 0 to 1'),
    ({'picture': np.where(PICTURE[0, 0, 0] == PICTURE, np.float32(np.nan), PICTURE)}, 'NaN'),
    ({'camera_to_reference': posed(np.full((3, 3), np.nan))}, 'is no pose: .* NaN, or beyond'),
    ({'camera_to_reference': posed(position=(1, 2, 3)).T},
     '^camera_to_reference is no pose: it is written column by column; expected .* 0, 0, 0, 1$'),
    ({'camera_to_reference': posed(0.998001234 * np.eye(3))}, r'^camera_to_reference is no '
     r'rotation: its rows are 0\.004 off .*as_matrix\(\)$'),
    ({'camera_to_reference': posed(-np.eye(3))}, 'is no rotation: it mirrors'),
    ({'camera_to_reference': posed(position=(0, np.nan, 0))}, 'is no pose'),
    ({'camera_to_reference': posed(last=(0, 0.123456, 0, 2))}, 'its last row is 0, 0.1235, 0, 2;'),
    ({'camera_to_reference': np.eye(3)}, r'is no pose: its shape is \(3, 3\)'),
    ({'mask': np.ones((5, 4), bool)}, r'mask is bool of shape \(5, 4\), its picture says bool'),
    ({'mask': np.ones((4, 5), np.uint8)}, r'mask is uint8 of shape \(4, 5\), .* bool of \(4, 5\)'),
    ({'sigma': (0.001, -0.1)}, 'not negative'), ({'sigma': (np.inf, 0)}, 'finite')])
def test_what_does_not_fit_is_refused_in_one_line(change, reason):
    values = {'header': Header(), 'picture': PICTURE, 'pinhole': PINHOLE} | change
    with pytest.raises(LightFieldError, match=reason) as caught:
        PosedView(**values)
    assert '\n' not in str(caught.value)
