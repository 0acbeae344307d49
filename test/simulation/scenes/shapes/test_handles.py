"""Vessels with handles and spouts: tubes that begin in the wall, and names that say what there is.
"""

import numpy as np
import pytest
import trimesh

from pmcl_ros.simulation.scenes.shapes.handles import random_handled

COUNT = 30


@pytest.fixture(scope='module', params=[True, False], ids=['glass', 'opaque'])
def handled(request):
    rng = np.random.default_rng(5)
    return request.param, [random_handled(rng, request.param) for _ in range(COUNT)]


def tubes(thing):
    """The meshes of handle and spout."""
    return [trimesh.Trimesh(each.surface.corners.reshape(-1, 3), np.arange(
        3 * len(each.surface.corners)).reshape(-1, 3)) for each in thing.solids[1:]]


def ends(tube):
    """The middles of the flat ends of a tube, where more triangles meet than anywhere else."""
    meeting = np.bincount(tube.faces.ravel())
    return tube.vertices[meeting == meeting.max()]


def is_in_wall(vessel, points):
    """Whether points (n, 3) are in the material: a ray away from the axis crosses it oddly often.
    """
    r, z = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    r0, z0, r1, z1 = vessel.rings[:, :4].T
    with np.errstate(divide='ignore', invalid='ignore'):
        crossing = r0 + (z[:, None] - z0) / (z1 - z0) * (r1 - r0)
    meets = (np.minimum(z0, z1) <= z[:, None]) & (z[:, None] < np.maximum(z0, z1))
    return (meets & (crossing > r[:, None])).sum(axis=1) % 2 == 1


def test_both_ends_of_a_handle_and_one_of_a_spout_are_in_the_wall(handled):
    for thing in handled[1]:
        vessel = thing.solids[0].surface
        widest = vessel.rings[:, [0, 2]].max()
        for tube, inside, side in zip(tubes(thing), (2, 1), (1, -1), strict=False):
            assert tube.is_volume
            middles = ends(tube)
            assert len(middles) == 2
            np.testing.assert_allclose(middles[:, 1], 0, atol=1e-12)
            assert (side * middles[:, 0] > 0).all()  # the spout is opposite to the handle
            assert is_in_wall(vessel, middles).sum() == inside
            assert 0.01 < np.abs(tube.vertices[:, 0]).max() - widest < 0.07
            if inside == 1:  # liquid runs out where it ends
                assert np.hypot(*middles[:, :2].T).max() > widest


def test_a_name_says_what_the_object_has(handled):
    glass, things = handled
    spouts = 0
    for thing in things:
        material, rest = thing.name.split(' ', 1)
        kind, parts = rest.split(' with ')
        assert material == ('glass' if glass else 'opaque')
        assert kind in {'tumbler', 'jar', 'bowl', 'free'}
        assert parts == {2: 'handle', 3: 'handle and spout'}[len(thing.solids)]
        assert len({id(each.media[0]) for each in thing.solids}) == 1  # one piece
        spouts += parts.endswith('spout')
    assert spouts / COUNT == pytest.approx(0.3, abs=0.15)


def test_the_mesh_is_that_of_all_parts_and_has_no_symmetry(handled):
    for thing in handled[1]:
        parts = trimesh.Trimesh(thing.vertices, thing.faces, process=False).split()
        assert len(parts) == len(thing.solids)
        assert all(each.is_volume and each.volume > 0 for each in parts)
        assert thing.axis is None
        assert len(thing.discrete) == 1
        volumes = sorted(each.volume for each in parts)[:-1]
        np.testing.assert_allclose(volumes, sorted(each.volume for each in tubes(thing)))
