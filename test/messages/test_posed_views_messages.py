"""Posed views as messages: what goes over the wire is what was taken, or is refused."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.messages.posed_views import posed_views_from, posed_views_to_messages
from pmcl_ros.runtime.errors import MessageError

PINHOLE = Pinhole(40, 30, 50.0, 51.0, 19.0, 15.0)


def views(count=3, pinholes=(PINHOLE,)):
    rng = np.random.default_rng(0)
    made = []
    for k in range(count):
        pose = np.eye(4)
        pose[:3, :3] = Rotation.random(None, np.random.default_rng(k)).as_matrix()
        pose[:3, 3] = rng.normal(size=3)
        pinhole = pinholes[k % len(pinholes)]
        picture = rng.integers(0, 65536, (pinhole.height, pinhole.width, 3)) / 65535
        made.append(PosedView(Header(10 * k, 'base'), picture.astype(np.float32), pinhole, pose,
                              (0.001 * k, 0.01), ('', 'wrist')[k % 2], 0.25, 0.125 * k))
    return PosedViews(tuple(made))


def test_messages_say_all_of_the_views():
    given = views()
    found = posed_views_from(*posed_views_to_messages(given))
    assert found.header == Header(20, 'base') == given.header
    for one, other in zip(found.views, given.views, strict=True):
        np.testing.assert_allclose(one.picture, other.picture, atol=1e-7)
        np.testing.assert_allclose(one.camera_to_reference, other.camera_to_reference, atol=1e-12)
        np.testing.assert_allclose(one.sigma, other.sigma, rtol=1e-6)
        assert (one.pinhole, one.common) == (other.pinhole, other.common)
        assert one.drift == other.drift
    assert [each.group for each in found.views] == ['', 'group 1', '']
    assert [each.name for each in found.views] == ['view 0', 'view 1', 'view 2']


def test_a_picture_of_another_pinhole_is_resampled_to_that_of_the_first():
    wide = Pinhole(60, 40, 60.0, 60.0, 30.0, 20.0)
    v, u = np.mgrid[:40, :60].astype(float)
    ray = (u - wide.cx) / wide.fx, (v - wide.cy) / wide.fy
    given = views(2, (PINHOLE, wide))
    smooth = np.stack([0.5 + 0.5 * ray[0], 0.5 + 0.5 * ray[1], 0.5 + 0 * u], axis=-1)
    given = PosedViews((given.views[0], replace(given.views[1], picture=smooth.astype('f4'))))
    found = posed_views_from(*posed_views_to_messages(given)).views[1]
    assert found.pinhole == PINHOLE
    v, u = np.mgrid[:30, :40].astype(float)
    expected = np.stack([0.5 + 0.5 * (u - PINHOLE.cx) / PINHOLE.fx,
                         0.5 + 0.5 * (v - PINHOLE.cy) / PINHOLE.fy, 0.5 + 0 * u], axis=-1)
    np.testing.assert_allclose(found.picture, expected, atol=2e-3)
    assert cv2.absdiff(found.picture, given.views[0].picture).max() > 0.1


def test_masks_go_with_the_pictures():
    given, mask = views(), np.ones((30, 40), bool)
    mask[20:, 5:15] = False
    masked = PosedViews((given.views[0], replace(given.views[1], mask=mask), given.views[2]))
    messages = posed_views_to_messages(masked)
    assert messages.views.encoding == 'rgba16'
    found = posed_views_from(*messages).views
    assert [each.mask is None for each in found] == [True, False, True]
    np.testing.assert_array_equal(found[1].mask, mask)
    plain = posed_views_from(*posed_views_to_messages(given)).views
    for one, other in zip(found, plain, strict=True):
        np.testing.assert_array_equal(one.picture, other.picture)


@pytest.mark.parametrize(('change', 'message'), [
    (lambda m: m._replace(poses=type(m.poses)(header=m.poses.header, poses=[])),
     'poses holds no pose'),
    (lambda m: m._replace(poses=type(m.poses)(header=m.poses.header, poses=m.poses.poses[:2])),
     '2 poses .* of 40x30 px .* make 40x60 and 2 rows'),
    (lambda m: m._replace(sigma=m.views), "sigma: encoding is 'rgb16', expected '32FC5'"),
    (lambda m: m._replace(sigma=posed_views_to_messages(PosedViews(2 * views().views)).sigma),
     'with 6 rows of posed_views/sigma; 3 poses'),
    *[(lambda m, name=name: m._replace(
        **{name: getattr(posed_views_to_messages(views(2)), name)}),
       f'posed_views/{name} is of .* expected') for name in ('camera_info', 'poses', 'sigma')],
])
def test_what_does_not_fit_together_is_refused_in_one_line(change, message):
    with pytest.raises(MessageError, match=message) as caught:
        posed_views_from(*change(posed_views_to_messages(views())))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(('column', 'value', 'message'), [
    (2, 1.5, 'a share above 1'), (3, 1.4, 'half a group'), (0, np.nan, 'NaN'),
    (4, -1e-3, 'a negative number')])
def test_impossible_sigmas_are_refused(column, value, message):
    messages = posed_views_to_messages(views())
    rows = np.frombuffer(messages.sigma.data, '<f4').reshape(3, 5).copy()
    rows[1, column] = value
    messages.sigma.data[:] = type(messages.sigma.data)('B', rows.tobytes())
    with pytest.raises(MessageError, match=message):
        posed_views_from(*messages)


def test_sigmas_beside_each_other_are_refused():
    messages = posed_views_to_messages(views())
    sigma = messages.sigma
    sigma.height, sigma.width, sigma.step = 1, 3, 3 * sigma.step
    with pytest.raises(MessageError, match='sigma has 3 columns; expected one'):
        posed_views_from(*messages)


def test_sigmas_of_former_bags_are_of_an_object_that_rests():
    given = views()
    messages = posed_views_to_messages(given)
    rows = np.frombuffer(messages.sigma.data, '<f4').reshape(3, 5)[:, :4]
    former = type(messages.sigma)(
        header=messages.sigma.header, height=3, width=1, encoding='32FC4', step=16,
        data=type(messages.sigma.data)('B', rows.tobytes()))
    found = posed_views_from(*messages._replace(sigma=former))
    assert [each.drift for each in found.views] == [0, 0, 0]
    np.testing.assert_allclose([each.sigma for each in found.views],
                               [each.sigma for each in given.views], rtol=1e-6)
