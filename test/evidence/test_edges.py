"""The edge volume on scenes whose edges are known."""

from dataclasses import replace

import edges_by_fourier
import numpy as np
import pytest
from dlv_fields import make_grid, noise_field, planes_field
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ndtr

from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.evidence.edges import build_edges, edge_volume, edges_from_likelihood
from pmcl_ros.evidence.energies import energies_across
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError

# As a capture would show them: 0.67 (far) to 2 px (near) for each view step.
GRID = make_grid((5, 5), (72, 64), 0.0006, focal=(1000, 1100))
DEPTHS = depth_labels(0.3, 0.9, 13)
INSIDE = np.s_[16:-16, 16:-16]


def centre_pixels(grid, row, column, depth):
    """Where in the centre view the pixels of a view see a plane at `depth` [m]."""
    pinhole = grid.pinhole
    y, x = np.indices((pinhole.height, pinhole.width)).astype(float)
    a, b = grid.positions[row, column] * grid.baseline * (pinhole.fx, pinhole.fy) / depth
    return x + a, y + b


def step_field(depth, angle=0.0, offset=0.0, grid=GRID):
    """A step from 0.3 to 0.7 of the light at `depth` [m], `offset` px from the image's centre.

    It is as sharp as pixels allow, as light is blurred: encoded it would be steepest on the dark
    side. Its normal is at `angle` from +x towards +y.
    """
    pinhole = grid.pinhole
    views = np.empty((*grid.shape, pinhole.height, pinhole.width, 3), np.float32)
    for place in np.ndindex(grid.shape):
        x, y = centre_pixels(grid, *place, depth)
        across = (x - pinhole.cx) * np.cos(angle) + (y - pinhole.cy) * np.sin(angle) - offset
        views[place] = (0.3 + 0.4 * ndtr(across / 0.6))[..., None]
    return LightField(Header(), views, grid, 1 / 2.4)


def energy(volume):
    return volume.tensor[..., 0] + volume.tensor[..., 1]


@pytest.mark.parametrize('label', [2, 5, 8, 10])
@pytest.mark.parametrize('offset', [0, 3.3])
@pytest.mark.parametrize('angle', [0, np.pi / 2, 0.6, -0.9])
def test_an_edge_is_at_its_depth_and_place_and_across_its_direction(label, offset, angle):
    volume = edge_volume(step_field(DEPTHS[label], angle, offset), DEPTHS)
    found = energy(volume)
    y, x = np.indices(found.shape[:2])
    pinhole = GRID.pinhole
    across = (x - pinhole.cx) * np.cos(angle) + (y - pinhole.cy) * np.sin(angle) - offset
    on_edge = np.abs(across) <= 0.5
    rays = found[INSIDE][on_edge[INSIDE]]
    best = rays.argmax(axis=1)
    assert (np.abs(best - label) <= 1).all()
    # between the labels, which are up to a quarter of a pixel apart: by the parabola
    before, here, after = (np.take_along_axis(rays, best[:, None] + k, 1)[:, 0]
                           for k in (-1, 0, 1))
    place = best + (after - before) / 2 / (2 * here - before - after)
    assert abs(place.mean() - label) < 0.2
    sharp = found[..., label]
    # The edge itself is the ridge of the energy, and away from it there is none.
    centre = (sharp * across)[INSIDE].sum() / sharp[INSIDE].sum()
    assert abs(centre) < 0.1
    away = np.abs(across) > 5
    assert sharp[INSIDE][away[INSIDE]].max() < 1e-3 * sharp[INSIDE].max()
    xx, yy, xy = (volume.tensor[..., label, k][INSIDE][on_edge[INSIDE]] for k in range(3))
    turned = 0.5 * np.arctan2(2 * xy, xx - yy) - angle
    assert (np.abs((turned + np.pi / 2) % np.pi - np.pi / 2) < 0.03).all()


def test_edges_at_two_depths_are_each_at_their_own():
    # Steps at column 24, far, and column 47, near; nothing else on either plane.
    far, near = DEPTHS[2], DEPTHS[10]
    views = np.empty((*GRID.shape, 64, 72, 3), np.float32)
    for place in np.ndindex(GRID.shape):
        behind = 0.3 + 0.3 * ndtr((centre_pixels(GRID, *place, far)[0] - 24) / 0.6)
        front = ndtr((centre_pixels(GRID, *place, near)[0] - 47) / 0.6)
        views[place] = ((1 - front) * behind + front * 0.2)[..., None]
    found = energy(edge_volume(LightField(Header(), views, GRID, 1.0), DEPTHS))[16:-16]
    # The other edge, blurred, is part of the contrast around and may move the best by one label.
    assert (np.abs(found[:, 24].argmax(axis=1) - 2) <= 1).all()
    assert (np.abs(found[:, 47].argmax(axis=1) - 10) <= 1).all()
    assert (found[:, 16:36, 2].argmax(axis=1) + 16 == 24).all()
    assert (found[:, 36:56, 10].argmax(axis=1) + 36 == 47).all()


def test_texture_of_two_planes_is_strongest_at_their_depths():
    field = planes_field(GRID, DEPTHS[2], DEPTHS[9], 36, highest=0.25)
    found = energy(edge_volume(field, DEPTHS))
    assert found[16:-16, 14:28].sum(axis=(0, 1)).argmax() == 2
    assert found[16:-16, 44:58].sum(axis=(0, 1)).argmax() == 9


@pytest.mark.parametrize('highest', [0.1, 0.2, 0.3])
def test_it_is_what_phase_shifts_give(highest):
    grid = make_grid((5, 5), (150, 130), 0.0006, 0.05, focal=(1000, 1100))
    # With a gamma of 1 the light itself has no higher frequencies, which neither form would keep.
    field = planes_field(grid, DEPTHS[3], DEPTHS[9], 75, gamma=1, highest=highest)
    away = np.s_[24:-24, 24:-24]  # from borders, where the one mirrors and the other leaks
    found = np.sqrt(energy(edge_volume(field, DEPTHS, 5)))[away]
    tensor = edges_by_fourier.edge_volume(field, DEPTHS, 5)
    expected = np.sqrt(tensor[..., 0] + tensor[..., 1])[away]
    assert np.sqrt(np.mean((found - expected) ** 2)) < 0.05 * np.sqrt(np.mean(expected ** 2))
    strong = expected.max(axis=2) > np.median(expected.max(axis=2))
    same = np.abs(found.argmax(axis=2) - expected.argmax(axis=2))[strong] <= 1
    assert same.mean() > 0.98


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 99), jitter=st.floats(0, 0.3))
def test_the_tensor_is_positive_semidefinite(seed, jitter):
    grid = make_grid((3, 3), (20, 17), 0.001, jitter, focal=(1000, 900), seed=seed)
    volume = edge_volume(noise_field(grid, seed), DEPTHS[:4], views=3)
    xx, yy, xy = np.moveaxis(volume.tensor, -1, 0)
    assert (xx >= 0).all()
    assert (yy >= 0).all()
    assert (xx * yy - xy ** 2 >= -1e-5 * (xx + yy) ** 2).all()


def test_noise_has_the_same_energy_at_every_label():
    grid = make_grid((5, 5), (128, 96), 0.0006, focal=(1000, 1100))
    found = energy(edge_volume(noise_field(grid, sigma=0.05), DEPTHS))[16:-16, 16:-16]
    mean = found.mean(axis=(0, 1))
    assert np.ptp(mean) < 0.03 * mean.mean()


def test_the_tensor_is_in_units_of_the_local_contrast():
    field = noise_field(GRID, 1)
    views = 0.5 + 0.2 * (field.views - 0.5)
    one = edge_volume(LightField(Header(), views, GRID, 1.0), DEPTHS[:5])
    other = edge_volume(LightField(Header(), 0.5 + 0.5 * (views - 0.5), GRID, 1.0), DEPTHS[:5])
    np.testing.assert_allclose(one.tensor, other.tensor, rtol=0.02, atol=1e-3)
    assert 0.3 < energy(one).mean() < 1


def test_what_is_suppressed_has_so_much_less_energy():
    edges, rng = edge_volume(noise_field(GRID, 1), DEPTHS[:5]), np.random.default_rng(0)
    height, width = edges.tensor.shape[:2]
    kept = rng.random((height, width), np.float32)
    y, x = np.indices((height, width)).reshape(2, -1)
    points = (np.column_stack([x, y]), np.tile([0.6, 0.8], (len(x), 1)),
              np.full(len(x), edges.depths[2]), np.zeros(1))
    whole, left = (energies_across(each, *points)[:, 0]
                   for each in (edges, edges.suppressed(kept)))
    np.testing.assert_allclose(left, kept.ravel() * whole, rtol=1e-4, atol=1e-6)


def test_how_bright_a_view_is_does_not_matter():
    field = noise_field(GRID, 2)
    dimmed = field.views.copy()
    dimmed[0, 3] *= 0.4
    found = edge_volume(replace(field, views=dimmed), DEPTHS[:3])
    np.testing.assert_allclose(found.tensor, edge_volume(field, DEPTHS[:3]).tensor, atol=1e-4)


def test_views_without_light_and_outer_views_are_left_out():
    dark = np.ones(GRID.shape, np.float32)
    dark[1, 1] = 0
    field = replace(noise_field(GRID, 3), grid=replace(GRID, weights=dark))
    changed = field.views.copy()
    changed[1, 1] = changed[0] = changed[:, 4] = 0.9
    found = edge_volume(replace(field, views=changed), DEPTHS[:3], views=3)
    np.testing.assert_array_equal(found.tensor, edge_volume(field, DEPTHS[:3], views=3).tensor)
    # and the others all count
    for place in ((1, 2), (1, 3), (2, 1), (2, 2), (2, 3), (3, 1), (3, 2), (3, 3)):
        changed = field.views.copy()
        changed[place] = changed[place][::-1]
        other = edge_volume(replace(field, views=changed), DEPTHS[:3], views=3)
        assert not np.allclose(found.tensor, other.tensor, atol=1e-2)


def test_no_light_at_all_is_refused():
    grid = replace(GRID, weights=np.zeros(GRID.shape, np.float32))
    with pytest.raises(VolumeError, match='none of the inner 7x7 views has light'):
        edge_volume(noise_field(grid), DEPTHS)


def test_black_views_have_no_edges():
    field = noise_field(make_grid())
    volume = edge_volume(replace(field, views=np.zeros_like(field.views)), DEPTHS)
    assert not volume.tensor.any()


def test_more_labels_than_opencv_has_channels():
    grid = make_grid((3, 3), (24, 20), 0.001, focal=(1000, 1000))
    field = noise_field(grid)
    volume = edge_volume(field, depth_labels(0.3, 0.9, 150))
    assert volume.tensor.shape == (20, 24, 150, 3)
    # Labels at the same depths as of a volume of a few, but for the median over all.
    few = edge_volume(field, depth_labels(0.3, 0.9, 2))
    np.testing.assert_allclose(volume.tensor[:, :, [0, -1]], few.tensor, rtol=0.1, atol=0.02)


def test_volume_carries_the_capture():
    field = noise_field(GRID)
    volume = edge_volume(field, DEPTHS)
    assert volume.header is field.header
    assert volume.pinhole == GRID.pinhole
    assert volume.tensor.dtype == np.float32
    np.testing.assert_array_equal(volume.depths, DEPTHS)


def test_crop_and_stride_carry_their_camera():
    field = noise_field(make_grid(size=(120, 60)))
    options = DlvSettings(edge_labels=5, views=3)
    whole = build_edges(field, options)
    part = build_edges(field, options.model_copy(update={'stride': 2, 'crop': (20, 10, 61, 40)}))
    assert whole.tensor.shape == (60, 120, 5, 3)
    assert whole.header is field.header
    assert not whole.from_likelihood
    np.testing.assert_allclose(whole.depths[[0, -1]], [0.9, 0.3])
    assert part.pinhole == field.grid.pinhole.crop(20, 10, 61, 40).subsample(2)
    np.testing.assert_array_equal(part.tensor, whole.tensor[10:50:2, 20:81:2])


def test_an_edge_volume_that_fits_no_memory_is_refused():
    grid = make_grid((1, 2), (2000, 2000), 0.0001)
    field = LightField(Header(), np.zeros((1, 2, 2000, 2000, 3), np.float32), grid)
    with pytest.raises(VolumeError, match=r'50 edge_labels of 2000x2000 px need 6\.7 GiB, more '
                       r'than 3: .* 2 times as large'):
        build_edges(field, DlvSettings(edge_labels=50, stride=4))


def test_too_few_labels_for_a_wide_baseline_are_logged(caplog):
    field = noise_field(make_grid((3, 3), (90, 80), 0.05, focal=(400, 400)))
    build_edges(field, DlvSettings(near=0.4, far=0.6, edge_labels=9, views=3))
    assert 'set edge_labels to 18 (it is 9), or near and far closer' in caplog.text


def likelihood(values, labels):
    pinhole = make_grid(size=values.shape[1::-1]).pinhole
    return DepthLikelihoodVolume(Header(3), values, depth_labels(0.3, 0.9, labels), pinhole)


@pytest.mark.parametrize(('labels', 'most', 'step'), [(75, 25, 3), (13, 25, 1), (40, 25, 2)])
def test_edges_from_likelihood_are_at_every_nth_label(labels, most, step):
    volume = likelihood(np.random.default_rng(0).random((9, 11, labels), np.float32), labels)
    edges = edges_from_likelihood(volume, most)
    assert edges.from_likelihood
    np.testing.assert_array_equal(edges.depths, volume.depths[::step])
    assert edges.tensor.shape == (9, 11, len(edges.depths), 3)
    assert edges.header is volume.header
    assert edges.pinhole == volume.pinhole


def test_edges_from_likelihood_are_where_and_at_the_depth_at_which_something_matches():
    values = np.zeros((30, 40, 15), np.float32)
    values[:, 20] = 0.1 * np.exp(-0.5 * ((np.arange(15) - 9) / 1.5) ** 2)
    edges = edges_from_likelihood(likelihood(values, 15))
    xx, yy, xy = np.moveaxis(edges.tensor, -1, 0)
    np.testing.assert_array_equal(xx, yy)
    assert not xy.any()
    assert (xx[:, 20].argmax(axis=1) == 9).all()
    assert not xx[:, np.arange(40) != 20].any()
    # twice the likelihood everywhere is the same contrast
    np.testing.assert_allclose(edges_from_likelihood(likelihood(2 * values, 15)).tensor,
                               edges.tensor, rtol=1e-4)


def test_a_flat_likelihood_has_no_edges():
    assert not edges_from_likelihood(likelihood(np.zeros((9, 11, 5), np.float32), 5)).tensor.any()
