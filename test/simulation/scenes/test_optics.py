import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_scenes import WHITE, light_along, plain_scene, pose_at

from pmcl_ros.simulation.scenes.materials import Clear, fresnel, reflected, refracted
from pmcl_ros.simulation.scenes.scene import Sheet, Solid
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.world import World

_INDEX = st.floats(1, 2.5)
_ANGLE = st.floats(0.01, np.pi / 2 - 0.01)


@settings(deadline=None)
@given(_ANGLE, _INDEX, _INDEX)
def test_fresnel_s_equations_in_angles(angle, n_from, n_to):
    share, inside = fresnel(np.cos(angle), n_from, n_to)
    sine = n_from / n_to * np.sin(angle)
    if sine >= 1:
        assert (share, inside) == (1, 0)
        return
    behind = np.arcsin(sine)
    if abs(angle - behind) < 1e-6:
        assert share < 1e-8  # at most the square of half of 1e-6 / tan 0.01
        return
    across = (np.sin(angle - behind) / np.sin(angle + behind)) ** 2
    along = (np.tan(angle - behind) / np.tan(angle + behind)) ** 2
    assert share == pytest.approx((across + along) / 2, rel=1e-6, abs=1e-12)
    assert inside == pytest.approx(np.cos(behind))


def test_as_much_is_reflected_from_behind():
    share, inside = fresnel(np.cos(0.7), 1.0, 1.5)
    assert fresnel(inside, 1.5, 1.0)[0] == pytest.approx(share)
    assert fresnel(1.0, 1.0, 1.5)[0] == pytest.approx(0.04)


@settings(deadline=None)
@given(_ANGLE, _INDEX, _INDEX, st.integers(0, 1000))
def test_snell_s_law_in_one_plane(angle, n_from, n_to, seed):
    rng = np.random.default_rng(seed)
    frame = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    normal, side = frame[0], frame[1]
    d = np.sin(angle) * side - np.cos(angle) * normal
    share, inside = fresnel(np.cos(angle), n_from, n_to)
    back = np.array(reflected(*d, *normal))
    assert back == pytest.approx(np.sin(angle) * side + np.cos(angle) * normal, abs=1e-12)
    if share < 1:
        on = np.array(refracted(*d, *normal, n_from / n_to, np.cos(angle), inside))
        assert np.linalg.norm(on) == pytest.approx(1)
        assert n_to * (on @ side) == pytest.approx(n_from * np.sin(angle))
        assert on @ frame[2] == pytest.approx(0, abs=1e-12)
        assert on @ normal < 1e-6


@pytest.mark.parametrize('angle', [0.2, 0.6, 1.0])
def test_a_slab_displaces_a_ray(angle):
    thick, index = 0.02, 1.5
    ramp = WHITE.copy()
    ramp[..., 0] = np.linspace(0, 1, ramp.shape[1])
    side = 1.0
    sheet = Sheet(pose_at(side / 2, 0, 0.5), (side, side), ramp, side)  # u = x, mod 1
    slab = _box(2.0, 2.0, thick)
    origin, direction = np.array([[0, 0, 0.0]]), np.array([[np.sin(angle), 0, np.cos(angle)]])
    solid = Solid(slab, (Clear(index),), pose_at(0, 0, 0.2))
    found = []
    for solids in ((), (solid,)):
        world = World.from_scene(plain_scene(solids, [sheet]))
        # Only the sheet is bright: what the slab mirrors is dark.
        world = world._replace(panorama=np.zeros_like(world.panorama))
        light = light_along(world, np.repeat(origin, 400, 0), np.repeat(direction, 400, 0))
        found.append(light[:, 0].sum() / light[:, 1].sum())
    behind = np.arcsin(np.sin(angle) / index)
    # The way along the sheet is shorter by what the slab bends.
    expected = thick * (np.tan(angle) - np.tan(behind))
    texels = ramp.shape[1] / (ramp.shape[1] - 1)
    # Light mirrored twice inside arrives farther off: the mean moves by its share.
    share = fresnel(np.cos(angle), 1.0, index)[0] ** 2
    moved = (found[0] - found[1]) * side / texels
    assert moved == pytest.approx(expected, abs=4e-5 + share * 2 * thick * np.tan(behind))


def _box(width, height, depth):
    mesh = trimesh.creation.box((width, height, depth))
    return Triangles(np.asarray(mesh.triangles), 0, 1)
