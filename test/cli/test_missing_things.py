"""A command that needs a thing which is not there says how to make it."""

from pathlib import Path

import pytest
import trimesh
from command_line import pmcl

ROOT = Path(__file__).parents[2]
HOW_TO_CAMERA = 'pmcl calibrate makes the calibration: docs/howto/camera.md'


@pytest.fixture
def names(tmp_path):
    """An empty folder, a bag of raw pictures, one such, an object, a place for outputs."""
    (tmp_path / 'empty').mkdir()
    trimesh.creation.box((0.03, 0.05, 0.11)).export(tmp_path / 'box.stl')
    return {'empty': tmp_path / 'empty', 'bag': ROOT / 'bags' / 'wine_glass',
            'raw': ROOT / 'config' / 'cameras' / 'demo_white.RAW.xz',
            'object': tmp_path / 'box.stl', 'out': tmp_path / 'out'}


@pytest.mark.parametrize(('call', 'status', 'how'), [
    ('localize {raw}', 2, 'docs/howto/object.md'),
    ('localize {raw} --object {object}', 2, 'or --depths 0.3 0.9'),
    ('localize {raw} --object {object} --depths 0.3 0.9', 2, HOW_TO_CAMERA),
    ('localize {empty} --object {object} --depths 0.3 0.9', 1, 'docs/howto/one_picture.md'),
    ('next-view {bag} --object {object}', 2, 'docs/howto/posed_views.md'),
    ('report {empty}', 2, 'or --depths 0.3 0.9'),
    ('decode {raw} --calibration demo --out {out}', 2, HOW_TO_CAMERA),
    ('decode {raw} --calibration kitchen --out {out}', 2, 'pmcl calibrate --camera kitchen'),
    ('calibrate --white {raw} --boards {empty} --corners 10x7 --square 0.011 --out {out}.yaml', 1,
     'pmcl camera capture'),
    ('handeye --corners 10x7 --square 0.02', 2, 'docs/howto/hand_eye.md'),
    ('camera serve --pictures {empty}', 1, 'pmcl bag extract'),
    ('bag extract {empty} {out}', 1, 'pmcl bag record'),
    ('bag record {empty} {out}', 1, 'docs/howto/light_fields.md'),
    ('evaluate {empty}', 1, 'pmcl scenes render'),
    ('learn {empty}', 1, 'pmcl scenes render'),
    ('feasibility {object} --camera f01 -o {out}', 1, 'write in its YAML file appearance:'),
])
def test_how_to_make_it_is_told(names, tmp_path, monkeypatch, call, status, how):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    done = pmcl(*call.format(**names).split(), status=status)
    assert how in ' '.join(done.stderr.split())
    assert 'Traceback' not in done.output
