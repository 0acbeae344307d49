"""Two layers fitted jointly: found far below a pixel of separation, and only where they are."""

import re
from dataclasses import replace

import numpy as np
import pytest
from dlv_fields import Texture, make_grid, noise_field

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.layers import Layers
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.superposition import Superposition, fit_superposition
from pmcl_ros.geometry.header import Header
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.runtime.errors import VolumeError

MIDDLE, SIZE, NOISE = 1.73, 50, 0.01  # px per view step, px, of the encoded intensity
SETTINGS = DlvSettings(near=1 / 2.1, far=1 / 1.4, labels=20, edge_labels=2)  # depth: 1 / (px/step)


def layered(separation, alpha, slope=0.0, noise=NOISE, seed=0):
    """Two textured planes, the nearer one giving alpha of the light, in 7x7 views.

    slope: by which the disparity grows [px per view step and px] to the right.
    """
    grid = make_grid((7, 7), (SIZE, SIZE), 1, focal=(1, 1))
    y, x = np.indices((SIZE, SIZE)).astype(float)
    textures, rng = (Texture(1, 0.3, 16), Texture(2, 0.3, 16)), np.random.default_rng(seed)
    views = np.empty((7, 7, SIZE, SIZE, 3), np.float32)
    middle = (SIZE - 1) / 2
    for place in np.ndindex(7, 7):
        a, b = grid.positions[place]
        light = rng.normal(0, noise, (SIZE, SIZE, 3))
        for share, side, texture in zip((alpha, 1 - alpha), (0.5, -0.5), textures, strict=True):
            step = MIDDLE + side * separation
            # u = x - a (step + slope (x - middle)), v = y - b (the same)
            seen = (x + a * (step - slope * middle)) / (1 - a * slope)
            light += share * texture(seen, y + b * (step + slope * (seen - middle)))
        views[place] = np.clip(light, 0, 1) ** 2.4
    return LightField(Header(), views, grid)


def known(field):
    """Of the rays that all views see."""
    return field[np.isfinite(field)]


@pytest.mark.parametrize(('separation', 'alpha'), [(0.2, 0.35), (0.2, 0.6), (0.4, 0.35)])
def test_layers_a_fraction_of_a_pixel_apart(separation, alpha):
    found = fit_superposition(layered(separation, alpha), SETTINGS)
    seen = np.isfinite(found.evidence)
    assert seen.mean() > 0.15
    assert (found.evidence[seen] > 0).mean() > 0.98
    for inverse, side in ((found.near, 0.5), (found.far, -0.5)):
        error = inverse[seen] - (MIDDLE + side * separation)
        assert abs(np.median(error)) < 0.02
        assert (np.abs(error) < separation / 2).mean() > 0.95
    # As Lemma 1 has it: the squares of the shares of the light.
    expected = alpha ** 2 / (alpha ** 2 + (1 - alpha) ** 2)
    assert np.median(found.share[seen]) == pytest.approx(expected, abs=0.12)


@pytest.mark.parametrize(('separation', 'alpha', 'slope', 'noise'), [
    (0, 0.5, 0, NOISE), (0, 0.5, 0, 0.05), (0.2, 1, 0.001, NOISE), (0.2, 0, -0.002, NOISE)])
def test_a_single_layer_stays_one(separation, alpha, slope, noise):
    found = fit_superposition(layered(separation, alpha, slope, noise), SETTINGS)
    assert (known(found.evidence) > 0).mean() < 0.01


def test_noise_is_no_layer():
    grid = make_grid((5, 5), (50, 45), 1, focal=(1, 1))
    found = fit_superposition(noise_field(grid, sigma=NOISE), SETTINGS)
    assert (known(found.evidence) > 0).mean() < 0.01


def test_more_noise_leaves_less_evidence():
    little, much = (np.median(known(fit_superposition(layered(0.2, 0.5, noise=noise), SETTINGS)
                                    .evidence)) for noise in (0.01, 0.04))
    assert little > much


def test_part_of_the_image_is_fitted_as_in_the_whole():
    field = layered(0.3, 0.5)
    whole = fit_superposition(field, SETTINGS)
    part = fit_superposition(field, SETTINGS.model_copy(
        update={'crop': (14, 12, 25, 21), 'stride': 2}))
    cut = np.s_[12:33:2, 14:39:2]
    np.testing.assert_allclose(part.near, whole.near[cut], atol=0.02)
    np.testing.assert_allclose(part.far, whole.far[cut], atol=0.02)
    assert (np.isfinite(part.evidence) == np.isfinite(whole.evidence[cut])).all()


def test_only_rays_with_one_surface_and_evidence_are_split():
    depths = np.array([[[0.5, np.nan], [0.6, 0.4], [0.7, np.nan], [np.nan, np.nan],
                        [0.5, np.nan]]], np.float32)
    layers = Layers(depths, np.where(np.isfinite(depths), np.float32(0.8), np.float32(np.nan)),
                    np.where(np.isfinite(depths), np.float32(0.4), np.float32(np.nan)))
    near, far = np.full((1, 5), 1 / 0.45, np.float32), np.full((1, 5), 1 / 0.55, np.float32)
    split = Superposition(near, far, np.float32([[0.25, 0.5, 0.5, 0.5, 0.5]]),
                          np.float32([[3, 3, -3, 3, np.nan]])).split(layers)
    np.testing.assert_allclose(split.depths[0, 0], [0.55, 0.45], rtol=1e-6)  # larger share first
    np.testing.assert_allclose(split.likelihood[0, 0], [0.6, 0.2], rtol=1e-6)
    np.testing.assert_allclose(split.sharpness[0, 0], [0.3, 0.1], rtol=1e-6)
    assert split.front[0, 0] == pytest.approx(0.45)
    assert split.behind[0, 0] == pytest.approx(0.55)
    np.testing.assert_array_equal(split.depths[0, 1:], depths[0, 1:])
    np.testing.assert_array_equal(layers.depths, depths)  # not changed


def test_a_volume_with_joint_layers():
    field = layered(0.2, 0.6)
    plain = build_volume(field, SETTINGS)
    joint = build_volume(field, SETTINGS.model_copy(update={'layers': 'joint'}))
    np.testing.assert_array_equal(plain.likelihood, joint.likelihood)
    np.testing.assert_array_equal(plain.depth_map(), joint.depth_map())
    inside = np.s_[17:-17, 17:-17]
    assert np.isfinite(plain.layers().behind[inside]).mean() < 0.1
    assert np.isfinite(joint.layers().behind[inside]).mean() > 0.9
    assert np.nanmedian(1 / joint.layers().front[inside]) == pytest.approx(MIDDLE + 0.1, abs=0.03)
    assert np.nanmedian(1 / joint.layers().behind[inside]) == pytest.approx(MIDDLE - 0.1, abs=0.03)


def test_views_of_other_exposures_show_the_same_layers():
    field = layered(0.3, 0.5)
    gains = np.random.default_rng(2).uniform(0.7, 1.3, field.views.shape[:2]).astype(np.float32)
    same, other = (fit_superposition(each, SETTINGS) for each in (field, replace(
        field, views=field.views * gains[..., None, None, None])))
    for one, two in zip((same.near, same.far, same.share), (other.near, other.far, other.share),
                        strict=True):
        np.testing.assert_allclose(two, one, atol=0.01)


def test_too_much_is_refused_with_advice():
    grid = make_grid((3, 3), (2000, 1500), 1, focal=(1, 1))
    field = LightField(Header(), np.zeros((3, 3, 1500, 2000, 3), np.float32), grid)
    with pytest.raises(VolumeError, match=r'2000x1500 px at .* a larger stride'):
        fit_superposition(field, DlvSettings(near=0.1, far=0.2))
    sizes = []
    for stride in (1, 2):
        with pytest.raises(VolumeError, match='GiB') as refused:
            fit_superposition(field, DlvSettings(near=0.01, far=0.2, stride=stride))
        sizes.append(float(re.search(r'take (.*) GiB', str(refused.value))[1]))
    assert sizes[0] == pytest.approx(4 * sizes[1], rel=0.01)


def test_layers_lie_between_near_and_far():
    """Of a layer at the limits, or beyond, the other one has a depth all the same."""
    limits = SETTINGS.model_copy(update={'near': 1 / 1.8, 'far': 1 / 1.7})
    found = fit_superposition(layered(0.4, 0.35), limits)
    for inverse in (found.near, found.far):
        assert known(inverse).min() >= np.float32(1.7)
        assert known(inverse).max() <= np.float32(1.8)
