"""The volume of posed views: that of a light field, known depths, and what is not seen."""

from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import Texture, make_grid, planes_field
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.posed_pairs import PosedPairs, central
from pmcl_ros.dlv.reference import channels, window_sum
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.posed_view import GAMMA, PosedView, PosedViews
from pmcl_ros.runtime.errors import VolumeError

PINHOLE = Pinhole(96, 72, 120.0, 118.0, 47.0, 36.0)
ENDS = {'near': 0.45, 'far': 0.8}
ARC = (-30, -15, 0, 15, 30)  # degrees
HEADER = Header(5, 'room')


def on_arc(degrees, distance=0.6):
    """A camera that looks at the point `distance` before the one at 0 degrees."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('y', degrees, degrees=True).as_matrix()
    pose[:3, 3] = [0, 0, distance] - distance * pose[:3, 2]
    return pose


def depth_of_plane(camera, plane):
    """(height, width) depth in a camera of the plane n x = 1; plane: n (3,) in the room."""
    v, u = np.mgrid[:PINHOLE.height, :PINHOLE.width].astype(float)
    rays = np.stack([(u - PINHOLE.cx) / PINHOLE.fx, (v - PINHOLE.cy) / PINHOLE.fy,
                     np.ones_like(u)], axis=-1)
    return (1 - camera[:3, 3] @ plane) / (rays @ camera[:3, :3].T @ plane), rays


def picture_of(camera, planes, shares, highest):
    """What is seen of textured planes that give shares of the light."""
    seen = 0
    for number, (plane, share) in enumerate(zip(planes, shares, strict=True)):
        depth, rays = depth_of_plane(camera, plane)
        places = (depth[..., None] * rays) @ camera[:3, :3].T + camera[:3, 3]
        seen = seen + share * Texture(number, highest)(200 * places[..., 0], 200 * places[..., 1])
    return seen.astype(np.float32)


def views_of(cameras, planes, shares=(1,), highest=0.1):
    return PosedViews(tuple(PosedView(HEADER, picture_of(each, planes, shares, highest), PINHOLE,
                                      each) for each in cameras))


def labels_off(volume, depth):
    """(height, width) how many labels the best one is from the true depth."""
    inverse = 1 / volume.depths
    expected = (1 / depth - inverse[0]) / (inverse[1] - inverse[0])
    return np.abs(volume.likelihood.argmax(axis=2) - expected)


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear'])
@pytest.mark.parametrize('color_cost', ['l2', 'sad'])
def test_a_light_field_as_posed_views_gives_its_volume(interpolation, color_cost):
    field = planes_field(make_grid((3, 3), (100, 60), 0.001, 0.02, focal=(800, 900)), 0.75, 0.4,
                         50)
    base, views = on_arc(40), []
    for place in np.ndindex(field.grid.shape):
        shift = np.eye(4)
        shift[:2, 3] = field.grid.baseline * field.grid.positions[place]
        picture = field.views[place] ** np.float32(1 / GAMMA)
        views.append(PosedView(HEADER, picture, field.pinhole, base @ shift))
    settings = DlvSettings(labels=15, views=3, interpolation=interpolation, color_cost=color_cost)
    found = build_volume_of_views(PosedViews(tuple(views)), settings)
    expected = build_volume(field, settings)
    np.testing.assert_array_equal(found.depths, expected.depths)
    assert found.pinhole == expected.pinhole
    inside = np.s_[12:-12, 12:-12]  # of all views, at all labels
    np.testing.assert_allclose(found.likelihood[inside], expected.likelihood[inside],
                               atol=0.006 * expected.likelihood.max())
    assert (found.header, found.camera.frame_id) == (Header(5, 'room/view_4'), 'room')
    np.testing.assert_array_equal(found.camera.camera_to_reference, base)


def plain_likelihood(views, number, depths, settings):
    """As the paper writes it, with points in space in place of homographies."""
    reference = views.views[number]
    own = channels(reference.linear())
    v, u = np.indices(own.shape[1:]).astype(float)
    weights = PosedPairs.from_views(views, (0, 0, 0, 0), 1, number).gamma
    total = np.zeros((len(depths), *own.shape[1:]))
    others = [each for each in views.views if each is not reference]
    for gamma, other in zip(weights, others, strict=True):
        into = np.linalg.inv(other.camera_to_reference) @ reference.camera_to_reference

        def places(du, dv, depth, other=other, into=into):
            rays = np.stack([(u + du - PINHOLE.cx) / PINHOLE.fx,
                             (v + dv - PINHOLE.cy) / PINHOLE.fy, np.ones_like(u)], axis=-1)
            return other.pinhole.project(depth * rays @ into[:3, :3].T + into[:3, 3])

        costs = np.full(total.shape, np.nan)
        for label, depth in enumerate(depths):
            at = places(0, 0, depth)
            du = (places(1e-4, 0, depth) - places(-1e-4, 0, depth)) / 2e-4
            dv = (places(0, 1e-4, depth) - places(0, -1e-4, depth)) / 2e-4
            with np.errstate(invalid='ignore'):
                seen = ((at >= 0) & (at <= [other.pinhole.width - 1,
                                            other.pinhole.height - 1])).all(axis=-1)
            there = np.nan_to_num(at[..., ::-1]).transpose(2, 0, 1)
            *colour, gu, gv = (map_coordinates(each, there, order=1, mode='nearest')
                               for each in channels(other.linear()))
            across, down = gu * du[..., 0] + gv * du[..., 1], gu * dv[..., 0] + gv * dv[..., 1]
            cost = (settings.beta * np.minimum(np.linalg.norm(np.stack(colour) - own[:3], axis=0),
                                               settings.tau_color)
                    + (1 - settings.beta) * gamma
                    * np.minimum(abs(across - own[3]), settings.tau_gradient)
                    + (1 - settings.beta) * (1 - gamma)
                    * np.minimum(abs(down - own[4]), settings.tau_gradient))
            costs[label][seen] = cost[seen]
        count = np.isfinite(costs).sum(axis=0)
        mean = np.nansum(costs, axis=0) / np.maximum(count, 1)
        total += np.where(np.isfinite(costs), costs, mean)
    total = window_sum(total, settings.window)
    with np.errstate(invalid='ignore'):
        part = (total.max(axis=0) - total) / total.sum(axis=0)
    return np.log(np.nan_to_num(part) + 1).transpose(1, 2, 0)


def test_views_of_any_pose_are_compared_as_the_paper_writes_it():
    rng = np.random.default_rng(0)
    views = []
    for k in range(4):
        pose = on_arc(rng.uniform(-50, 50))
        pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(rng.normal(0, 0.25, 3)).as_matrix()
        pose[:3, 3] += rng.normal(0, 0.03, 3)
        pinhole = replace(PINHOLE, width=96 - 9 * k, fx=PINHOLE.fx + 5 * k)
        smooth = Texture(k)(*np.meshgrid(np.arange(float(pinhole.width)), np.arange(72.0)))
        views.append(PosedView(HEADER, smooth.astype(np.float32), pinhole, pose))
    views = PosedViews(tuple(views))
    settings = DlvSettings(**ENDS, labels=12, interpolation='bilinear', window=3)
    found = build_volume_of_views(views, settings, 0)
    expected = plain_likelihood(views, 0, found.depths, settings)
    assert (expected.max(axis=2) > 0).mean() > 0.5
    np.testing.assert_allclose(found.likelihood, expected, atol=0.002 * expected.max())
    part = build_volume_of_views(
        views, settings.model_copy(update={'crop': (20, 10, 30, 41)}), 0)
    np.testing.assert_allclose(part.likelihood, found.likelihood[10:51, 20:50], atol=1e-6)
    assert part.pinhole == PINHOLE.crop(20, 10, 30, 41)


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear'])
def test_only_what_a_part_can_see_of_the_others_is_read(interpolation):
    views = views_of([on_arc(each) for each in ARC], [np.array([0.6, 0.2, 1.0]) / 0.62])
    settings = DlvSettings(near=0.55, far=0.65, labels=9, interpolation=interpolation, window=3)
    crop = (44, 30, 9, 8)
    pairs = PosedPairs.from_views(views, crop, 1)
    whole = build_volume_of_views(views, settings)
    part = build_volume_of_views(views, settings.model_copy(update={'crop': crop}))
    np.testing.assert_allclose(part.likelihood, whole.likelihood[30:38, 44:53], atol=1e-6)
    cut = pairs.within_reach(pairs.pixels, part.depths, 3)
    assert max(each.picture.shape[0] * each.picture.shape[1] for each in cut.others) < 96 * 72 / 8
    # Nothing that these pixels see is lost: all of it is 3 px or more within.
    rays = np.array([[44, 30, 1], [52, 30, 1], [44, 37, 1], [52, 37, 1]]).T
    seen = cut.homographies(part.depths) @ rays
    places = seen[:, :, :2] / seen[:, :, 2:]
    sizes = np.array([(each.pinhole.width, each.pinhole.height) for each in cut.others])
    assert (places >= 3).all()
    assert (places <= sizes[:, None, :, None] - 4).all()


def test_a_view_before_and_behind_which_pixels_are_is_read_whole():
    turned = on_arc(0)
    turned[:3, :3] = Rotation.from_euler('y', 85, degrees=True).as_matrix()
    turned[:3, 3] = [-0.1, 0, 0.5]
    away = on_arc(0)
    away[:3, :3] = Rotation.from_euler('y', 180, degrees=True).as_matrix()
    views = views_of([on_arc(0), turned, away], [np.array([0, 0, 1 / 0.6])])
    pairs = PosedPairs.from_views(views, (0, 0, 0, 0), 1, 0)
    depths = np.array([0.45, 0.8])
    cut = pairs.within_reach(pairs.pixels, depths, 7)
    before = (pairs.homographies(depths)[0] @ [[0, 95], [0, 71], [1, 1]])[:, 2] > 0
    assert before.any()
    assert not before.all()
    assert cut.others[0] is pairs.others[0]
    assert cut.others[1].picture.shape == (1, 1, 3)


def test_what_is_straight_behind_a_camera_is_not_seen_by_it():
    aside = np.eye(4)  # it looks to the right, from among what the other sees
    aside[:3, :3] = Rotation.from_euler('y', 90, degrees=True).as_matrix()
    aside[2, 3] = 0.62
    noise = np.random.default_rng(0).random((2, 72, 96, 3), np.float32)
    views = PosedViews(tuple(PosedView(HEADER, picture, PINHOLE, each)
                             for picture, each in zip(noise, (np.eye(4), aside), strict=True)))
    found = build_volume_of_views(views, DlvSettings(**ENDS, labels=9, window=3), 0).likelihood
    assert not found[:, :round(PINHOLE.cx) - 1].any()
    assert found[30:40, -20:].any(axis=2).all()


def test_the_best_label_is_the_depth_of_what_is_seen_from_all_sides():
    plane = np.array([0.6, 0.2, 1.0])
    plane /= 0.62 * plane[2]
    views = views_of([on_arc(each) for each in ARC], [plane])
    labels = PosedPairs.from_views(views, (0, 0, 0, 0), 1).labels_needed(**ENDS)
    volume = build_volume_of_views(views, DlvSettings(**ENDS, labels=labels))
    off = labels_off(volume, depth_of_plane(np.eye(4), plane)[0])
    assert (off[4:-4, 4:-4] <= 1).mean() > 0.98
    assert (off[16:-16, 24:-24] <= 1).all()


def test_two_layers_give_two_maxima():
    planes = np.array([[0, 0, 1 / 0.53], [0.1, 0, 1 / 0.68]])
    views = views_of([on_arc(each) for each in np.linspace(-30, 30, 9)], planes, (0.5, 0.5), 0.2)
    labels = PosedPairs.from_views(views, (0, 0, 0, 0), 1).labels_needed(**ENDS)
    layers = build_volume_of_views(views, DlvSettings(**ENDS, labels=labels)).layers()
    inside = np.s_[8:-8, 16:-16]
    for found, plane in zip((layers.front, layers.behind), planes, strict=True):
        depth = depth_of_plane(np.eye(4), plane)[0]
        assert (np.abs(found / depth - 1)[inside] < 0.02).mean() > 0.95


def test_a_view_that_sees_nothing_says_nothing(caplog):
    plane = np.array([0, 0.2, 1 / 0.6])
    views = views_of([on_arc(each) for each in ARC[:3]], [plane])
    settings = DlvSettings(**ENDS, labels=9)
    alone = build_volume_of_views(views, settings, 2)
    behind, beside = on_arc(0), on_arc(0)
    behind[:3, :3] = Rotation.from_euler('y', 180, degrees=True).as_matrix()
    beside[0, 3] = 3
    noise = np.random.default_rng(0).random((72, 96, 3), np.float32)
    blind = tuple(PosedView(HEADER, noise, PINHOLE, each) for each in (behind, beside))
    more = build_volume_of_views(PosedViews(views.views + blind), settings, 2)
    np.testing.assert_allclose(more.likelihood, alone.likelihood, atol=1e-7)
    nothing = build_volume_of_views(PosedViews((views.views[0], *blind)), settings, 0)
    assert 'no other view sees what view 0 does between 0.45 and' in caplog.text
    assert not nothing.likelihood.any()


def masked_views(seed, masks):
    """Views of a plane with noise where masks (height, width) are False."""
    noise = np.random.default_rng(seed).random((PINHOLE.height, PINHOLE.width, 3), np.float32)
    views = views_of([on_arc(each) for each in ARC], [np.array([0.6, 0.2, 1.0]) / 0.62])
    return PosedViews(tuple(
        replace(view, picture=np.where(mask[..., None], view.picture, noise), mask=mask)
        for view, mask in zip(views.views, masks, strict=True)))


@pytest.mark.parametrize('interpolation', ['neutral', 'bilinear'])
def test_masked_pixels_say_nothing(interpolation):
    """Neither those of the reference view nor those of the others, whatever they show."""
    masks = np.ones((len(ARC), PINHOLE.height, PINHOLE.width), bool)
    masks[:, 40:, 30:60] = False
    masks[1, :, :50] = False
    settings = DlvSettings(**ENDS, labels=15, interpolation=interpolation, window=9)
    one, other = (build_volume_of_views(masked_views(seed, masks), settings) for seed in (0, 1))
    np.testing.assert_array_equal(one.likelihood, other.likelihood)
    assert not one.likelihood[~masks[2]].any()
    plain = build_volume_of_views(masked_views(0, np.ones_like(masks)), settings)
    far = np.s_[:32, 68:]  # from what masks hide in the reference view
    assert one.likelihood[far].any(axis=2).mean() > 0.9
    off = np.abs(one.likelihood.argmax(axis=2) - plain.likelihood.argmax(axis=2))[far]
    assert (off <= 1).mean() > 0.9


def test_a_view_that_is_masked_all_over_is_as_none():
    masks = np.ones((len(ARC), PINHOLE.height, PINHOLE.width), bool)
    masks[[0, 4]] = False
    settings = DlvSettings(**ENDS, labels=9)
    found = build_volume_of_views(masked_views(0, masks), settings, 2)
    views = masked_views(0, np.ones_like(masks)).views
    expected = build_volume_of_views(PosedViews(views[1:4]), settings, 1)
    np.testing.assert_allclose(found.likelihood, expected.likelihood, atol=1e-7)


def test_the_reference_view_is_the_central_one():
    cameras = [on_arc(each) for each in (30, -28, 3, 15, -14)]
    views = views_of(cameras, [np.array([0, 0, 2.0])])
    assert central(views) == 2
    settings = DlvSettings(**ENDS, labels=5, truncate=True, maxima=1, neighbours=0)
    found = build_volume_of_views(views, settings)
    np.testing.assert_array_equal(found.camera.camera_to_reference, cameras[2])
    assert ((found.likelihood > 0).sum(axis=2) <= 1).all()
    assert build_volume_of_views(views, settings, 4).header.frame_id == 'room/view_4'


@pytest.mark.parametrize(('number', 'reference', 'changes', 'reason'), [
    (1, None, {}, 'one view only'), (2, 2, {}, r'no view 2 .* there are 2'),
    (2, -1, {}, 'no view -1'), (2, None, {'crop': (90, 0, 9, 9)}, 'crop'),
    (2, None, {'interpolation': 'phase'}, 'choose neutral or bilinear'),
    (2, None, {'layers': 'joint'}, 'choose volume'), (2, None, {'back_end': 'gl'}, 'choose auto')])
def test_what_makes_no_sense_is_refused_in_one_line(number, reference, changes, reason):
    views = views_of([on_arc(each) for each in ARC[:number]], [np.array([0, 0, 2.0])])
    with pytest.raises(VolumeError, match=reason) as caught:
        build_volume_of_views(views, DlvSettings(**ENDS, labels=5, **changes), reference)
    assert '\n' not in str(caught.value)


def test_few_labels_are_said(caplog):
    views = views_of([on_arc(each) for each in (0, 44)], [np.array([0, 0, 2.0])])
    needed = PosedPairs.from_views(views, (0, 0, 0, 0), 1).labels_needed(**ENDS)
    build_volume_of_views(views, DlvSettings(**ENDS, labels=7))
    assert f'set labels to {needed}' in caplog.text
