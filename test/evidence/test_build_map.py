"""Contour maps of pictures and light fields by the shipped network, where the truth is known."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.binning import bin_side, binned
from pmcl_ros.evidence.build_map import REFOCUSED, build_map
from pmcl_ros.evidence.contour_map import harmonics
from pmcl_ros.evidence.edges import view_edges
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.lightfield.posed_view import centre_view
from pmcl_ros.runtime.errors import LightFieldError, VolumeError

SIDE, RADIUS, MIDDLE = 224, 50.0, (110.0, 117.0)
CAMERA = Pinhole(SIDE, SIDE, 640.0, 640.0, 111.5, 111.5)
SETTINGS = DlvSettings(near=0.35, far=0.7, views=5)
DEPTH = 2 / (1 / 0.35 + 1 / 0.7)  # of the label in the middle [m]
AROUND = 2 * np.pi * (np.arange(64) + 0.5) / 64


def disc(middle, side=SIDE):
    """A shaded, dark disc before a pale plane with some texture, linear."""
    rng = np.random.default_rng(3)
    y, x = np.mgrid[:side, :side].astype(float)
    plane = 0.4 + 0.04 * cv2.GaussianBlur(rng.normal(size=(side, side)), (0, 0), 9) * 9
    away = np.hypot(x - middle[0], y - middle[1])
    inside = np.clip(RADIUS - away + 0.5, 0, 1)
    shaded = 0.1 + 0.08 * np.sqrt(np.clip(1 - (away / RADIUS) ** 2, 0, 1))
    picture = plane + inside * (shaded - plane)
    return np.repeat(picture[..., None], 3, axis=-1).astype(np.float32)


@pytest.fixture(scope='module')
def light_field():
    """5x5 views in which the disc is at `DEPTH`, and the plane at infinity."""
    positions = nominal_positions(5, 5)
    shift = CAMERA.fx * 0.0008 / DEPTH * positions
    views = np.stack([[disc(np.array(MIDDLE) - each) for each in row] for row in shift])
    return LightField(Header(stamp_ns=4), views,
                      ViewGrid(CAMERA, 0.0008, positions, np.ones((5, 5), np.float32)))


def odds_around(odds, label, radius=RADIUS, turned=0.0):
    """Log odds at points of a circle for normals turned away from the outward ones."""
    x = np.rint(MIDDLE[0] + radius * np.cos(AROUND)).astype(int) - round(
        CAMERA.cx - odds.pinhole.cx)
    y = np.rint(MIDDLE[1] + radius * np.sin(AROUND)).astype(int) - round(
        CAMERA.cy - odds.pinhole.cy)
    return (odds.tensor[y, x, label] * harmonics(AROUND + turned)).sum(axis=-1)


def test_a_contour_is_likely_where_it_is_and_with_the_object_on_its_side(light_field):
    odds = build_map(light_field, SETTINGS)
    assert odds.tensor.shape == (SIDE, SIDE, REFOCUSED, 5)
    assert odds.header == light_field.header
    here = odds_around(odds, 1)
    assert np.median(here) > 3
    assert (here > 0).mean() > 0.9
    for elsewhere in (RADIUS + 12, RADIUS - 12):
        assert np.median(odds_around(odds, 1, elsewhere)) < 0
    # A flat disc might be a hole: the object is on its inner side, by e nats.
    assert np.median(here - odds_around(odds, 1, turned=np.pi)) > 1
    assert odds.inside[117, 110, 1] > odds.inside[20, 20, 1]


def test_the_exposure_of_a_light_field_is_of_no_account(light_field):
    odds, darker = (build_map(replace(light_field, views=np.float32(light) * light_field.views),
                              SETTINGS) for light in (1, 0.25))
    np.testing.assert_allclose(darker.tensor, odds.tensor, atol=0.01)


def test_one_picture_has_one_label_for_all_depths(light_field):
    view = centre_view(light_field)
    odds = build_map(view, SETTINGS)
    assert (odds.tensor.shape, odds.inside.shape) == ((SIDE, SIDE, 1, 5), (SIDE, SIDE, 1))
    assert odds.depths.tolist() == [SETTINGS.far, SETTINGS.near]
    assert np.median(odds_around(odds, 0)) > 3
    assert view.picture.max() <= 1


def test_of_a_crop_the_surroundings_are_seen_too(light_field):
    whole = build_map(centre_view(light_field), SETTINGS)
    part = build_map(centre_view(light_field), SETTINGS.model_copy(
        update={'crop': (48, 64, 128, 112)}))
    assert part.tensor.shape == (112, 128, 1, 5)
    off = part.tensor - whole.tensor[64:176, 48:176]
    assert np.abs(off).mean() < 0.1 * np.abs(whole.tensor).mean()
    with pytest.raises(VolumeError, match='reaches out of views'):
        build_map(centre_view(light_field), SETTINGS.model_copy(
            update={'crop': (200, 0, 100, 100)}))


def test_of_a_large_object_there_is_a_map_with_larger_pixels_too(light_field):
    view = centre_view(light_field)
    assert build_map(view, SETTINGS, size=200.0).coarser is None
    assert build_map(light_field, SETTINGS, size=900.0).coarser is None
    least = build_map(view, SETTINGS, size=1e6).coarser.pinhole
    assert 64 <= least.width < 128  # the object is mostly out of view
    fine = build_map(view, SETTINGS, size=330.0)
    np.testing.assert_array_equal(fine.tensor, build_map(view, SETTINGS).tensor)
    assert bin_side(330.0) == 2
    halved = view.pinhole.resized(SIDE // 2, SIDE // 2)
    assert fine.coarser.pinhole == halved
    part = build_map(view, SETTINGS.model_copy(update={'crop': (48, 64, 132, 128)}), size=330.0)
    assert part.coarser.pinhole == halved.crop(24, 32, 66, 64)
    off = part.coarser.tensor - fine.coarser.tensor[32:96, 24:90]
    assert np.abs(off).mean() < 0.1 * np.abs(fine.coarser.tensor).mean()
    for change in ({'stride': 2}, {'crop': (0, 50, 0, 100)}, {'crop': (0, 50, 0, 50)}):
        small = build_map(view, SETTINGS.model_copy(update=change), size=1e6)
        assert small.coarser is None, change  # 64 px at least are left


@pytest.mark.parametrize('level', [0.0, 0.5])
def test_a_picture_of_one_colour_is_told(light_field, caplog, level):
    view = centre_view(light_field)
    build_map(view, SETTINGS)
    assert 'one colour' not in caplog.text
    blank = replace(view, picture=np.full_like(view.picture, level))
    build_map(blank, SETTINGS)
    assert 'a picture is of one colour: is the lens covered, is it dark, or are' in caplog.text
    build_map(replace(blank, name='b.png'), SETTINGS)
    assert 'b.png is of one colour: is the lens covered' in caplog.text
    below = np.where(np.arange(SIDE)[:, None, None] < 150, blank.picture, view.picture)
    part = SETTINGS.model_copy(update={'crop': (0, 20, 0, 120)})
    build_map(replace(view, picture=below, name='c.png'), part)
    assert 'c.png is of one colour' in caplog.text


def test_where_a_mask_is_false_a_map_says_nothing_and_edges_are_refused(light_field):
    view, mask = centre_view(light_field), np.ones((SIDE, SIDE), bool)
    mask[120:, 60:90] = False
    masked = replace(view, mask=mask)
    crop = DlvSettings(near=0.35, far=0.7, crop=(40, 30, 130, 150))
    for settings, kept in ((SETTINGS, mask), (crop, mask[30:180, 40:170])):
        whole, odds = build_map(view, settings), build_map(masked, settings)
        assert not odds.tensor[~kept].any()
        assert not odds.inside[~kept].any()
        np.testing.assert_array_equal(odds.tensor[kept], whole.tensor[kept])
    with pytest.raises(VolumeError, match='has a mask, which edges cannot leave out'):
        view_edges(masked, SETTINGS)


def test_a_mask_is_cut_and_binned_with_its_picture(light_field):
    mask = np.ones((SIDE, SIDE), bool)
    mask[101:, 60:90] = False
    view = replace(centre_view(light_field), mask=mask)
    np.testing.assert_array_equal(view.crop(50, 90, 30, 20).mask, mask[90:110, 50:80])
    larger = binned(view, 2).mask
    squares = mask.reshape(SIDE // 2, 2, SIDE // 2, 2)
    np.testing.assert_array_equal(larger, squares.all(axis=(1, 3)))
    with pytest.raises(LightFieldError, match='the mask is bool of shape'):
        replace(view, mask=mask[1:])
