"""The picture of a lattice, and the command that draws it."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import pmcl
from lattice_frames import discs, frame_of, make_lattice, texture

from pmcl_ros.drawing.lattice_picture import lattice_picture
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.lightfield.calibration.lytro.lattice_fit import fit_lattice

ROOT = Path(__file__).parents[2]
SIDE = 600


def crosses(picture):
    """(n, 2) middles (x, y) of the red crosses."""
    red = (picture[..., 0] > 200) & (picture[..., 1] < 80) & (picture[..., 2] < 80)
    _, _, _, middles = cv2.connectedComponentsWithStats(red.astype(np.uint8))
    return middles[1:]


def test_centres_are_marked_on_the_brightest_of_the_discs(camera_text):
    frame = frame_of(0.8 * discs(make_lattice(), SIDE), camera_text, noise=0)
    picture = lattice_picture(frame, fit_lattice(frame))
    side = picture.shape[0]
    assert picture.shape == (side, 2 * side, 3)
    marks = crosses(picture[:, :side])
    assert len(marks) > 9 * 12
    # Beside a cross, two raw pixels away, its disc; none of the marks lies in a gap.
    inner = marks[((marks > 30) & (marks < side - 30)).all(axis=1)].astype(int)
    light = picture[inner[:, 1], inner[:, 0] + 14].min(axis=1)
    assert (light > 128).mean() > 0.95


def test_residuals_show_where_a_lattice_is_off(camera_text):
    truth = make_lattice()
    frame = frame_of(0.8 * discs(truth, SIDE), camera_text)
    right = fit_lattice(frame)
    drawn = lattice_picture(frame, right)
    assert (drawn[:, drawn.shape[1] // 2:] != 255).any()
    shifted = right.errors.copy()
    shifted[0] += 5  # px: the brightest of the colours, in the upper left
    wrong = lattice_picture(frame, type(right)(
        right.lattice, right.median_px, right.p95_px, right.lenslets, right.shear, right.places,
        shifted, right.used))
    changed = (drawn != wrong).any(axis=-1)
    y, x = np.nonzero(changed)
    assert changed.any()
    assert y.max() < drawn.shape[0] / 4
    assert x.max() < drawn.shape[1] * 5 / 8


def test_the_command_on_the_shipped_white_image(tmp_path):
    done = pmcl('lattice', ROOT / 'config/cameras/demo_white.RAW.xz', '--out', tmp_path)
    assert 'taken as white image (its metadata say modulationFrame: true)' in done.stdout
    assert 'the metadata say pitch' in done.stdout
    lattice = Lattice.load(tmp_path / 'lattice.yaml')
    truth = Calibration.load(ROOT / 'config/cameras/demo.yaml').lattice
    assert np.percentile(lattice.difference(truth, 3280, 3280), 95) < 0.01
    assert cv2.imread(str(tmp_path / 'lattice.png')).ndim == 3


@pytest.mark.parametrize(('scene', 'options', 'told'), [
    (texture(SIDE, 40), (), 'taken as picture (its light is uneven by'),
    (np.full((SIDE, SIDE), 0.5), (), 'taken as white image (its light is uneven by'),
    (np.full((SIDE, SIDE), 0.5), ('--as', 'picture'), 'taken as picture (by --as)')])
def test_the_command_on_a_mosaic_image(tmp_path, scene, options, told):
    levels = np.rint(255 * np.clip(0.05 + scene * discs(make_lattice(), SIDE), 0, 1))
    cv2.imwrite(str(tmp_path / 'mosaic.png'), levels.astype(np.uint8))
    done = pmcl('lattice', tmp_path / 'mosaic.png', '--out', tmp_path / 'out', *options)
    assert told in done.stdout
    lattice = Lattice.load(tmp_path / 'out/lattice.yaml')
    assert np.percentile(lattice.difference(make_lattice(), SIDE, SIDE), 95) < 0.05


def test_the_command_tells_of_a_picture_without_lenslets(tmp_path):
    levels = np.rint(255 * np.clip(texture(SIDE, 3), 0, 1)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / 'photo.png'), levels)
    done = pmcl('lattice', tmp_path / 'photo.png', '--out', tmp_path, status=1)
    assert 'no lattice of lenslets' in done.output
