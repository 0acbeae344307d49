"""A simulated Lytro: its optics, its raw pictures, and what the package decodes from them."""

import functools
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import read_raw_frame, write_raw_frame
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.evaluation.studies.view_comparison import IdealViews, compare_views
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.calibration.lytro.calibrate import Calibrator
from pmcl_ros.lightfield.calibration.lytro.camera_model import predict
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.simulation.lytro.calibration_pictures import (
    COUNT,
    board_picture,
    white_picture,
    write_calibration_pictures,
)
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.path_tracing.render import physical_along
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.rays import fast_along
from pmcl_ros.simulation.scenes.render import fast
from pmcl_ros.simulation.scenes.scene import Scene, Sheet
from pmcl_ros.simulation.scenes.textures import random_texture

CAMERA = LytroCamera(width=400, height=400)  # the middle of the sensor
BOARD = Checkerboard(6, 5, 0.0025)


@functools.cache
def white() -> RawFrame:
    return white_picture(CAMERA, np.random.default_rng(0))


@functools.cache
def wall() -> Scene:
    """A textured wall, nearer than the focus, tilted."""
    rng = np.random.default_rng(3)
    sheet = Sheet(pose_of(Rotation.from_rotvec([0.5, 0.2, 0.1]), np.array([0, 0, 0.4])),
                  (0.5, 0.5), random_texture(rng, ('leaves',)), 0.03)
    room = Environment(np.ones((8, 16, 3), np.float32))
    return Scene('wall', (), (sheet,), room, np.eye(3), CAMERA.sensor(rng), (), ())


@pytest.mark.parametrize('stop', [0.0, 0.004, 0.01194])
def test_rays_go_through_a_thin_lens_to_their_pixels(stop: float) -> None:
    """Followed the other way: aperture, lens, lenslet, sensor; each bends by height / focal."""
    camera = LytroCamera(stop=stop)
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, camera.width, (500, 2))
    origins, directions, weights = camera.rays(pixels, 4, rng)
    slope = directions[..., :2] / directions[..., 2:]
    height = origins[..., :2] - slope * stop
    behind = 1 / (1 / camera.focal - 1 / (camera.focus + stop))
    on_lenslets = -(height - (slope + height / camera.focal) * behind)
    spread = 1 + camera.gap / camera.exit_pupil
    middle = camera.axis_px + on_lenslets * spread / camera.pixel
    lenslet = (camera.lattice.centres(*camera.lattice.nearest(middle)) - camera.axis_px
               ) * camera.pixel / spread
    focal = 1 / (1 / camera.gap + 1 / camera.exit_pupil)
    bent = slope + height / camera.focal - (on_lenslets - lenslet) / focal
    landed = (on_lenslets + camera.gap * bent) / camera.pixel + camera.axis_px
    seen = weights > 0
    off = (landed - pixels[:, None])[seen]
    assert 0.6 < seen.mean() < 0.75  # what the aperture's round images leave dark
    assert np.abs(off).max() < 0.501
    np.testing.assert_allclose(off.mean(axis=0), 0, atol=0.03)


def test_the_lattice_is_found_in_the_white_image() -> None:
    found = fit_lattice(white()).lattice.difference(CAMERA.lattice, 400, 400)
    assert found.max() < 0.03


def test_noise_is_that_of_the_electrons() -> None:
    camera = LytroCamera(width=120, height=120)
    frames = [white_picture(camera, np.random.default_rng(seed), 64).linear() for seed in (1, 2)]
    mean, apart = np.add(*frames) / 2, np.subtract(*frames)
    pixels = np.stack(np.meshgrid(np.arange(120), np.arange(120)), axis=-1)
    lenslets = camera.lattice.centres(*camera.lattice.nearest(pixels))
    bright = np.linalg.norm(pixels - lenslets, axis=-1) < 3  # off the edge of the aperture
    expected = 2 * (mean[bright] / CAMERA.electrons + (CAMERA.read / CAMERA.electrons) ** 2)
    assert apart[bright].var() == pytest.approx(expected.mean(), rel=0.05)


def test_pictures_are_read_as_those_of_a_camera(tmp_path: Path) -> None:
    write_raw_frame(tmp_path / 'IMG.RAW', white())
    read = read_raw_frame(tmp_path / 'IMG.RAW')
    np.testing.assert_array_equal(read.counts, white().counts)
    assert read.metadata.tags.modulationFrame
    assert (read.metadata.serial, read.metadata.black) == (CAMERA.serial, CAMERA.black)
    balanced = [np.percentile(white().linear()[row::2, column::2], 95) * gain
                for row, column, gain in ((0, 0, CAMERA.gains[2]), (0, 1, CAMERA.gains[1]),
                                          (1, 1, CAMERA.gains[0]))]
    np.testing.assert_allclose(balanced, balanced[0], rtol=0.01)


def test_decoded_views_are_those_rendered_directly() -> None:
    scene = wall()
    decoder = Decoder(CAMERA.calibration, white())
    found = decoder.decode(raw_picture(CAMERA, fast_along(scene), np.random.default_rng(2), 8))
    grid, seen = scene.sensor.grid, fast(scene)
    views, steps = np.zeros((3, 3, 40, 40, 3), np.float32), np.zeros((3, 3, 2))
    for row, column in np.ndindex(3, 3):
        at = grid.centre[0] + row - 1, grid.centre[1] + column - 1
        views[row, column] = seen(scene.sensor, *at, 0, 64, 1) @ CAMERA.response.T
        steps[row, column] = grid.positions[at]
    views *= np.median(found.centre_view) / np.median(views[1, 1])
    errors = compare_views(found, IdealViews(views ** np.float32(1 / 2.2), steps))
    assert min(each.psnr for each in errors) > 40
    assert max(each.residual for each in errors) < 0.05
    np.testing.assert_allclose(found.grid.positions[2:7, 2:7], grid.positions[2:7, 2:7],
                               atol=0.05)


def test_corners_of_a_board_are_where_the_optics_put_them() -> None:
    pose = pose_of(Rotation.from_rotvec([0.4, -0.3, 0.1]), np.array([-0.006, -0.005, 0.6]))
    frame = board_picture(CAMERA, BOARD, pose, np.random.default_rng(5))
    found = Calibrator(white(), BOARD, CAMERA.lattice).look('board', frame).corners
    of = CAMERA.calibration
    numbers = np.array([of.fx, of.fy, of.cx, of.cy, of.baseline, 1 / of.focus_distance, 0, 0])
    turn = Rotation.from_matrix(pose[:3, :3]).as_rotvec()
    expected = predict(BOARD.points, numbers, np.concatenate([turn, pose[:3, 3]])[None])[0]
    off = np.concatenate([found.positions, found.disparities], axis=-1).reshape(-1, 4) - expected
    off = off[found.valid.ravel()]
    assert len(off) > 25
    assert np.abs(np.median(off, axis=0)).max() < 0.01
    assert np.sqrt(np.mean(off ** 2, axis=0)).max() < 0.03


def test_both_renderers_see_the_same_along_rays() -> None:
    rng = np.random.default_rng(6)
    pixels = rng.integers(0, 400, (2000, 2))
    origins, directions, weights = (each[:, 0] for each in CAMERA.rays(pixels, 1, rng))
    often = [np.repeat(each[weights > 0], 256, axis=0) for each in (origins, directions)]
    own, traced = (make(wall())(*often, 3).reshape(-1, 256, 3).mean(axis=1)
                   for make in (fast_along, physical_along))
    np.testing.assert_allclose(traced.mean(axis=0), own.mean(axis=0), rtol=0.02)
    assert np.corrcoef(traced.ravel(), own.ravel())[0, 1] > 0.97


def test_calibration_pictures_tell_how_far_they_are(tmp_path: Path) -> None:
    small, shares = LytroCamera(width=80, height=80), list[float]()
    places = list(write_calibration_pictures(tmp_path, small, progress=shares.append))
    assert [each.name for each in places] == ['white', *(f'board{k}' for k in range(1, 9))]
    assert all((each / 'truth.json').is_file() for each in places)
    assert shares == [1.0] * COUNT  # pictures so small are of one piece
    assert len(list(write_calibration_pictures(tmp_path, small, progress=shares.append))) == COUNT
    assert len(shares) == COUNT  # those that are there are kept
    list(write_calibration_pictures(tmp_path, small, force=True, progress=shares.append))
    assert len(shares) == 2 * COUNT
