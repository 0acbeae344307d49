"""What a surface says of its depth: against known truth, dense linear algebra, and nothing."""

import logging
from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import CAMERA, bracket, cup, model_of
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.posed_evidence import PosedEvidence, ViewsEvidence
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.lightfield.posed_view import PosedView, PosedViews
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.multi_view.surface import SurfaceDepth, corrected, with_surface
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window
from pmcl_ros.pmcl.settings import PmclSettings

CUP, BRACKET = model_of(cup(), [0, 0, 1]), model_of(bracket())
PINHOLE = CAMERA.resized(180, 160)
NO_EDGES = EdgeVolume(Header(), np.zeros((160, 180, 2, 3), np.float32), depth_labels(0.3, 0.6, 2),
                      PINHOLE)
SETTINGS = PmclSettings()
BASE = np.eye(4)  # of the cameras' frame in the room
BASE[:3, :3] = Rotation.from_euler('xyz', [70, -30, 200], degrees=True).as_matrix()
BASE[:3, 3] = [1.5, -0.7, 0.4]


def truth_before_cameras():
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler('xyz', [100, 20, 40], degrees=True).as_matrix()
    pose[:3, 3] = 0.02, -0.01, 0.45
    return pose


def pictures(model, truth, textured=True):
    """3x3 views over 8 cm of a solid textured all through, as if carved from it."""
    rng, views = np.random.default_rng(0), []
    waves = rng.normal(0, 500, (3, 6, 3))  # [rad/m]
    for y, x in np.ndindex(3, 3):
        camera = np.eye(4)
        camera[:2, 3] = 0.04 * (x - 1), 0.04 * (y - 1)
        before = np.linalg.inv(camera) @ truth
        window = Window(0, 0, (PINHOLE.width, PINHOLE.height))
        depth = NumbaRenderer().depths(Scene(model, PINHOLE, window, 0.2, 0.8), before[None])[0]
        v, u = np.indices(depth.shape)
        places = depth[..., None] * np.stack([(u - PINHOLE.cx) / PINHOLE.fx,
                                              (v - PINHOLE.cy) / PINHOLE.fy,
                                              np.ones_like(depth)], axis=-1)
        inside = (places - before[:3, 3]) @ before[:3, :3]
        colour = 0.5 + 0.3 * np.sin(inside @ waves.swapaxes(1, 2)[:, None]).mean(axis=-1)
        colour = np.where(depth > 0, colour, 0.5) if textured else np.full(colour.shape, 0.5)
        colour = np.moveaxis(colour, 0, -1) + rng.normal(0, 0.01, (*depth.shape, 3))
        views.append(PosedView(Header(5, 'room'), colour.clip(0, 1).astype(np.float32), PINHOLE,
                               BASE @ camera))
    return PosedViews(tuple(views))


def evidence_of(views):
    return ViewsEvidence(views.header, tuple(
        PosedEvidence(NO_EDGES, each.camera_to_reference, view=each) for each in views.views))


def estimate_at(pose, model, covariance=None):
    """An estimate in the room with particles of just its covariance (6, 6)."""
    rng = np.random.default_rng(1)
    if covariance is None:
        covariance = np.diag([3e-3, 3e-3, 3e-3, 0.01, 0.01, 0.01]) ** 2
    basis = model.symmetry.tangent_basis(pose)
    normal = rng.normal(size=(400, basis.shape[1]))
    normal -= normal.mean(axis=0)
    normal = normal @ np.linalg.inv(np.linalg.cholesky(normal.T @ normal / 400)).T
    off = normal @ np.linalg.cholesky(basis.T @ covariance @ basis).T @ basis.T
    particles = retract(pose, off)
    return PoseEstimate(Header(5, 'room'), pose, model.symmetry.covariance(particles, pose),
                        particles, np.full(400, -np.log(400)), 9.0, False, 'default',
                        (PoseMode(pose, 0.9, 9.0), PoseMode(retract(pose, np.ones((1, 6)))[0],
                                                            0.1, 1.0)))


@pytest.fixture(scope='module', params=[CUP, BRACKET], ids=['cup', 'bracket'])
def seen(request):
    model, truth = request.param, truth_before_cameras()
    return model, BASE @ truth, evidence_of(pictures(model, truth))


@pytest.mark.parametrize('farther', [-0.004, 0.003])
def test_a_textured_surface_corrects_the_depth(seen, farther):
    model, truth, evidence = seen
    sight = BASE[:3, :3] @ truth_before_cameras()[:3, 3]
    sight /= np.linalg.norm(sight)
    start = retract(truth, np.concatenate([farther * sight, np.zeros(3)])[None])[0]
    before = estimate_at(start, model)
    after = with_surface(before, evidence, model, SETTINGS)
    assert abs((after.pose - truth)[:3, 3] @ sight) < 0.25 * abs(farther)
    assert sight @ after.covariance[:3, :3] @ sight < 0.2 * (
        sight @ before.covariance[:3, :3] @ sight)
    np.testing.assert_array_equal(after.modes[0].pose, after.pose)
    assert after.modes[1] is before.modes[1]


def test_errors_of_cameras_that_would_not_show_change_nothing(seen):
    model, truth, evidence = seen
    tiny = replace(evidence, views=tuple(replace(each, sigma=(1e-5, 1e-5))
                                         for each in evidence.views))
    found = [with_surface(estimate_at(truth, model), each, model, SETTINGS).pose
             for each in (evidence, tiny)]
    assert not np.array_equal(found[0], truth)
    np.testing.assert_array_equal(*found)


def test_what_is_masked_says_nothing_of_the_depth(seen):
    """A patterned finger at the same place in all pictures is far away, by its disparity."""
    model, truth, evidence = seen
    column = int(PINHOLE.project(truth_before_cameras()[None, :3, 3])[0, 0])
    covered = np.zeros((PINHOLE.height, PINHOLE.width), bool)
    covered[:, :column] = True
    finger = np.random.default_rng(2).random((*covered.shape, 3), np.float32)

    def gripped(masked):
        views = tuple(replace(each.view, mask=~covered if masked else None, picture=np.where(
            covered[..., None], finger, each.view.picture)) for each in evidence.views)
        return evidence_of(PosedViews(views))

    sight = BASE[:3, :3] @ truth_before_cameras()[:3, 3]
    sight /= np.linalg.norm(sight)
    start = retract(truth, np.concatenate([0.003 * sight, np.zeros(3)])[None])[0]
    before = estimate_at(start, model)
    assert with_surface(before, gripped(masked=False), model, SETTINGS) is before
    after = with_surface(before, gripped(masked=True), model, SETTINGS)
    assert abs((after.pose - truth)[:3, 3] @ sight) < 0.3 * 0.003


def test_what_says_nothing_changes_nothing(seen, caplog):
    caplog.set_level(logging.INFO)
    model, truth, evidence = seen
    estimate = estimate_at(truth, model)
    plain = evidence_of(pictures(model, truth_before_cameras(), textured=False))
    uncertain = replace(evidence, views=tuple(replace(each, sigma=(1e-3, 0))
                                              for each in evidence.views))
    unknown = replace(evidence, views=tuple(replace(each, view=None) for each in evidence.views))
    single = replace(evidence, views=evidence.views[:1])
    drifting = replace(evidence, views=tuple(replace(each, drift=1e-3)
                                             for each in evidence.views))
    assumed = replace(evidence, errors=np.zeros((9, 6, 1)))
    for other in (plain, uncertain, drifting, assumed, unknown, single):
        assert with_surface(estimate, other, model, SETTINGS) is estimate
    in_water = PmclSettings(interface_index=1.33, interface_normal=(0, 0, 1))
    assert with_surface(estimate, evidence, model, in_water) is estimate
    clear = replace(model, clear=True)
    assert with_surface(estimate, evidence, clear, SETTINGS) is estimate
    away = retract(truth, np.concatenate([0.02 * BASE[:3, 2], np.zeros(3)])[None])[0]
    wrong = estimate_at(away, model)  # its surface is nowhere near
    assert with_surface(wrong, evidence, model, SETTINGS) is wrong
    shifted = replace(estimate_at(retract(truth, np.concatenate([
        0.004 * BASE[:3, 2], np.zeros(3)])[None])[0], model), covariance=1e-8 * np.eye(6))
    assert with_surface(shifted, evidence, model, SETTINGS) is shifted  # it contradicts
    assert 'mm off' in caplog.text
    hidden = replace(estimate, in_view=0.3)
    assert with_surface(hidden, evidence, model, SETTINGS) is hidden


@pytest.mark.parametrize('model', [CUP, BRACKET], ids=['cup', 'bracket'])
def test_a_correction_is_what_linear_algebra_says(model):
    rng = np.random.default_rng(3)
    pose = truth_before_cameras()
    root = np.diag([5e-4, 5e-4, 5e-4, 4e-3, 4e-3, 4e-3]) @ rng.normal(size=(6, 6))
    before = estimate_at(pose, model, root @ root.T)
    basis = model.symmetry.tangent_basis(pose)
    direction = np.concatenate([[0, 0.6, 0.8], rng.normal(0, 0.02, 3)])
    surface = SurfaceDepth(direction, 0.001, 0.0002)
    after = corrected(before, model, surface)
    along = basis.T @ direction
    expected = np.linalg.inv(np.linalg.inv(basis.T @ before.covariance @ basis)
                             + np.outer(along, along) / surface.sigma ** 2)
    step = basis @ expected @ along * surface.offset / surface.sigma ** 2
    np.testing.assert_allclose(model.symmetry.local(after.pose[None], pose)[0], step, atol=1e-6)
    now = model.symmetry.tangent_basis(after.pose)
    close = 0.02 * np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    between = basis.T @ now  # the axis of symmetry turned, and the basis with it
    assert (abs(between @ now.T @ after.covariance @ now @ between.T - expected) < close).all()
    off = between @ now.T @ model.symmetry.local(after.particles, after.pose).T
    assert (abs(off @ off.T / off.shape[1] - expected) < close).all()
    if model.axis is not None:
        axis = np.concatenate([np.zeros(3), after.pose[:3, :3] @ model.axis])
        assert axis @ after.covariance @ axis == pytest.approx(np.pi ** 2 / 3)


HALF_TURN = replace(BRACKET, discrete=np.array([np.eye(4), np.diag([-1.0, -1, 1, 1])]))


@pytest.mark.parametrize('model', [CUP, BRACKET, HALF_TURN], ids=['cup', 'bracket', 'half turn'])
def test_a_correction_leaves_particles_of_other_modes(model):
    """The others move alike, whichever of their equivalents they are."""
    before, surface = estimate_at(truth_before_cameras(), model), SurfaceDepth(
        np.array([0, 0.6, 0.8, 0.005, -0.01, 0.02]), 0.001, 0.0002)
    particles = before.particles.copy()
    particles[:50, :3, 3] += [0.2, 0, 0]
    particles[50:100] @= model.symmetry.discrete[-1]
    after = corrected(replace(before, particles=particles), model, surface).particles
    np.testing.assert_array_equal(after[:50], particles[:50])
    expected = corrected(before, model, surface)
    off, known = (model.symmetry.local(model.symmetry.nearest_equivalents(
        each, expected.pose), expected.pose) for each in (after, expected.particles))
    np.testing.assert_allclose(off[50:], known[50:], atol=1e-9)
