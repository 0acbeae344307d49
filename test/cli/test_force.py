"""No command overwrites a calibration, grasps, a plan or a picture unasked."""

import json
from pathlib import Path

import pytest
from command_line import pmcl

ROOT = Path(__file__).parents[2]
TRUTH = ROOT / 'bags/wine_glass/truth.json'
LATTICE = {'pitch_px': 9.9, 'row_step_px': 8.6, 'rotation': 0.0, 'centre_px': [1640, 1640]}


def commands(tmp_path):
    """(the file that is there, arguments of what would write it)."""
    white = tmp_path / 'white.json'
    white.write_text(json.dumps({'lattice': LATTICE}))
    cup, out = ROOT / 'models/wine_glass.obj', tmp_path / 'out.yaml'
    return {
        'calibration-from-truth': (out, [TRUTH, white, '--out', out]),
        'grasps': (out, [cup, '--out', out]),
        'grasps --picture': (tmp_path / 'out.png', [cup, '--picture', tmp_path / 'out.png']),
        'sweep plan': (out, ['--distance', 1, '--resolution', 0.01, '--fx', 500, '-o', out]),
        'bag extract': (tmp_path / 'IMG_0001.TXT', [ROOT / 'bags/wine_glass', tmp_path]),
        # Refused before any picture is looked at:
        'calibrate': (tmp_path / 'out.json', [
            '--white', white, '--boards', tmp_path, '--corners', '10x7', '--square', 0.02, '--out',
            out]),
        'handeye': (out, [tmp_path, '-o', out]),
    }


@pytest.mark.parametrize('name', [
    'calibration-from-truth', 'grasps', 'grasps --picture', 'sweep plan', 'bag extract',
    'calibrate', 'handeye'])
def test_what_is_there_stays_without_force(tmp_path, name):
    path, arguments = commands(tmp_path)[name]
    path.write_text('mine')
    words = name.split(' --')[0].split()
    done = pmcl(*words, *arguments, status=1)
    assert f'{path} is there already' in done.stderr.replace('\n', '')
    assert path.read_text() == 'mine'
    if name in ('calibrate', 'handeye'):
        return  # their own tests write
    pmcl(*words, *arguments, '--force')
    assert path.read_bytes() != b'mine'
