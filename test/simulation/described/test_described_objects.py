"""Objects from YAML files: their walls, their content, and what is refused."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial import cKDTree

from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import ObjectModelError, SettingsError
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.described.profiles import eased, hollowed, outline, volume
from pmcl_ros.simulation.scenes.materials import AIR, Clear, Opaque
from pmcl_ros.simulation.scenes.shapes.revolution import Frusta
from pmcl_ros.simulation.scenes.shapes.triangles import Triangles
from pmcl_ros.simulation.scenes.shapes.vessels import outer_mesh, random_vessel

RADIUS, HEIGHT, WALL = 0.03, 0.08, 0.0025
ROOT = Path(__file__).parents[3]
CYLINDER = np.array([[0, 0], [RADIUS, 0], [RADIUS, HEIGHT], [0, HEIGHT]])
OPEN = {'mouth': {'z': HEIGHT, 'open': True}}
GLASS = {'material': 'glass', 'wall': WALL, **OPEN}
BOX = (0.06, 0.05, 0.08)


@pytest.fixture
def describe(tmp_path):
    """Writes a mesh in millimetres and its YAML file, and loads the object."""
    def load(mesh, appearance, **more):
        mesh.copy().apply_scale(1000).export(tmp_path / 'thing.stl')
        path = tmp_path / 'thing.yaml'
        path.write_text(yaml.safe_dump({'mesh': 'thing.stl', 'scale': 0.001,
                                        'appearance': appearance, **more}))
        return load_object(path)
    return load


def _revolved(profile):
    return trimesh.Trimesh(*outer_mesh(np.asarray(profile, float)), process=False)


def _box():
    box = trimesh.creation.box(BOX)
    return box.apply_translation([0, 0, BOX[2] / 2])


def _crossings(solid, origin, way):
    """(n,) distances at which a ray in a solid's frame meets its rings or triangles, ascending."""
    surface = solid.surface
    if isinstance(surface, Frusta):
        # Along x at z the radii of the rings are the distances from the axis.
        (r0, z0), (r1, z1) = surface.rings[:, 0:2].T, surface.rings[:, 2:4].T
        at = (np.minimum(z0, z1) <= origin[2]) & (origin[2] < np.maximum(z0, z1))
        found = r0[at] + (origin[2] - z0[at]) / (z1[at] - z0[at]) * (r1[at] - r0[at])
    else:
        mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(surface.corners))
        points, *_ = mesh.ray.intersects_location([origin], [way])
        found = np.unique(np.round((points - origin) @ way, 9))
    return np.sort(found)


def _volume(surface, medium):
    """Of a medium [m^3], by the divergence theorem over all interfaces that it has."""
    if not isinstance(surface, Frusta):
        parts = np.einsum('ni,ni->n', surface.corners[:, 0],
                          np.cross(surface.corners[:, 1], surface.corners[:, 2])) / 6
        return float(parts.sum()) * ((surface.inside == medium) - (surface.outside == medium))
    r0, z0, r1, z1 = surface.rings[:, :4].T
    parts = np.pi / 3 * (z1 - z0) * (r0 * r0 + r0 * r1 + r1 * r1)
    return float((parts * ((surface.media[:, 1] == medium).astype(int)
                           - (surface.media[:, 0] == medium))).sum())


def _total(thing, medium):
    return sum(_volume(each.surface, medium) for each in thing.solids)


def test_the_outline_of_a_mesh_is_exact_at_its_vertices():
    # A foot with a step, a stem, a bowl, and a bottom that is hollow from below.
    profile = np.array([[0, 0.006], [0.01, 0.004], [0.02, 0], [0.03, 0], [0.03, 0.008],
                        [0.004, 0.008], [0.004, 0.05], [0.02, 0.06], [0.035, 0.1], [0, 0.1]])
    found = outline(*outer_mesh(profile))
    for corner in profile:
        assert np.linalg.norm(found - corner, axis=1).min() < 2e-6
    assert volume(found) == pytest.approx(volume(profile), rel=1e-4)
    # A cavity in the mesh does not count.
    cup = np.array([[0, 0], [0.03, 0], [0.03, 0.08], [0.027, 0.08], [0.027, 0.003], [0, 0.003]])
    assert volume(outline(*outer_mesh(cup))) == pytest.approx(np.pi * 0.03 ** 2 * 0.08, rel=1e-4)


@pytest.mark.parametrize('seed', range(12))
def test_any_vessel_keeps_its_wall_and_its_crest(seed):
    rng = np.random.default_rng(seed)
    vessel, wall, is_open = random_vessel(rng), rng.uniform(0.0008, 0.004), seed % 3 > 0
    found = outline(*outer_mesh(vessel.closed))
    assert volume(found) == pytest.approx(volume(vessel.closed), rel=1e-3)
    made = hollowed(found, wall, is_open, None)
    assert made.is_sealed != is_open
    assert made.outer[:, 1].max() == pytest.approx(vessel.outer[-1, 1], abs=1e-6)
    # Within three walls of the mouth its rim may be rounder than the wall is thick.
    top = found[-1, 1] - (3 * wall if is_open else 0)
    away = cKDTree(_dense(found[:-1] if is_open else found)).query(
        _dense(made.inner[made.inner[:, 1] < top]))[0]
    assert away.min() > wall - 3e-5


def _dense(profile):
    """The same curve in steps of some 20 um."""
    way = np.append(0, np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1)))
    at = np.linspace(0, way[-1], 20000)
    return np.stack([np.interp(at, way, profile[:, k]) for k in (0, 1)], axis=1)


def test_long_straight_pieces_bend_near_their_ends_only():
    profile = np.array([[0, 0], [0.03, 0], [0.031, 0.0005], [0.031, 0.1], [0, 0.1]])
    found = eased(profile)
    assert volume(found) == pytest.approx(volume(profile), rel=1e-12)
    ring = next(each for each in Frusta.from_profile(found, 0, 1).rings
                if each[1] < 0.05 < each[3])
    np.testing.assert_allclose(ring[4:], [1, 0, 1, 0], atol=1e-12)


def test_a_cylinder_gets_a_wall_a_floor_and_a_round_rim(describe):
    thing = describe(_revolved(CYLINDER), GLASS)
    solid, = thing.solids
    assert isinstance(solid.surface, Frusta)
    for z in (0.01, 0.04, 0.07):
        inner, outer = _crossings(solid, np.array([0, 0, z]), np.array([1.0, 0, 0]))
        assert outer == pytest.approx(RADIUS, abs=1e-6)
        assert outer - inner == pytest.approx(WALL, abs=1e-6)
    cavity = np.pi * (RADIUS - WALL) ** 2 * (HEIGHT - WALL)
    # Less two corners of the rim, more the fillet of the floor: at most 0.5 ml in 48.
    glass = np.pi * RADIUS ** 2 * HEIGHT - cavity
    assert _total(thing, 1) == pytest.approx(glass, rel=0.01)
    rings = solid.surface.rings
    crest = rings[np.argmax(rings[:, 3]), 2:4]
    assert crest[1] == pytest.approx(HEIGHT, abs=1e-6)
    assert RADIUS - WALL < crest[0] < RADIUS - 0.3 * WALL
    assert thing.axis.tolist() == [0, 0, 1]
    assert thing.vertices[:, 2].max() == pytest.approx(HEIGHT)


def test_a_cone_keeps_its_thickness_across_the_wall(describe):
    cone = np.array([[0, 0], [0.02, 0], [0.04, 0.08], [0, 0.08]])
    solid, = describe(_revolved(cone), GLASS).solids
    inner, outer = _crossings(solid, np.array([0, 0, 0.05]), np.array([1.0, 0, 0]))
    across = np.cos(np.arctan(0.25))  # of the horizontal distance
    assert (outer - inner) * across == pytest.approx(WALL, abs=5e-6)


def test_the_axis_may_be_another_than_z(describe):
    mesh = _revolved(CYLINDER)
    mesh.vertices = mesh.vertices[:, [1, 2, 0]]  # z becomes y
    thing = describe(mesh, GLASS)
    assert thing.up == pytest.approx([0, 1, 0])
    solid, = thing.solids
    assert solid.pose[:3, :3] @ [0, 0, 1] == pytest.approx([0, 1, 0])
    rest = thing.at_rest(np.random.default_rng(0))
    plain = describe(_revolved(CYLINDER), GLASS).solids[0]
    assert volume(solid.surface.rings[:, :2]) == pytest.approx(volume(plain.surface.rings[:, :2]))
    assert (thing.vertices @ rest[2, :3] + rest[2, 3]).min() > -1e-9


def test_below_the_floor_it_is_massive(describe):
    thing = describe(_revolved(CYLINDER), GLASS | {'floor': 0.02})
    rings = thing.solids[0].surface.rings
    assert rings[-1, 2:4] == pytest.approx([0, 0.02], abs=1e-6)


def test_a_closed_hollow_holds_its_own_gas(describe):
    thing = describe(_revolved(CYLINDER), GLASS | {'mouth': {'open': False}})
    cavity = np.pi * (RADIUS - WALL) ** 2 * (HEIGHT - 2 * WALL)
    assert _total(thing, 3) == pytest.approx(cavity, rel=0.01)
    assert _total(thing, 1) + _total(thing, 3) == pytest.approx(
        np.pi * RADIUS ** 2 * HEIGHT, rel=1e-4)
    assert thing.solids[0].media[2] == AIR


def test_a_liquid_stands_to_its_level(describe):
    plain = describe(_revolved(CYLINDER), GLASS)
    thing = describe(_revolved(CYLINDER), GLASS | {'liquid': {'level': 0.05, 'kind': 'coloured'}})
    assert thing.way == 'upright'
    liquid = np.pi * (RADIUS - WALL) ** 2 * (0.05 - WALL)
    assert _total(thing, 2) == pytest.approx(liquid, rel=0.01)
    assert _total(thing, 1) == pytest.approx(_total(plain, 1), rel=1e-6)
    assert thing.solids[0].media[1].absorption[2] > 10
    with pytest.raises(ObjectModelError, match='give a level between'):
        describe(_revolved(CYLINDER), GLASS | {'liquid': {'level': 0.2}})


def test_an_inner_surface_is_taken_as_it_is(describe, tmp_path):
    inner = np.array([[0, 0.01], [0.02, 0.01], [0.025, HEIGHT], [0, HEIGHT]])
    _revolved(inner).apply_scale(1000).export(tmp_path / 'inner.stl')
    thing = describe(_revolved(CYLINDER), {'material': 'glass', 'inner': 'inner.stl', **OPEN})
    expected = volume(CYLINDER) - volume(inner)
    assert _total(thing, 1) == pytest.approx(expected, rel=0.01)
    _revolved(inner * [1.5, 1]).apply_scale(1000).export(tmp_path / 'inner.stl')
    with pytest.raises(ObjectModelError, match='outside of the outer one'):
        describe(_revolved(CYLINDER), {'material': 'glass', 'inner': 'inner.stl', **OPEN})


def test_a_box_gets_a_wall_by_its_triangles(describe):
    thing = describe(_box(), GLASS)
    solid, = thing.solids
    for way, size in ((np.array([1.0, 0, 0]), BOX[0]), (np.array([0, 1.0, 0]), BOX[1])):
        inner, outer = _crossings(solid, np.array([1e-4, 2e-4, 0.04]), way)
        assert outer == pytest.approx(size / 2, abs=3e-4)
        assert outer - inner == pytest.approx(WALL, abs=1e-6)
    cavity = (BOX[0] - 2 * WALL) * (BOX[1] - 2 * WALL) * (BOX[2] - WALL)
    assert _total(thing, 1) == pytest.approx(np.prod(BOX) - cavity, rel=1e-4)
    down = _crossings(solid, np.array([1e-4, 2e-4, 0.5]), np.array([0, 0, -1.0]))
    assert 0.5 - down == pytest.approx([WALL, 0], abs=1e-6)  # the lid is gone


@pytest.mark.parametrize('is_open', [True, False])
def test_a_box_holds_a_liquid(describe, is_open):
    mouth = {'mouth': {'z': HEIGHT} if is_open else {'open': False}}
    plain = describe(_box(), GLASS | mouth)
    thing = describe(_box(), GLASS | mouth | {'liquid': {'level': 0.05}})
    inner = (BOX[0] - 2 * WALL) * (BOX[1] - 2 * WALL)
    assert _total(thing, 2) == pytest.approx(inner * (0.05 - WALL), rel=1e-4)
    assert _total(thing, 1) == pytest.approx(_total(plain, 1), rel=1e-4)
    if not is_open:
        assert _total(thing, 3) == pytest.approx(inner * (HEIGHT - WALL - 0.05), rel=1e-4)


@pytest.mark.parametrize(('sides', 'surface'), [(6, Triangles), (8, Triangles), (48, Frusta)])
def test_a_vase_with_sides_keeps_them(describe, sides, surface):
    vase = trimesh.creation.cylinder(RADIUS, HEIGHT, sections=sides)
    thing = describe(vase.apply_translation([0, 0, HEIGHT / 2]), GLASS)
    assert (thing.axis is None) == (surface is Triangles)
    solid, = thing.solids
    assert isinstance(solid.surface, surface)
    if surface is Triangles:  # glass between two prisms
        slim = np.cos(np.pi / sides)
        area = sides * slim * np.sin(np.pi / sides) * RADIUS ** 2
        inner = area * (1 - WALL / (RADIUS * slim)) ** 2
        assert _total(thing, 1) == pytest.approx(area * HEIGHT - inner * (HEIGHT - WALL), rel=1e-4)


def test_an_offset_of_a_smooth_mesh_keeps_its_distance(describe):
    # A vessel without rotational symmetry: an ellipse is stretched from a cylinder.
    mesh = _revolved(np.array([[0, 0], [0.02, 0], [0.03, 0.04], [0.03, 0.08], [0, 0.08]]))
    mesh.vertices[:, 0] *= 1.6
    solid, = describe(mesh, GLASS).solids
    inner, outer = _crossings(solid, np.array([0, 0, 0.06]), np.array([0, 1.0, 1e-9]))
    assert outer - inner == pytest.approx(WALL, abs=5e-5)


def test_faces_at_a_sharp_edge_may_be_narrower_than_the_wall(describe):
    fine, wall = _box(), 0.006
    for _ in range(4):
        fine = fine.subdivide()
    thing = describe(fine, {**GLASS, 'wall': wall})
    cavity = (BOX[0] - 2 * wall) * (BOX[1] - 2 * wall) * (BOX[2] - wall)
    assert _total(thing, 1) == pytest.approx(fine.volume - cavity, rel=1e-5)


@pytest.mark.parametrize('fineness', [1, 4])  # more faces than are eroded as they are
def test_roundings_may_be_narrower_than_the_wall(describe, fineness):
    ball = trimesh.creation.icosphere(fineness, 0.001).vertices
    corners = np.array([[x, y, z] for x in (-0.029, 0.029) for y in (-0.024, 0.024)
                        for z in (0.001, 0.079)])
    mesh = trimesh.convex.convex_hull((ball + corners[:, None]).reshape(-1, 3))
    solid, = describe(mesh, GLASS).solids
    for way, half in ((np.array([1.0, 1e-9, 0]), 0.03), (np.array([1e-9, 1.0, 0]), 0.025)):
        inner, outer = _crossings(solid, np.array([1e-4, 2e-4, 0.04]), way)
        assert outer == pytest.approx(half, abs=3e-4)
        assert outer - inner == pytest.approx(WALL, abs=5e-5)
    down = _crossings(solid, np.array([1e-4, 2e-4, 0.5]), np.array([0, 0, -1.0]))
    assert 0.5 - down == pytest.approx([WALL, 0], abs=5e-5)


def test_a_massive_mesh_is_the_material(describe):
    thing = describe(_revolved(CYLINDER), {'material': 'acrylic', 'solid': True})
    assert isinstance(thing.solids[0].surface, Frusta)
    assert _total(thing, 1) == pytest.approx(volume(CYLINDER), rel=1e-4)
    # A mesh with a cavity of its own keeps it.
    cup = np.array([[0, 0], [0.03, 0], [0.03, 0.08], [0.027, 0.08], [0.027, 0.003], [0, 0.003]])
    thing = describe(_revolved(cup), {'material': 'acrylic', 'solid': True})
    assert _total(thing, 1) == pytest.approx(_revolved(cup).volume, rel=1e-4)


def test_materials_have_defaults_that_can_be_told_otherwise(describe, tmp_path):
    def medium(**appearance):
        return describe(_box(), {'solid': True, **appearance}).solids[0].media[0]
    assert medium(material='glass') == Clear(1.52, (6.0, 3.0, 5.0))
    assert medium(material='pet', index=1.6, absorption=[1, 2, 3]) == Clear(1.6, (1, 2, 3))
    assert medium(material='frosted').roughness > 0.2
    assert min(medium(material='tinted').absorption) > 20
    picture = np.zeros((40, 60, 3), np.uint8)
    picture[:20] = (0, 0, 255)  # the upper half is red
    cv2.imwrite(str(tmp_path / 'label.png'), picture)
    opaque = describe(_box(), {'material': 'opaque', 'texture': 'label.png'}).solids[0].media[0]
    assert isinstance(opaque, Opaque)
    assert opaque.texture[10, 0] == pytest.approx([1, 0, 0])
    assert opaque.texture[-10, 0] == pytest.approx([0, 0, 0])


@pytest.mark.parametrize(('appearance', 'line'), [
    ({'material': 'glass'}, 'wall: 0.0025'),
    ({'material': 'glass', 'wall': WALL}, r'mouth: \{z: 0.08, open: true\}'),
    ({**GLASS, 'mouth': {'z': 0.06}}, r'mouth: \{z: 0.08, open: true\}'),
    ({'material': 'opaque', 'texture': 'no.png'}, 'texture')])
def test_what_is_not_told_is_asked_for_in_one_line(describe, appearance, line):
    for mesh in (_revolved(CYLINDER), _box()):
        with pytest.raises(ObjectModelError, match=line) as refused:
            describe(mesh, appearance)
        assert '\n' not in str(refused.value)
        assert 'thing.yaml' in str(refused.value) or 'no.png' in str(refused.value)


def test_a_wall_that_does_not_fit_is_refused(describe):
    thick = GLASS | {'wall': 0.031}
    with pytest.raises(ObjectModelError, match='leaves no cavity'):
        describe(_revolved(CYLINDER), thick)
    with pytest.raises(ObjectModelError, match=r'inner: inner\.stl'):
        describe(_box(), thick)
    with pytest.raises(ObjectModelError, match='not closed'):
        describe(_box().submesh([range(10)], append=True), GLASS)


@pytest.mark.parametrize(('appearance', 'line'), [
    ({'material': 'brass'}, 'material'),
    ({**GLASS, 'colour': [1, 0, 0]}, 'absorption'),
    ({**GLASS, 'solid': True}, 'one of'),
    ({**GLASS, 'mouth': {'open': True}}, 'height z'),
    ({'material': 'glass', 'mouth': {'z': 0.1}}, "mouth is .* write 'wall: .*, too$"),
    ({'material': 'glass', 'solid': True, 'floor': 0.01}, 'floor is .* in place of solid')])
def test_contradictions_are_refused(describe, appearance, line):
    with pytest.raises(SettingsError, match=line):
        describe(_box(), appearance)


def test_the_localizer_ignores_the_appearance(describe, tmp_path):
    thing = describe(_revolved(CYLINDER), GLASS)
    model = ObjectModel.load(tmp_path / 'thing.yaml')
    np.testing.assert_array_equal(model.vertices, thing.vertices)
    bare = tmp_path / 'bare.yaml'
    bare.write_text('mesh: thing.stl\nscale: 0.001\n')
    with pytest.raises(ObjectModelError, match=r'made of: write in it appearance: \{material'):
        load_object(bare)
    with pytest.raises(ObjectModelError, match=r'write a YAML file with mesh: thing\.stl and app'):
        load_object(tmp_path / 'thing.stl')


def test_shipped_objects_are_described():
    shell = load_object(ROOT / 'config/objects/frosted_bottle.yaml')
    outside = trimesh.load_mesh(ROOT / 'config/objects/bottle.stl')
    assert shell.solids[0].media[0].roughness > 0
    # Closed, 3 mm thick: a little less glass than surface times thickness.
    assert _total(shell, 1) == pytest.approx(0.003 * outside.area, rel=0.08)
    stemmed = load_object(ROOT / 'models/wine_glass.yaml')
    assert _crossings(stemmed.solids[0], np.array([0, 0, -0.03]), [1, 0, 0]) == pytest.approx(
        [0.004], abs=2e-4)  # a massive stem
    assert np.diff(_crossings(stemmed.solids[0], np.array([0, 0, 0.03]), [1, 0, 0])) == (
        pytest.approx([0.0015], abs=2e-4))  # a thin wall
    block = load_object(ROOT / 'config/objects/block.yaml')
    assert _total(block, 1) == pytest.approx(0.08 * 0.055 * 0.04)
    assert len(ObjectModel.load(ROOT / 'config/objects/block.yaml').symmetry.discrete) == 4


def test_a_wall_never_moves_the_outside(describe):
    """Of a cone, whose outline a wall beyond its axis leaves without a cavity."""
    cone = np.array([[0, 0], [0.027, 0], [0.036, 0.08], [0, 0.08]])
    thin = describe(_revolved(cone), {**GLASS, 'wall': 0.002}).solids[0].surface
    assert _widest(thin, 0.079) == pytest.approx(0.03589, abs=1e-5)
    for wall in (0.045, 0.079, 0.081, 0.1):
        with pytest.raises(ObjectModelError, match='leaves no cavity'):
            describe(_revolved(cone), {**GLASS, 'wall': wall})
    vessel = describe(_revolved(cone), {**GLASS, 'wall': 0.028}).solids[0].surface
    for height in (0.001, 0.04, 0.0784):
        assert _widest(vessel, height) == pytest.approx(
            np.interp(height, [0, 0.08], [0.027, 0.036]), abs=5e-5)


def _widest(surface, height):
    (r0, z0), (r1, z1) = surface.rings[:, 0:2].T, surface.rings[:, 2:4].T
    at = (np.minimum(z0, z1) <= height) & (height <= np.maximum(z0, z1)) & (z0 != z1)
    return (r0[at] + (height - z0[at]) / (z1[at] - z0[at]) * (r1[at] - r0[at])).max()


@pytest.mark.parametrize('mesh', [_revolved(CYLINDER), _box()])
@pytest.mark.parametrize(('more', 'line'), [
    ({'floor': 8.0}, r'its floor is 8 m high, the object ends at 0\.08 m'),
    ({'floor': 0.0801}, r'its floor is 0\.0801 m high, the object ends at 0\.08 m'),
    ({'liquid': {'level': 50.0}}, r'reaches to 50 m, its cavity from 0\.0025 to 0\.08 m'),
    ({'liquid': {'level': 0.0801}}, r'reaches to 0\.0801 m, its cavity from 0\.0025 to 0\.08 m')])
def test_heights_that_are_not_in_the_object_are_named(describe, mesh, more, line):
    with pytest.raises(ObjectModelError, match=line):
        describe(mesh, GLASS | more)


@pytest.mark.parametrize('mesh', [_revolved(CYLINDER), _box()])
def test_an_inner_surface_that_is_the_outer_one_leaves_no_wall(describe, mesh):
    with pytest.raises(ObjectModelError, match='the cavity leaves no wall'):
        describe(mesh, {'material': 'glass', 'inner': 'thing.stl', **OPEN})


def test_a_handle_stays_a_handle_whatever_axis_is_declared(describe, caplog):
    handle = trimesh.creation.box((0.03, 0.01, 0.04)).apply_translation([0.04, 0, 0.04])
    mug = trimesh.boolean.union([_revolved(CYLINDER), handle], engine='manifold')
    thing = describe(mug, {'material': 'acrylic', 'solid': True},
                     symmetries_continuous=[{'axis': [0, 0, 1]}])
    assert _total(thing, 1) == pytest.approx(mug.volume, rel=1e-3)
    assert 'its declared axis of symmetry moves its surface by up to' in caplog.text


def test_faces_that_look_inwards_are_turned(describe, caplog):
    caplog.set_level('INFO')
    inverted, mixed = _box(), _box()
    inverted.invert()
    mixed.faces[0] = mixed.faces[0][::-1]
    assert [_total(describe(each, GLASS), 1) for each in (inverted, mixed)] == (
        pytest.approx([_total(describe(_box(), GLASS), 1)] * 2))
    assert [each.getMessage().rpartition(': ')[2] for each in caplog.records
            if 'outwards' in each.getMessage()] == ['turned 12 of its 12 faces outwards',
                                                  'turned 1 of its 12 faces outwards']


def test_a_surface_with_no_inside_is_no_object(describe):
    """A projective plane: closed, but it has one side only."""
    corners = trimesh.creation.icosphere(0, 0.05).vertices[[0, 1, 2, 4, 6, 8]]
    faces = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1],
             [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2], [5, 1, 3]]
    with pytest.raises(ObjectModelError, match=r'its mesh has no inside: .* remesh it'):
        describe(trimesh.Trimesh(corners, faces, process=False), GLASS)


def _handle(x):
    return trimesh.creation.box((0.03, 0.01, 0.04)).apply_translation([x, 0, 0.04])


@pytest.mark.parametrize(('x', 'overlap'), [(0.035, 0.01), (0.05, 0)])
@pytest.mark.parametrize('cavity', [0, 0.02])
def test_bodies_that_overlap_are_one(describe, x, overlap, cavity):
    """As a mug in CAD, whose handle reaches into its body."""
    hole = trimesh.creation.box([cavity] * 3).apply_translation([0, 0, 0.04])
    hole.invert()
    parts = [_box(), _handle(x), *([hole] if cavity else [])]
    thing = describe(trimesh.util.concatenate(parts), {'material': 'glass', 'solid': True})
    assert _total(thing, 1) == pytest.approx(
        _box().volume + (0.03 - overlap) * 0.01 * 0.04 - cavity ** 3, rel=1e-5)


def test_the_wall_of_bodies_that_overlap_goes_around_both(describe):
    thing = describe(trimesh.util.concatenate([_box(), _handle(0.035)]), GLASS)
    solid, = thing.solids
    for origin in ([-0.1, 1e-4, 0.0402], [-0.1, 1e-4, 0.07]):
        found = _crossings(solid, np.array(origin), np.array([1.0, 0, 0])) - 0.1
        end = 0.05 if origin[2] < 0.06 else 0.03
        np.testing.assert_allclose(found, [-0.03, WALL - 0.03, end - WALL, end], atol=2e-5)


@pytest.mark.parametrize('sides', [[1], [1, -1]])
def test_a_wall_leaves_handles_massive(describe, sides):
    """Bars of 14 mm, closed to a loop by the vessel, and by one of 12 mm."""
    loop = trimesh.boolean.difference([
        trimesh.creation.box((0.05, 0.014, 0.06)).apply_translation([0.04, 0, 0.04]),
        trimesh.creation.box((0.024, 0.03, 0.032)).apply_translation([0.041, 0, 0.04])],
        engine='manifold')
    handles = [loop.copy().apply_transform(trimesh.transformations.rotation_matrix(
        np.pi * (side < 0), [0, 0, 1])) for side in sides]
    mug = trimesh.boolean.union([_box(), *handles], engine='manifold')
    thing = describe(mug, GLASS)
    massive = _total(describe(_box(), GLASS), 1) + mug.volume - _box().volume
    assert _total(thing, 1) == pytest.approx(massive, rel=0.01)
    solid, = thing.solids
    # Through the loop, and along a bar, into which the cavity may bulge by less than the wall.
    for height, crossed, off in ((0.0401, [-WALL, 0, 0.023, 0.035], 1e-5),
                                 (0.063, [-WALL, 0.035], WALL)):
        ray = _crossings(solid, np.array([1e-3, 2e-3, height]), np.array([1.0, 1e-7, 0]))
        np.testing.assert_allclose(ray + 1e-3 - BOX[0] / 2, crossed, atol=off)


@pytest.mark.parametrize('kind', ['closed', 'massive'])
def test_a_ring_is_not_filled(describe, kind):
    wall = 0.004
    ring = trimesh.creation.torus(0.04, 0.012, major_sections=36, minor_sections=8)
    thing = describe(ring, {'material': 'glass', **(
        {'solid': True} if kind == 'massive' else {'wall': wall, 'mouth': {'open': False}})})
    left = 1 - wall / (0.012 * np.cos(np.pi / 8))  # of the octagon's radius
    inner = ring.volume * left ** 2 if kind == 'closed' else 0
    assert _total(thing, 1) == pytest.approx(ring.volume - inner, rel=5e-3)
    assert _total(thing, 3) == pytest.approx(inner, rel=5e-3)


def test_what_is_massive_must_be_closed(describe):
    open_top = _revolved(CYLINDER)
    open_top.update_faces(open_top.triangles_center[:, 2] < HEIGHT - 1e-6)
    with pytest.raises(ObjectModelError, match='its mesh is not closed'):
        describe(open_top, {'material': 'opaque'})
    soup = _revolved(CYLINDER)
    soup.unmerge_vertices()
    soup.vertices *= np.random.default_rng(0).uniform(1, 1.001, soup.vertices.shape)
    with pytest.raises(ObjectModelError, match='its faces share no corners: merge close vertices'):
        describe(soup, {'material': 'opaque'})


def test_up_may_be_long(describe):
    for length in (1e-3, 1.0, 1e300):
        thing = describe(_box(), {**GLASS, 'up': [0, 0, length]})
        assert thing.up == pytest.approx([0, 0, 1])


@pytest.mark.parametrize(('profile', 'wall'), [
    ([[0, 0], [.03, 0], [.06, .03], [.08, .04], [.1, .045], [0, .045]], 0.003),
    ([[0, 0], [.004, 0], [.004, .085], [.06, .12], [0, .12]], 0.0015),
    ([[0, 0], [.02, 0], [.066, .08], [0, .08]], 0.002)], ids=['bowl', 'martini', 'leaning'])
def test_a_rim_of_a_wall_that_leans_stays_where_it_is(describe, profile, wall):
    """It ends in a wedge, of which a round rim may take a millimetre or so."""
    profile = np.array(profile)
    thing = describe(_revolved(profile), {
        'material': 'glass', 'wall': wall, 'mouth': {'z': float(profile[-1, 1])}})
    rings = thing.solids[0].surface.rings
    assert rings[:, [0, 2]].max() == pytest.approx(profile[:, 0].max(), abs=0.002)
    assert rings[:, [1, 3]].max() == pytest.approx(profile[-1, 1], abs=0.002)


def test_a_liquid_that_leaves_a_punt_dry_is_refused(describe):
    punt = _revolved([[0, 0.03], [0.02, 0], [RADIUS, 0], [RADIUS, HEIGHT], [0, HEIGHT]])
    with pytest.raises(ObjectModelError, match=r'cavity from 0\.0345.*give a level between them'):
        describe(punt, {**GLASS, 'liquid': {'level': 0.02}})
    assert describe(punt, {**GLASS, 'liquid': {'level': 0.05}})


@pytest.mark.parametrize('change', [lambda mesh: mesh.apply_scale(1000),
                                    lambda mesh: mesh.apply_translation([0, 0, 50])])
def test_an_inner_surface_in_another_unit_or_frame_is_refused(describe, tmp_path, change):
    inner = [[0, 0.01], [0.02, 0.01], [0.02, HEIGHT], [0, HEIGHT]]
    change(_revolved(inner).apply_scale(1000)).export(tmp_path / 'inner.stl')
    with pytest.raises(ObjectModelError, match='in the same frame and scale'):
        describe(_revolved(CYLINDER), {'material': 'glass', 'inner': 'inner.stl', **OPEN})
