"""`pmcl contour-map` draws contours where they are, in the colour of their direction."""

import re
import subprocess
import sys

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from labelled_discs import discs

from pmcl_ros.cli import main


def drawn(*arguments):
    done = CliRunner().invoke(main, ['contour-map', *map(str, arguments)])
    assert done.exit_code == 0, done.output
    return done.output.split()


def file_of(path, picture):
    cv2.imwrite(str(path), picture[..., ::-1])
    return path


def test_contours_are_drawn_in_their_direction_and_solids_are_bright(tmp_path):
    picture, direction, inside = discs(1003, shape=(192, 224))
    name, = drawn(file_of(tmp_path / 'discs.png', picture), '-o', tmp_path / 'out')
    whole = cv2.imread(name)[..., ::-1]
    shown, contours, solid = np.split(whole, 3, axis=1)
    np.testing.assert_array_equal(shown, picture)
    bright = contours.max(axis=-1).astype(float)
    there = direction >= 0
    far = cv2.dilate(there.astype(np.uint8), np.ones((9, 9))) == 0
    assert np.median(bright[there]) > np.quantile(bright[far], 0.9) + 50
    hue = cv2.cvtColor((contours / np.float32(255)).astype(np.float32), cv2.COLOR_RGB2HSV)[..., 0]
    off = (hue - direction.astype(float) * 360 / 32 + 180) % 360 - 180
    assert np.median(np.abs(off[there & (bright > 128)])) < 15  # degrees
    assert np.median(solid[inside]) > np.median(solid[~inside]) + 60


def test_pictures_of_any_kind_are_drawn_small(tmp_path):
    grey = np.random.default_rng(0).integers(0, 65536, (150, 1500), np.uint16)
    cv2.imwrite(str(tmp_path / 'wide.tiff'), grey)
    picture, _, _ = discs(2)
    names = drawn(tmp_path / 'wide.tiff', file_of(tmp_path / 'b.jpg', picture), '-o', tmp_path)
    assert [each.rsplit('/', 1)[1] for each in names] == ['wide_contours.png', 'b_contours.png']
    assert [cv2.imread(each).shape for each in names] == [(64, 3 * 640, 3), (96, 3 * 112, 3)]


def test_a_large_photograph_is_reduced_before_it_is_read(tmp_path):
    """Of all its pixels, the log odds of 32 directions alone would take 1.5 GB."""
    picture, _, _ = discs(1003, shape=(192, 224))
    large = cv2.resize(picture, (4096, 3072), interpolation=cv2.INTER_CUBIC)
    large[:1024] = 255
    file_of(tmp_path / 'large.jpg', large)
    made = subprocess.run(
        [sys.executable, '-c', 'from pathlib import Path; from pmcl_ros.cli import main; '
         'main(["contour-map", "large.jpg", "-o", "out"], standalone_mode=False); '
         'print(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0])'],
        cwd=tmp_path, capture_output=True, text=True, check=True)
    assert cv2.imread(str(tmp_path / 'out/large_contours.png')).shape == (480, 3 * 640, 3)
    assert int(made.stdout.split()[-1]) < 1.2 * 2 ** 20  # KiB


@pytest.mark.parametrize(('name', 'reason'), [
    ('a.png', 'a_contours.png would be of two pictures'),
    ('small.png', r'small\.png: .* 32 to 8192 px a side'),
    ('text.png', r'text\.png: it is no picture')])
def test_what_cannot_be_drawn_is_one_line(tmp_path, name, reason):
    (tmp_path / 'more').mkdir()
    picture, _, _ = discs(2)
    for each in ('b.png', 'a.png', 'more/a.png'):
        file_of(tmp_path / each, picture)
    file_of(tmp_path / 'more/small.png', picture[:20])
    (tmp_path / 'more/text.png').write_text('no picture')
    done = CliRunner().invoke(main, ['contour-map', str(tmp_path / 'a.png'),
                                     str(tmp_path / 'more' / name), '-o', str(tmp_path / 'out')])
    assert done.exit_code != 0
    assert re.search(reason, done.output)
    assert 'Traceback' not in done.output
