"""A command that needs a thing which is not there says how to make it."""

from pathlib import Path

import pytest
import trimesh
from command_line import pmcl

ROOT = Path(__file__).parents[2]
HOW_TO_CAMERA = 'pmcl calibrate makes the calibration: docs/howto/camera.md'


@pytest.fixture
def names(tmp_path):
    """An empty folder, a bag of raw pictures, one that was killed, such a picture, an object."""
    (tmp_path / 'empty').mkdir()
    killed = tmp_path / 'killed'
    killed.mkdir()
    (killed / 'killed_0.mcap').write_bytes(b'\x89MCAP0\r\n')
    trimesh.creation.box((0.03, 0.05, 0.11)).export(tmp_path / 'box.stl')
    views = tmp_path / 'views.yaml'
    views.write_text('{cameras: {a: {width: 9, height: 9, fx: 9, cx: 4, cy: 4}}, '
                     'views: [{file: a.png, camera: a}]}')
    return {'views': views, 'empty': tmp_path / 'empty', 'bag': ROOT / 'bags' / 'wine_glass',
            'raw': ROOT / 'config' / 'cameras' / 'demo_white.RAW.xz',
            'killed': killed, 'object': tmp_path / 'box.stl', 'out': tmp_path / 'out'}


@pytest.mark.parametrize(('call', 'status', 'how'), [
    ('localize {raw}', 2, 'docs/howto/object.md'),
    ('localize {raw} --object {object}', 2, 'or --depths 0.3 0.9'),
    ('localize {raw} --object {object} --depths 0.3 0.9', 2, HOW_TO_CAMERA),
    ('localize {empty} --object {object} --depths 0.3 0.9', 1, 'docs/howto/one_picture.md'),
    ('next-view {bag} --object {object}', 2, 'docs/howto/posed_views.md'),
    ('next-view {raw} --object {object}', 2, 'posed views are needed'),
    ('localize {views} --object {object} --depths 0.3 0.9 --scale 2', 2, 'no COLMAP model'),
    ('localize {views} --object {object} --depths 0.3 0.9 --white {raw}', 2,
     'is no raw picture'),
    ('localize {views} --object {object} --depths 0.3 0.9 --sigma-mm 1', 2,
     'has no poses of its cameras: --sigma-mm'),
    ('report {empty}', 2, 'or --depths 0.3 0.9'),
    ('next-view {views} --object {object} --depths 0.3 0.9 --candidates {views} --cap 30', 2,
     '--cap and --count are of the default candidates'),
    ('decode {raw} --gain 2 --out {out}', 2, '--gain is for these'),
    ('lattice {raw} --gain 2 --out {out}', 2, '--gain is for these'),
    ('handeye {views} --simulate 1 -o m.yaml', 2, 'leave out SOURCE, -o'),
    ('handeye --simulate 1 --square 0.02 --parent wrist', 2, 'leave out --square, --parent'),
    ('handeye {views} --fixed-camera --parent wrist', 2, 'leave out --parent'),
    ('bench chain --back-end gl', 2, '--back-end is of dlv alone'),
    ('scenes pictures --scheduler tcp://a:1 -o {out}', 2, 'say --backend dask too'),
    ('decode {raw} --calibration demo --out {out}', 2, HOW_TO_CAMERA),
    ('decode {raw} --calibration kitchen --out {out}', 2, 'pmcl calibrate --camera kitchen'),
    ('calibrate --white {raw} --boards {empty} --corners 10x7 --square 0.011 --out {out}.yaml', 1,
     'pmcl camera capture'),
    ('sweep plan --distance 600 --resolution 2 --fx 600 -o {out}.yaml', 2,
     'views would be 18.8 m apart, not 0.00001 to 10 m: are --distance and --resolution in m'),
    ('sweep plan --distance 0.6 --resolution 99 --fx 600 -o {out}.yaml', 2, 'be 3.79e-07 m apart'),
    ('handeye --corners 10x7 --square 0.02', 2, 'docs/howto/hand_eye.md'),
    ('camera serve --pictures {empty}', 1, 'pmcl bag extract'),
    ('bag extract {empty} {out}', 1, 'pmcl bag record'),
    ('localize {killed} --object {object} --depths 0.3 0.9', 1, '`mcap recover` saves'),
    ('bag extract {killed} {out}', 1, '`mcap recover` saves'),
    ('bag record {raw} {out} --every 2', 2, 'are for light fields'),
    ('bag record {raw} {out} --scale 2', 2, 'and no transforms.json'),
    ('bag record {raw} {out} --sigma-deg 2', 2, 'are for posed views'),
    ('bag record {raw} {out} --image-topic /a', 2, 'are for bags'),
    ('bag record {empty} {out}', 1, 'docs/howto/light_fields.md'),
    ('evaluate {empty}', 1, 'pmcl scenes render'),
    ('learn {empty}', 1, 'pmcl scenes render'),
    ('feasibility {object} --camera f01 -o {out}', 1, 'file with mesh: box.stl and appearance:'),
    ('localize nothing --object {object}', 2, 'docs/howto/one_picture.md'),
    ('localize {raw} --object nothing', 2, 'docs/howto/object.md'),
    ('localize {raw} --object {object} --white nothing', 2, HOW_TO_CAMERA),
    ('localize {raw} --object {object} --calibration no.yaml', 2, HOW_TO_CAMERA),
    ('localize {raw} --object {object} --truth no.json', 2, 'pmcl scenes render'),
    ('report {raw} --object nothing', 2, 'docs/howto/object.md'),
    ('next-view {bag} --object nothing', 2, 'docs/howto/object.md'),
    ('grasps nothing', 2, 'docs/howto/object.md'),
    ('profile nothing -o {out}.yaml', 2, 'docs/howto/one_picture.md'),
    ('profile {bag} -o {out}.yaml', 2, '--box or --points'),
    ('decode nothing --out {out}', 2, 'pmcl camera capture'),
    ('lattice nothing --out {out}', 2, 'pmcl camera capture'),
    ('lfp info nothing', 2, 'pmcl camera capture'),
    ('lfp unpack nothing {out}', 2, 'pmcl camera capture'),
    ('lfp pack nothing {out}', 2, 'pmcl camera capture'),
    ('calibrate --white nothing --boards {empty} --corners 10x7 --square 0.011 --out {out}.yaml',
     2, HOW_TO_CAMERA),
    ('calibrate --white {raw} --boards nothing --corners 10x7 --square 0.011 --out {out}.yaml', 2,
     'docs/howto/camera.md'),
    ('calibration-from-truth no.json no.json --out {out}', 2, 'pmcl simulate'),
    ('handeye nothing', 2, 'docs/howto/hand_eye.md'),
    ('camera serve --pictures nothing', 2, 'pmcl bag extract'),
    ('bag extract nothing {out}', 2, 'pmcl bag record'),
    ('evaluate nothing', 2, 'docs/howto/evaluation.md'),
    ('simulate nothing --camera f01 -o {out}', 2, 'docs/howto/object.md'),
    ('simulate {object} --camera f01 -o {out}', 1, 'file with mesh: box.stl and appearance:'),
    ('simulate {object} --camera no.yaml -o {out}', 1, 'a YAML with width, height, fx, cx, cy'),
    ('manipulate sink --camera no.yaml -o {out}', 2, 'docs/howto/one_picture.md'),
    ('scenes render --camera no.yaml -o {out}', 2, 'docs/howto/one_picture.md'),
])
def test_how_to_make_it_is_told(names, tmp_path, monkeypatch, call, status, how):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path))
    done = pmcl(*call.format(**names).split(), status=status)
    assert how in ' '.join(done.stderr.split())
    assert 'Traceback' not in done.output
