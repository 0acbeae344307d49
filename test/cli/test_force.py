"""No command overwrites a file that it did not write, unless it is told to by --force."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import click
import cv2
import numpy as np
import pytest
import trimesh
import yaml
from command_line import pmcl
from simulated_cameras import SIDE, serving, write_captures
from tiny_capture import QUICK, write_capture

from pmcl_ros.cli import main

ROOT = Path(__file__).parents[2]
TRUTH = ROOT / 'bags/wine_glass/truth.json'
CUP = ROOT / 'models/wine_glass.obj'
MOSAIC = ROOT / 'test/data/real_mosaics/IMG_2.jpg'
PINHOLE = {'width': 48, 'height': 36, 'fx': 45.0, 'fy': 45.0, 'cx': 23.5, 'cy': 17.5}
BOXES = '--box 0 10 10 9 9 --box 1 10 10 9 9'
# What is run, and the file of OUT that it would write. Those marked 'late' do all their work
# before, the others refuse at once.
RUNS = {
    'bag extract': ('{bag} {out}', 'IMG_0001.TXT'),
    'board': ('--corners 10x7 --square 0.02 -o {out}/b.svg', 'b.svg'),
    'board-poses': ('{out} --camera {camera} --corners 10x7 --square 0.02', 'views.yaml'),
    'calibrate': ('--white {white} --boards {here} --corners 10x7 --square 0.02 --out '
                  '{out}/c.yaml', 'c.json'),
    'calibrate-camera': ('{here} --corners 10x7 --square 0.02 -o {out}/c.yaml', 'c.yaml'),
    'calibration-from-truth': ('{truth} {white} --out {out}/c.yaml', 'c.yaml'),
    'camera capture': ('--address {address} --download IMG_0001 --out {out}', 'IMG_0001.TXT'),
    'contour-map': ('{mosaic} -o {out}', 'mosaic_contours.png'),
    'decode': ('{mosaic} --views 3 --size 40x40 --out {out}', 'centre.png'),
    'evaluate': ('{captures} --out {out}', 'bop_default.csv'),
    'feasibility': ('{glass} --camera f01 --renderer fast -o {out}', 'feasibility.html'),
    'figures': ('{out}', 'layers.png'),
    'grasps': ('{cup} --out {out}/g.yaml', 'g.yaml'),
    'grasps --picture': ('{cup} --picture {out}/g.png', 'g.png'),
    'handeye': ('{here} -o {out}/m.yaml', 'm.yaml'),
    'lattice': ('{mosaic} --out {out}', 'lattice.yaml'),
    'learn': ('{captures} -o {out}/l.yaml', 'l.yaml'),
    'learn-map': ('{here} -o {out}', 'contour_map.onnx'),
    'lfp pack': ('{raw} {out}/P.LFP', 'P.LFP'),
    'lfp unpack': ('{lfp} {out}', 'P.TXT'),
    'localize': (f'{{capture}} --object {{capture}}/model.obj --roi 0.005 -0.005 0.4 0.05 0.05 '
                 f'0.06 --set {QUICK} --out {{out}}', 'overlay.png'),
    'manipulate': ('sink -o {out}', 'manipulation.html'),
    'profile': (f'{{views}} {BOXES} -o {{out}}/o.yaml', 'o.stl'),
    'profile --pictures': (f'{{views}} {BOXES} -o {{out}}/o.yaml --pictures {{out}}',
                           'profile_001.png'),
    'profile-errors': ('--out {out}', 'profile_errors.md'),
    'report': ('{capture} -o {out}/r.html', 'r.html'),
    'scenes render': ('--views 3 --size 32 --samples 1 --count 1 -o {out}', '000000/centre.png'),
    'scenes sequence': ('-o {out}', 'parameters.yaml'),
    'simulate': ('{glass} --camera {camera} --renderer fast --samples 1 --count 1 -o {out}',
                 '000000/view.png'),
    'sweep plan': ('--distance 1 --resolution 0.01 --fx 500 -o {out}/p.yaml', 'p.yaml'),
    'together': ('--out {out}', '000003.png'),
    'track': ('--out {out}', 'track_001.png'),
    'view-gain': ('--out {out}', 'view_gain.md'),
}
KEPT = {'scenes pictures': ('--count 1 -o {out}', '000000.npz')}  # what is there is not made again
# Quick enough to be run to their ends; the others write in their own tests.
QUICK_ENOUGH = ('bag extract', 'board', 'calibration-from-truth', 'camera capture',
                'contour-map', 'decode', 'grasps', 'grasps --picture', 'lfp pack', 'lfp unpack',
                'localize', 'scenes render', 'simulate', 'sweep plan')
OWN = 'decode', 'localize', 'scenes render', 'simulate'  # they know their results
PLACE = ['unshare', '-Urm', 'mount', '-t', 'tmpfs', 'none', '/mnt']
FULL_DISKS = ROOT / 'test/support/full_disks.py'
FILLING = ('bag extract', 'calibration-from-truth', 'contour-map', 'grasps', 'grasps --picture',
           'lfp pack', 'scenes pictures', 'scenes render', 'sweep plan')


def commands(group, *words):
    """(words, command) of all below a group."""
    for name in group.list_commands(click.Context(group)):
        command = group.get_command(click.Context(group), name)
        if isinstance(command, click.Group):
            yield from commands(command, *words, name)
        else:
            yield ' '.join([*words, name]), command


@pytest.fixture(scope='module')
def files(tmp_path_factory, camera_text):
    """What the commands read, by the names in RUNS."""
    here = tmp_path_factory.mktemp('force')
    (here / 'white.json').write_text(json.dumps({'lattice': {
        'pitch_px': 9.9, 'row_step_px': 8.6, 'rotation': 0.0, 'centre_px': [1640, 1640]}}))
    write_capture(here / 'captures' / 'cup', seed=1)
    write_captures(here / 'card', camera_text(SIDE, SIDE), 1)
    raw = here / 'card' / 'capture0' / 'IMG.RAW'
    pmcl('lfp', 'pack', raw, here / 'P.LFP')
    (here / 'camera.yaml').write_text(yaml.safe_dump(PINHOLE))
    profile = np.array([[0, 0], [0.03, 0], [0.035, 0.09], [0, 0.09]])
    trimesh.creation.revolve(profile, sections=24).export(here / 'glass.stl')
    (here / 'glass.yaml').write_text(yaml.safe_dump({'mesh': 'glass.stl', 'appearance': {
        'material': 'opaque'}}))
    for name in ('0.png', '1.png'):
        cv2.imwrite(str(here / name), np.full((36, 48, 3), int(name[0]), np.uint8))
    (here / 'views.yaml').write_text(yaml.safe_dump({
        'cameras': {'arm': PINHOLE}, 'views': [
            {'file': name, 'camera': 'arm', 'camera_to_reference': np.eye(4).ravel().tolist()}
            for name in ('0.png', '1.png')]}))
    mosaic = cv2.imread(str(MOSAIC), cv2.IMREAD_UNCHANGED)[1000:1800, 1000:1800]
    cv2.imwrite(str(here / 'mosaic.png'), mosaic)  # a part: it is decoded in less time
    return {'here': here, 'bag': ROOT / 'bags/wine_glass', 'white': here / 'white.json',
            'truth': TRUTH, 'mosaic': here / 'mosaic.png', 'captures': here / 'captures',
            'cup': CUP, 'capture': here / 'captures' / 'cup', 'raw': raw, 'lfp': here / 'P.LFP',
            'glass': here / 'glass.yaml', 'camera': here / 'camera.yaml',
            'views': here / 'views.yaml'}


def call(name, arguments, values, *more, status=0):
    return pmcl(*name.split(' --')[0].split(), *arguments.format(**values).split(), *more,
                status=status)


def test_every_command_that_writes_is_tried():
    writing = {name for name, command in commands(main) for each in command.params
               if {'--out', '--force'} & set(each.opts)}
    assert writing == {name.split(' --')[0] for name in RUNS | KEPT}


@pytest.mark.parametrize('name', RUNS)
def test_what_is_there_stays_without_force(files, tmp_path, name):
    arguments, of = RUNS[name]
    path = tmp_path / 'out' / of
    path.parent.mkdir(parents=True)
    path.write_text('mine')
    with serving(files['here'] / 'card') as address:
        values = files | {'out': tmp_path / 'out', 'address': address.text}
        done = call(name, arguments, values, status=1)
        told = [line for line in done.stderr.splitlines() if 'is there already' in line]
        assert len(told) == 1, done.stderr
        assert str(path) in told[0]
        assert '--force' in told[0]
        assert path.read_text() == 'mine'
        if name in QUICK_ENOUGH:
            call(name, arguments, values, '--force')
            assert path.read_bytes() != b'mine'


@pytest.mark.parametrize('name', [each for each in QUICK_ENOUGH if each not in OWN])
def test_folders_are_made(files, tmp_path, name):
    """One that cannot be made, as a file is in its place, is told in one line."""
    arguments, of = RUNS[name]
    (tmp_path / 'file').touch()
    with serving(files['here'] / 'card') as address:
        values = files | {'address': address.text}
        call(name, arguments, values | {'out': tmp_path / 'new' / 'out'})
        done = call(name, arguments, values | {'out': tmp_path / 'file' / 'out'}, status=1)
    assert (tmp_path / 'new' / 'out' / of).is_file()
    told = [line for line in done.stderr.splitlines() if 'Not a directory' in line]
    assert len(told) == 1, done.stderr
    assert str(tmp_path / 'file') in told[0]


@pytest.fixture(scope='module')
def on_full_disks(files, tmp_path_factory):
    """What each of FILLING ends with and tells, on a full disk of its own: (status, stderr)."""
    if subprocess.run(PLACE, capture_output=True, check=False).returncode:
        pytest.skip('no file system of its own may be mounted')
    folder, runs = tmp_path_factory.mktemp('full'), {}
    for number, name in enumerate(FILLING):
        disk = folder / str(number)
        disk.mkdir()
        arguments = (RUNS | KEPT)[name][0].format(**files | {'out': disk / 'out'})
        runs[name] = str(disk), [*name.split(' --')[0].split(), *arguments.split()]
    # One process for all of them: it is the only one that has these disks.
    done = subprocess.run(['unshare', '-Urm', sys.executable, FULL_DISKS], text=True,
                          input=json.dumps(runs), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize('name', FILLING)
def test_what_a_full_disk_does_not_take_is_named(on_full_disks, name):
    status, told = on_full_disks[name]
    assert status == 1, told
    folder = Path((RUNS | KEPT)[name][1]).parent
    last = told.splitlines()[-1]
    assert re.match(f'Error: cannot write .*{folder}.*: No space left', last), told


@pytest.mark.parametrize('name', KEPT)
def test_what_is_there_is_not_made_again(tmp_path, name):
    arguments, of = KEPT[name]
    (tmp_path / of).write_text('mine')
    assert 'were there' in call(name, arguments, {'out': tmp_path}).output
    assert (tmp_path / of).read_text() == 'mine'


@pytest.mark.parametrize('name', OWN)
def test_a_command_knows_its_own_results(files, tmp_path, name):
    arguments, of = RUNS[name]
    for out in ('one', 'two'):
        values = files | {'out': tmp_path / out}
        call(name, arguments, values)
        if name in ('scenes render', 'simulate'):  # begun, and not ended
            (tmp_path / out / '000000' / 'truth.json').unlink()
        if out == 'one':
            shutil.copytree(tmp_path / 'one', tmp_path / 'two')  # of another time
    path = tmp_path / 'two' / of
    path.write_text('mine')
    assert str(path) in call(name, arguments, values, status=1).stderr.replace('\n', '')
    assert path.read_text() == 'mine'


@pytest.mark.parametrize(('module', 'of'), [('nodes.demo', 'overlay.png'),
                                            ('evaluation.bench.soak', 'soak.md')])
def test_what_is_there_stays_beside_a_graph(tmp_path, module, of):
    (tmp_path / of).write_text('mine')
    done = subprocess.run([sys.executable, '-m', f'pmcl_ros.{module}', '--out', tmp_path],
                          capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert 'is there already' in done.stdout + done.stderr
    assert [each.name for each in tmp_path.iterdir()] == [of]
