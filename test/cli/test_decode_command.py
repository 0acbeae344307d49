"""`pmcl decode` on the files of a small made-up camera."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import pmcl
from synthetic_camera import SIDE, SyntheticCamera, waves

from pmcl_ros.camera.packing import pack12


@pytest.fixture(scope='module')
def files(camera_text, tmp_path_factory):
    """RAW, white image, calibration and ideal views of the camera in a folder."""
    folder = tmp_path_factory.mktemp('camera')
    camera = SyntheticCamera(camera_text(SIDE, SIDE), pupil=4.4)
    for name, frame in (('IMG', camera.picture(waves, 0.4)), ('WHITE', camera.white())):
        (folder / f'{name}.RAW').write_bytes(pack12(frame.counts))
        (folder / f'{name}.TXT').write_text(frame.metadata.text)
    camera.calibration.save(folder / 'camera.yaml')
    y, x = np.indices((40, 40))
    across, down = camera.shift - camera.disparity(0.4)
    views = [[waves(x - a * across, y - b * down) for a in (-3, 0, 3)] for b in (-3, 0, 3)]
    np.savez(folder / 'ideal.npz', views=np.rint(65535 * np.array(views) ** (1 / 2.2)).astype(
        np.uint16))
    return folder


def decode(files, out, *options, status=0):
    return pmcl('decode', files / 'IMG.RAW', '--calibration', files / 'camera.yaml', '--white',
                files / 'WHITE.RAW', '--out', out, *options, status=status)


def test_it_tells_how_the_views_differ_from_ideal_ones(files, tmp_path):
    done = decode(files, tmp_path, '--compare', str(files / 'ideal.npz'))
    rows = [line.split() for line in done.stdout.splitlines()[2:]]
    assert [(row[0], row[1]) for row in rows] == [(r, c) for r in '147' for c in '147']
    for row in rows:
        residual, _, psnr_there = (float(each) for each in row[-3:])
        assert residual < 0.06
        assert psnr_there > 33
    with np.load(tmp_path / 'views.npz') as decoded:
        assert decoded['views'].shape == (9, 9, 40, 40, 3)


def test_number_and_size_of_the_views_are_chosen(files, tmp_path):
    decode(files, tmp_path, '--views', '5', '--size', '60x30')
    with np.load(tmp_path / 'views.npz') as decoded:
        assert decoded['views'].shape == (5, 5, 30, 60, 3)
        assert (float(decoded['fx']), float(decoded['fy'])) == (165, 75)
    assert cv2.imread(str(tmp_path / 'centre.png')).shape == (30, 60, 3)


@pytest.mark.parametrize(('options', 'status', 'reason'), [
    (['--views', '4'], 1, '4 views of a row: their number must be odd'),
    (['--size', '40'], 2, "'40' is no size; expected width x height"),
    (['--size', '0x40'], 2, "'0x40' is no size"),
    (['--size', '9999x9999'], 1, 'take 92679 MiB'),
    (['--compare', 'broken.npz'], 1, 'broken.npz holds no ideal views'),
    (['--out', 'broken.npz/out'], 1, 'Not a directory'),
])
def test_what_is_impossible_is_refused(files, tmp_path, options, status, reason):
    (files / 'broken.npz').write_bytes(b'PK\x03\x04')
    options = [str(files / each) if 'broken' in each else each for each in options]
    assert reason in decode(files, tmp_path, *options, status=status).stderr


def test_a_real_mosaic_is_decoded_without_calibration_or_white_image(tmp_path):
    """Its pixels are near grey on average, as any balanced picture of many things.

    Its sides, 1024 px, are no multiple of the 10 px of a view's pixel.
    """
    mosaic = Path(__file__).parents[1] / 'data' / 'real_mosaics' / 'IMG_1_middle.png'
    done = pmcl('decode', mosaic, '--gain', '1.5', '--out', tmp_path)
    assert 'no calibration' in done.stderr
    blue, green, red = cv2.imread(str(tmp_path / 'centre.png')).reshape(-1, 3).T.astype(float)
    assert abs(red.mean() - green.mean()) < 40
    assert abs(blue.mean() - green.mean()) < 40
    with np.load(tmp_path / 'views.npz') as decoded:
        assert decoded['views'].shape == (9, 9, 102, 102, 3)
        assert 'baseline' not in decoded


def test_a_white_image_alone_gives_the_lattice(files, tmp_path):
    pmcl('decode', files / 'IMG.RAW', '--white', files / 'WHITE.RAW', '--out', tmp_path / 'alone')
    decode(files, tmp_path / 'known')
    alone, known = (np.load(tmp_path / each / 'views.npz')['views'][4, 4]
                    for each in ('alone', 'known'))
    assert np.abs(alone - known)[5:-5, 5:-5].mean() < 0.01
