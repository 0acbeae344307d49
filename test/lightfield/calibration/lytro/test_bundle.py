"""The bundle adjustment against made-up corners of known cameras and poses."""

import functools

import numpy as np
import pytest
from board_scene import pose
from hypothesis import given, settings
from hypothesis import strategies as st
from rolled_sheets import rolled
from scipy.spatial.transform import Rotation

from pmcl_ros.lightfield.calibration.lytro.bundle import bundle_adjust, linearize, select_model
from pmcl_ros.lightfield.calibration.lytro.camera_model import Model, bok_parameters, predict
from pmcl_ros.lightfield.calibration.lytro.initial_guess import initial_guess
from pmcl_ros.lightfield.calibration.lytro.observations import Observations
from pmcl_ros.lightfield.calibration.lytro.uncertainty import uncertainty
from pmcl_ros.runtime.errors import LightFieldError

#                 fx, fy, cx, cy, baseline, 1 / focus distance, k1, k2
CAMERA = np.array([940.0, 940, 166, 161, 7.2e-4, 1 / 0.6, 0, 0])
SIGMA = np.array([0.02, 0.02, 0.01, 0.01])
BOARD = (9, 6, 0.012)
PLACES = [((0.4, 0.1), 0.2, 0.45, (0.02, -0.02)), ((-0.4, 0.2), -0.5, 0.55, (-0.04, 0.01)),
          ((0.1, -0.5), 0.1, 0.65, (0.05, 0.04)), ((0.2, 0.4), 2.9, 0.5, (-0.02, -0.05)),
          ((-0.3, -0.4), -0.1, 0.75, (0.0, 0.05)), ((0.3, -0.2), 1.5, 0.4, (0.01, 0.01))]


def vectors(places=PLACES):
    """(n, 6) poses."""
    poses = np.array([pose(*each, board=BOARD) for each in places])
    return np.concatenate([Rotation.from_matrix(poses[:, :3, :3]).as_rotvec(), poses[:, :3, 3]],
                          axis=1)


def points():
    columns, rows, square = BOARD
    x, y = np.meshgrid(np.arange(columns) * square, np.arange(rows) * square)
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)


def observed(camera=CAMERA, places=PLACES, seed=0, noise=1.0, sheet=None):
    """sheet: (m, 3) the corners as they lie; None: flat."""
    exact = predict(points() if sheet is None else sheet, camera, vectors(places))
    rng = np.random.default_rng(seed)
    whitening = np.tile(np.diag(1 / SIGMA), (*exact.shape[:2], 1, 1))
    return Observations(points(), exact + noise * SIGMA * rng.standard_normal(exact.shape),
                        whitening)


def test_a_prediction_is_where_a_ray_goes():
    """A ray from the aperture's place (a, b) to the point, cut with the plane of focus."""
    camera = np.array([800.0, 820, 150, 170, 8e-4, 1 / 0.5, 0, 0])
    where = vectors()[:1]
    world = points() @ Rotation.from_rotvec(where[0, :3]).as_matrix().T + where[0, 3:]
    values = predict(points(), camera, where)[0]
    for a, b in ((0, 0), (3, -2), (-4, 1)):
        place = camera[4] * np.array([a, b, 0])
        cut = place + (world - place) * ((0.5 - place[2]) / world[:, 2:])
        # All views see the plane of focus at the same pixel.
        pixels = camera[:2] * cut[:, :2] / 0.5 + camera[2:4]
        assert np.allclose(values[:, :2] + values[:, 2:] * [a, b], pixels, atol=1e-9)


def test_a_distorted_disparity_is_the_shift_to_the_next_of_small_steps():
    """The lens displaces what each view sees; the views are a thousandth of a step away."""
    lens, step = np.array([-0.3, 0.4]), 1e-3
    values = predict(points(), np.append(CAMERA[:6], lens), vectors())
    plain = predict(points(), CAMERA, vectors())
    for axis in (0, 1):
        ends = []
        for side in (-step, step):
            seen = (plain[..., :2] - CAMERA[2:4]) / CAMERA[:2]
            seen[..., axis] += side * plain[..., 2 + axis] / CAMERA[axis]
            square = np.square(seen).sum(axis=-1, keepdims=True)
            ends.append(seen * (1 + lens[0] * square + lens[1] * square ** 2))
        shift = CAMERA[axis] * (ends[1] - ends[0])[..., axis] / (2 * step)
        np.testing.assert_allclose(values[..., 2 + axis], shift, rtol=1e-6)


def test_bok_s_parameters_are_those_of_his_projection():
    camera = CAMERA.copy()
    k1, k2 = bok_parameters(camera[0], camera[4], 1 / camera[5])
    world = np.array([[0.03, -0.02, 0.4], [0.01, 0.05, 0.9]])
    values = predict(world - [0, 0, 0.1], camera, np.array([[0, 0, 0, 0, 0, 0.1]]))[0]
    step = np.array([2.0, -3.0])
    centre = (values[:, :2] + step * values[:, 2:] - camera[2:4]) / camera[0]  # lenslet's, xc
    apart = (world[:, :2] - world[:, 2:] * centre) / (k1 * world[:, 2:] + k2)  # x - xc
    assert np.allclose(apart, step / (10 * camera[0]), rtol=1e-9)


def test_exact_corners_give_the_exact_camera():
    observations = observed(noise=0)
    fit = bundle_adjust(observations, Model(), *initial_guess(observations, 328, 328))
    assert np.allclose(fit.camera, CAMERA, rtol=1e-7)
    assert np.allclose(fit.poses, vectors(), atol=1e-7)


@settings(max_examples=10, deadline=None)
@given(st.floats(500, 1500), st.floats(3e-4, 2e-3), st.floats(0.3, 3), st.floats(-20, 20))
def test_the_start_is_near_for_any_camera(focal, baseline, focus, off):
    camera = np.array([focal, focal, 163.5 + off, 163.5 - off, baseline, 1 / focus, 0, 0])
    observations = observed(camera, noise=0)
    fit = bundle_adjust(observations, Model(), *initial_guess(observations, 328, 328))
    assert np.allclose(fit.camera, camera, rtol=1e-5)


@functools.cache
def repeated():
    """Fits and their uncertainties, of 40 times the same boards with other noise."""
    fits = []
    for seed in range(40):
        observations = observed(seed=seed, noise=1.7)
        fit = bundle_adjust(observations, Model(), CAMERA, vectors())
        fit = bundle_adjust(observations, Model(), fit.camera, fit.poses, fit.noise)
        fits.append((fit, uncertainty(fit, np.random.default_rng(seed), 300)))
    return fits


def test_the_noise_is_found():
    assert abs(np.mean([fit.noise for fit, _ in repeated()]) / 1.7 ** 2 - 1) < 0.05


@pytest.mark.parametrize('kind', ['expected', 'of_corners', 'camera'])
def test_the_standard_deviations_are_those_of_repeated_calibrations(kind):
    free = [0, 2, 3, 4, 5]
    errors = np.array([fit.camera - CAMERA for fit, _ in repeated()])[:, free]
    told = np.array([getattr(sure, kind) for _, sure in repeated()])[:, free]
    ratio = np.sqrt((errors ** 2).mean(axis=0)) / told.mean(axis=0)
    assert (ratio < 1.4).all()
    assert (ratio > 0.55).all()


def test_the_poses_standard_deviations_are_those_of_repeated_calibrations():
    errors = np.array([fit.poses - vectors() for fit, _ in repeated()])
    told = np.array([sure.poses for _, sure in repeated()])
    ratio = np.sqrt((errors ** 2).mean(axis=(0, 1)) / (told ** 2).mean(axis=(0, 1)))
    assert (ratio < 1.4).all()
    assert (ratio > 0.55).all()


def chosen(camera, seed=0):
    observations = observed(camera, seed=seed)
    return select_model(observations, *initial_guess(observations, 328, 328))


def test_nothing_is_added_that_the_corners_do_not_show():
    """But by chance: the criterion takes noise for another model in 2 of 100."""
    assert sum(chosen(CAMERA, seed)[0].model != Model() for seed in range(20)) <= 1


@pytest.mark.parametrize(('change', 'model'), [
    ({1: 1.004 * 940}, Model(focals=2)), ({6: -0.06}, Model(distortions=1)),
    ({6: 0.3, 7: -9.0}, Model(distortions=2)),
    ({1: 1.004 * 940, 6: 0.1}, Model(focals=2, distortions=1))])
def test_what_the_corners_show_is_added(change, model):
    camera = CAMERA.copy()
    for index, value in change.items():
        camera[index] = value
    fit, gains = chosen(camera)
    assert fit.model == model
    assert max(gains.values()) == gains[model] > 0 == gains[Model()]
    sure = uncertainty(fit, np.random.default_rng(0), 300)
    off = np.abs(fit.camera - camera)
    assert (off[sure.camera > 0] < 4 * sure.camera[sure.camera > 0]).all()
    assert (off[sure.camera == 0] == 0).all()


@pytest.mark.parametrize('height', [0, 4e-3])
def test_a_larger_model_loses_no_more_than_its_penalty(height):
    """Though the smallest one, by which the fits begin, leaves larger residuals."""
    camera = CAMERA + np.array([0, 0, 0, 0, 0, 0, -0.3, 0])
    observations = observed(camera, seed=3, sheet=rolled(points(), height))
    fit, gains = select_model(observations, *initial_guess(observations, 328, 328))
    penalty = np.log(4 * fit.observations.valid.sum())
    for model, gain in gains.items():
        for larger in (Model(2, model.distortions), Model(model.focals, model.distortions + 1)):
            if larger != model and larger in gains:
                assert gains[larger] > gain - penalty - 0.1


def test_a_few_wild_corners_do_little():
    observations = observed()
    values = observations.values.copy()
    values[0, :3] += [5, -4, 0.5, 0.5]
    values[3, 20] += [-3, 3, 0, 0.4]
    wild = Observations(observations.points, values, observations.whitening)
    fit, _ = select_model(wild, *initial_guess(wild, 328, 328))
    sure = uncertainty(fit, np.random.default_rng(0), 300)
    assert fit.model == Model()
    assert (np.abs(fit.camera - CAMERA)[:6] < 4 * sure.camera[:6]).all()
    dropped = ~fit.observations.valid
    assert dropped[0, :3].all()
    assert dropped[3, 20]
    assert dropped.sum() <= 6


BENDS = [('gutter', 0, 5e-4), ('gutter', 0, 1e-3), ('gutter', 0, 4e-3), ('gutter', 60, 2e-3),
         ('curled', 0, 1e-3), ('curled', 90, 2e-3), ('curled', 30, 2e-3)]


def calibrated(sheet, seed, places=PLACES):
    observations = observed(seed=seed, sheet=sheet, places=places)
    fit, _ = select_model(observations, *initial_guess(observations, 328, 328))
    return fit, uncertainty(fit, np.random.default_rng(0), 300)


def heights(sheet):
    """(m,) from the plane through the corners."""
    plane = np.c_[sheet[:, :2], np.ones(len(sheet))]
    return sheet[:, 2] - plane @ np.linalg.lstsq(plane, sheet[:, 2], rcond=None)[0]


@pytest.mark.parametrize(('shape', 'degrees', 'height'), BENDS)
@pytest.mark.parametrize('count', [3, 6])
def test_the_camera_is_found_by_a_sheet_that_is_bent(shape, degrees, height, count):
    sheet = rolled(points(), height, degrees, shape)
    off, told = [], []
    for seed in range(6):
        fit, sure = calibrated(sheet, 50 + seed, PLACES[:count])
        off.append((fit.camera - CAMERA)[:6] / sure.camera[:6])
        told.append(sure.camera[0] / CAMERA[0])
        lying = fit.observations.sheet.points(fit.bend)
        np.testing.assert_allclose(lying[:, 2], heights(sheet), atol=3e-5 + 0.03 * height)
    assert np.abs(off).max() < 4
    assert np.sqrt(np.square(off).mean()) < 1.5
    assert max(told) < 0.006


def test_a_flat_board_loses_little():
    """Beside the errors of a sheet that is known to be flat."""
    fit, _ = repeated()[0]
    linear = linearize(fit.observations, fit.model, fit.camera, fit.poses, fit.bend, fit.noise)
    information, free = linear.information().sum(axis=(0, 1)), fit.model.free
    flat = np.linalg.inv(information[:free, :free])
    bent = np.linalg.inv(information + np.diag(linear.prior))[:free, :free]
    more = np.sqrt(np.diag(bent) / np.diag(flat))
    assert (more < 1.3).all()
    assert (more >= 1).all()


def test_a_few_wild_corners_do_little_on_a_sheet_that_is_bent():
    sheet = rolled(points(), 2e-3)
    observations = observed(sheet=sheet)
    values = observations.values.copy()
    values[0, :3] += [5, -4, 0.5, 0.5]
    values[3, 20] += [-3, 3, 0, 0.4]
    wild = Observations(observations.points, values, observations.whitening)
    fit, _ = select_model(wild, *initial_guess(wild, 328, 328))
    sure = uncertainty(fit, np.random.default_rng(0), 300)
    assert (np.abs(fit.camera - CAMERA)[:6] < 4 * sure.camera[:6]).all()
    dropped = ~fit.observations.valid
    assert dropped[0, :3].all()
    assert dropped[3, 20]
    assert dropped.sum() <= 6


def test_corners_that_were_not_measured_do_nothing():
    observations = observed()
    values, whitening = observations.values.copy(), observations.whitening.copy()
    values[2, 5:9], whitening[2, 5:9] = 1e3, 0
    holed = Observations(observations.points, values, whitening)
    fit, _ = select_model(holed, *initial_guess(holed, 328, 328))
    sure = uncertainty(fit, np.random.default_rng(0), 300)
    assert (np.abs(fit.camera - CAMERA)[:6] < 4 * sure.camera[:6]).all()
    assert (fit.residuals[2, 5:9] == 0).all()


def test_boards_that_face_the_camera_at_one_distance_leave_it_open():
    places = [((0, 0), turn, 0.5, (0.01 * turn, 0)) for turn in (0, 0.4, 0.8)]
    observations = observed(places=places, noise=0.1)
    try:
        fit = bundle_adjust(observations, Model(), CAMERA, vectors(places))
        sure = uncertainty(fit, np.random.default_rng(0), 100)
    except (LightFieldError, np.linalg.LinAlgError):
        return
    assert sure.expected[0] > 0.05 * CAMERA[0]
