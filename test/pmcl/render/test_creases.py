"""Sharp edges of meshes: which they are, where they are seen, what they decide."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from pmcl_scenes import CAMERA, cup, model_of, pose_of, random_poses
from scipy.spatial import ConvexHull, cKDTree
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.contour_profile import ContourProfile
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import least_turn, retract
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.contour_approximations import LinearizedContour
from pmcl_ros.pmcl.local_model import LocalModel
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.render.creases import Creases
from pmcl_ros.pmcl.render.gl_renderer import GlRenderer
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings
from pmcl_ros.pmcl.view_terms import ViewContour, normal_motion

WHOLE = Window(0, 0, (CAMERA.width, CAMERA.height))
DEPTHS = depth_labels(0.3, 0.7, 6)
LEARNED, CONTRAST = ContourProfile.learned(), ContourProfile.contrast()


def stair():
    """Two boxes' worth of one closed mesh, with an edge inwards that hides and is hidden."""
    x, z = 0.03, 0.025
    ring = np.array([[x, z], [x, 0.06], [0, 0.06], [0, 0], [0.07, 0], [0.07, z]])
    fan = np.array([[0, k, k + 1] for k in range(1, 5)])
    here, following = np.arange(6), np.roll(np.arange(6), -1)
    sides = np.concatenate([np.stack([here, here + 6, following + 6], axis=1),
                            np.stack([here, following + 6, following], axis=1)])
    corners = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (0, 0.045)])
    mesh = trimesh.Trimesh(corners - corners.mean(axis=0),
                           np.concatenate([fan, fan[:, ::-1] + 6, sides]), process=False)
    mesh.fix_normals()
    return mesh


def of(mesh, axis=None):
    return Creases.from_model(model_of(mesh, axis))


def scene(mesh, scale=1, camera=CAMERA):
    window = Window(0, 0, (camera.width, camera.height)).coarser(scale)
    return Scene(model_of(mesh), camera, window, 0.2, 0.9)


def random_edges(seed=0):
    rng = np.random.default_rng(seed)
    vector = rng.normal(size=(CAMERA.height, CAMERA.width, len(DEPTHS), 2))
    x, y = vector[..., 0], vector[..., 1]
    tensor = np.stack([x * x, y * y, x * y], axis=-1).astype(np.float32)
    return EdgeVolume(Header(), tensor, DEPTHS, CAMERA)


def test_creases_of_a_box_are_its_edges():
    found = of(trimesh.creation.box((0.1, 0.05, 0.03)))
    assert len(found.ends) == 12
    lengths = np.sort(np.linalg.norm(found.ends[:, 1] - found.ends[:, 0], axis=1))
    np.testing.assert_allclose(lengths, np.repeat([0.03, 0.05, 0.1], 4))
    np.testing.assert_allclose(np.einsum('mi,mi->m', *found.normals.swapaxes(0, 1)), 0, atol=1e-9)


def test_round_surfaces_have_none_but_rims():
    assert of(trimesh.creation.icosphere(3, 0.05)) is None
    assert of(trimesh.creation.uv_sphere(0.05)) is None
    rims = of(trimesh.creation.cylinder(0.03, 0.1, sections=32))
    assert len(rims.ends) == 2 * 32
    np.testing.assert_allclose(np.abs(rims.ends[..., 2]), 0.05)
    # Whatever their corners are shared by.
    mesh = trimesh.creation.cylinder(0.03, 0.1, sections=32)
    apart = trimesh.Trimesh(mesh.triangles.reshape(-1, 3),
                            np.arange(3 * len(mesh.faces)).reshape(-1, 3), process=False)
    assert len(of(apart).ends) == 2 * 32
    assert of(cup(), (0, 0, 1)) is None


def free_sight(points, corners):
    """(n,) whether nothing of triangles (m, 3, 3) is between the camera and points (n, 3)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    cross = np.cross(points[:, None], (c - a)[None])
    size = np.einsum('nmi,mi->nm', cross, b - a)
    size = np.where(np.abs(size) < 1e-15, np.inf, size)
    u = np.einsum('nmi,mi->nm', cross, -a) / size
    q = np.cross(-a, b - a)
    v = points @ q.T / size
    t = np.einsum('mi,mi->m', c - a, q) / size
    return ~((u > 0) & (v > 0) & (u + v < 1) & (t > 1e-6) & (t < 1 - 2e-3)).any(axis=1)


def test_what_is_seen_is_what_rays_reach():
    mesh = stair()
    assert mesh.is_volume
    creases, seen = of(mesh), scene(mesh)
    assert len(creases.ends) == 18
    part = np.linspace(0, 1, 60)[1:-1, None]
    hidden = shown = missed = kept = 0
    free = []
    with NumbaRenderer().contour_score(seen, random_edges(), LEARNED, creases=creases) as score:
        for pose in random_poses(25, seed=3):
            points, contour = score.creases(pose).points, score.points(pose).pixels
            places = points.depths[:, None] * np.column_stack([
                (points.pixels - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy],
                np.ones(len(points.depths))])
            corners = mesh.triangles @ pose[:3, :3].T + pose[:3, 3]
            free.append(free_sight(places, corners))
            # And what is free to see, its sides towards the camera, far from the outline, is seen.
            for ends, normals in zip(creases.ends, creases.normals, strict=True):
                line = ends[0] + part * (ends[1] - ends[0])
                line = line @ pose[:3, :3].T + pose[:3, 3]
                both = (normals @ pose[:3, :3].T @ line[0] < 0).all()
                pixels = CAMERA.project(line)
                inside = ((pixels > 5) & (pixels < np.array([237, 213]) - 6)).all(axis=1)
                clear = inside & (cKDTree(contour).query(pixels)[0] > 5)
                if not clear.any():
                    continue
                near = cKDTree(np.concatenate([points.pixels, [[-99, -99]]])).query(pixels)[0] < 2
                expected = free_sight(line, corners) & both
                shown += int((expected & clear).sum())
                hidden += int((~expected & clear).sum())
                # A face seen at a glance falls off within a few pixels, as if it ended there.
                cosines = normals @ pose[:3, :3].T @ line[0] / np.linalg.norm(line[0])
                if cosines.max() < -0.4:
                    missed += int((expected & clear & ~near).sum())
                    kept += int((expected & clear).sum())
    assert np.concatenate(free).mean() > 0.97
    assert min(shown, hidden, kept, len(np.concatenate(free))) > 300
    assert missed < 0.02 * kept


@pytest.mark.parametrize('scale', [1, 2])
def test_both_renderers_say_the_same_and_points_add_up(context, scale):
    mesh, edges = stair(), random_edges()
    creases = Creases.from_model(model_of(mesh), CONTRAST)
    poses = random_poses(30, seed=5, aside=0.05)
    said = []
    for renderer in (GlRenderer(context), NumbaRenderer()):
        with (renderer.contour_score(scene(mesh, scale), edges, LEARNED) as alone,
              renderer.contour_score(scene(mesh, scale), edges, LEARNED, creases) as both):
            assert alone.creases(poses[0]) is None
            said.append(both(poses) - alone(poses))
            for pose, total in zip(poses[:4], said[-1], strict=False):
                points = both.creases(pose).points
                # What does not show says nothing against a pose.
                assert max(points.lengths @ points.evidence, 0) == pytest.approx(
                    total, abs=1e-3 * max(points.lengths.sum(), 1))
    off = np.abs(said[1] - said[0])
    assert said[0].max() > 15
    assert (said[0] > 0).sum() > 10
    assert (said[0] >= -1e-9).all()
    # As of contours: a pixel on a border is one's alone now and then.
    assert np.quantile(off, 0.85) < 1e-3
    assert off.max() < 20
    with NumbaRenderer().contour_score(scene(mesh), edges, LEARNED, creases) as score:
        nowhere = np.full((1, 4, 4), np.nan)
        assert score(nowhere) == 0


def test_creases_move_as_foretold():
    mesh, edges = stair(), random_edges()
    creases = Creases.from_model(model_of(mesh), CONTRAST)
    with NumbaRenderer().contour_score(scene(mesh), edges, CONTRAST, creases) as score:
        pose = next(each for each in random_poses(40, seed=8, aside=0.01)
                    if score.creases(each).shown)
        seen = score.creases(pose)
        points = seen.points
        contour = score.points(pose)
        view = ViewContour(contour, edges, CONTRAST, seen)
        local, alone = (LocalModel.from_views(pose, Symmetry(), [each], None)
                        for each in (view, replace(view, creases=None)))
        slides = LinearizedContour.from_view(pose, view)
        assert local.evidence == pytest.approx(
            alone.evidence + points.lengths @ points.evidence, rel=1e-3)
        assert slides.evidence(np.zeros((1, 6)))[0] == pytest.approx(local.evidence, rel=1e-6)
    places = points.depths[:, None] * np.column_stack([
        (points.pixels - [CAMERA.cx, CAMERA.cy]) / [CAMERA.fx, CAMERA.fy],
        np.ones(len(points.depths))])
    of_object = (places - pose[:3, 3]) @ pose[:3, :3]
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        after, before = (CAMERA.project(of_object @ each[:3, :3].T + each[:3, 3])
                         for each in retract(pose, np.stack([step, -step])))
        slope = ((after - before) * points.normals).sum(axis=1) / 2
        np.testing.assert_allclose(normal_motion(points, CAMERA, pose[:3, 3])[:, k] * 1e-5, slope,
                                   atol=1e-6)


# From afar: what perspective makes of an outline is little.
FAR = Pinhole(150, 150, 1400.0, 1400.0, 74.5, 74.5)


def drawn(segments, strength=2.0):
    """An edge volume with straight edges (n, 2, 2) [px], sharp at every depth alike."""
    y, x = np.indices((FAR.height, FAR.width))
    places = np.stack([x, y], axis=-1)[:, :, None].astype(float)
    first, along = segments[:, 0], segments[:, 1] - segments[:, 0]
    part = (((places - first) * along).sum(axis=-1) / (along ** 2).sum(axis=-1)).clip(0, 1)
    away = np.linalg.norm(first + part[..., None] * along - places, axis=-1)
    nearest = away.argmin(axis=-1)
    n = np.stack([along[:, 1], -along[:, 0]], axis=-1)[nearest]
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    energy = strength * np.exp(-0.5 * (away.min(axis=-1) / 1.2) ** 2)
    square = energy[..., None] ** 2 * np.stack([n[..., 0] ** 2, n[..., 1] ** 2,
                                                n[..., 0] * n[..., 1]], axis=-1)
    square += np.array([0.01, 0.01, 0])
    tensor = np.repeat(square[:, :, None], 2, axis=2).astype(np.float32)
    return EdgeVolume(Header(stamp_ns=7), tensor, depth_labels(0.5, 0.9, 2), FAR)


def test_creases_tell_look_alikes_that_outlines_cannot():
    # A cube towards us: turned by 60 degrees about the line of sight its outline is the same
    # hexagon, but the corner in the middle points the other way.
    mesh = trimesh.creation.box((0.03, 0.03, 0.03))
    model = model_of(mesh)
    diagonal = np.array([1, 1, 1]) / np.sqrt(3)
    towards = least_turn(diagonal, np.array([0, 0, -1.0]))
    truth = pose_of(towards, (0, 0, 0.7))
    other = pose_of(Rotation.from_euler('z', 60, degrees=True) * towards, (0, 0, 0.7))
    corners = mesh.vertices @ truth[:3, :3].T + truth[:3, 3]
    pixels = FAR.project(corners)
    outline = pixels[ConvexHull(pixels).vertices]
    # Half-way between the two outlines, which differ by perspective.
    around = (outline - FAR.project(truth[None, :3, 3])) @ [1, 1j]
    around *= np.abs(around).mean() / np.abs(around)
    outline = np.column_stack([around.real, around.imag]) + FAR.project(truth[None, :3, 3])
    hexagon = np.stack([outline, np.roll(outline, -1, axis=0)], axis=1)
    middle = corners[:, 2].argmin()
    inner = [[pixels[middle], pixels[k]] for k in range(8)
             if np.linalg.norm(corners[k] - corners[middle]) < 0.031 and k != middle]
    assert len(hexagon) == 6
    assert len(inner) == 3
    edges = drawn(np.concatenate([hexagon, inner]))
    settings = PmclSettings(roi_center=(0, 0, 0.7), roi_size=(0.04, 0.04, 0.08),
                            renderer='numba', particles=48)
    with Localizer(model, settings) as localizer:
        found = localizer.localize(edges, np.random.default_rng(0),
                                   start=np.stack([other, truth])).pose
    nearest = FAR.project(mesh.vertices @ found[:3, :3].T + found[:3, 3])[
        (mesh.vertices @ found[2, :3]).argmin()]
    assert np.linalg.norm(nearest - pixels[middle]) < 2
    assert cKDTree(mesh.vertices @ found[:3, :3].T).query(corners - truth[:3, 3])[0].max() < 0.004
    with NumbaRenderer().contour_score(
            Scene(model, FAR, Window(0, 0, (150, 150)), 0.5, 0.9), edges, LEARNED,
            creases=Creases.from_model(model)) as score:
        said = [[float(each.lengths @ each.evidence)
                 for each in (score.points(pose), score.creases(pose).points)]
                for pose in (truth, other)]
    (outline_there, inner_there), (outline_other, inner_other) = said
    assert inner_there > 0 > inner_other
    assert inner_there - inner_other > 5 * abs(outline_there - outline_other)
