"""`pmcl evaluate` as a user calls it, on captures made for it; and interrupted."""

import csv
import json
import os
import signal
import subprocess
import sys
import time

import cv2
import pytest
from command_line import pmcl
from pmcl_scenes import bracket
from synthetic_camera import SIDE, SyntheticCamera, waves
from tiny_capture import QUICK, write_capture

from pmcl_ros.camera.files import write_raw_frame
from pmcl_ros.lightfield.readers.read import read_light_field


@pytest.fixture(scope='module')
def captures(tmp_path_factory):
    folder = tmp_path_factory.mktemp('captures')
    write_capture(folder / 'glass')
    write_capture(folder / 'thing', seed=2, mesh=bracket(), film=True)
    return folder


def command(captures, *arguments):
    return [sys.executable, '-m', 'pmcl_ros.cli', 'evaluate', str(captures),
            *map(str, arguments)]


def group_lives(number):
    try:
        os.killpg(number, 0)
    except ProcessLookupError:
        return False
    return True


def rows_of(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def without_times(row):
    return {name: value for name, value in row.items() if not name.endswith('seconds')}


def test_all_that_a_run_writes(captures, tmp_path, monkeypatch):
    paper = 'row=faithful,faithful_particles=8,faithful_iterations=3'
    arguments = ('evaluate', captures, '--modes', 'centre', '--set', paper, '--sweep',
                 'particles=8,16', '--trials', 2, '--only', 'glass', '--out', tmp_path,
                 '--processes', 1)
    monkeypatch.setattr(sys, 'argv', ['pmcl', *map(str, arguments)])
    done = pmcl(*arguments)
    assert {each.name for each in tmp_path.iterdir()} == {
        '.pmcl_results.json',
        'results.csv', 'results.md', 'settings.json', 'success.png', 'errors.png', 'coverage.png',
        'time.png', *(f'bop_{name}.csv' for name in (
            'centre', 'particles=8', 'particles=16', paper.replace(',', '_')))}
    rows = rows_of(tmp_path / 'results.csv')
    assert [(each['mode'], each['seed']) for each in rows] == [
        (mode, seed) for mode in ('centre', paper, 'particles=8', 'particles=16')
        for seed in ('0', '1')]
    assert (tmp_path / 'results.md').read_text() == done.stdout
    settings = json.loads((tmp_path / 'settings.json').read_text())
    assert settings['rows']['particles=8']['search']['particles'] == 8
    assert settings['command'] == [*map(str, arguments)]
    assert settings['rows'][paper]['volume']['interpolation'] == 'phase'
    assert settings['rows']['centre']['volume']['interpolation'] == 'neutral'
    for name in ('success', 'errors', 'coverage', 'time'):
        assert cv2.imread(str(tmp_path / f'{name}.png')) is not None


def test_each_raw_picture_takes_the_white_image_that_fits_it(camera_text, tmp_path, caplog):
    captures = tmp_path / 'captures'
    options = ('--modes', 'centre', '--trials', 1, '--processes', 1, '--calibration',
               tmp_path / 'c.yaml', '--out')
    whites = {zoom: captures / 'white' / f'MOD_{zoom:04d}.RAW' for zoom in (100, 600)}
    whites[600].parent.mkdir(parents=True)
    for zoom, white in whites.items():  # its vignetting is of the zoom
        text = json.loads(camera_text(SIDE, SIDE)) | {'devices': {'lens': {'zoomStep': zoom}}}
        camera = SyntheticCamera(json.dumps(text), tilt=(zoom / 1e4, 0))
        write_raw_frame(white, camera.white())
        capture = write_capture(captures / str(zoom))
        (capture / 'views.npz').unlink()
        write_raw_frame(capture / 'IMG.RAW', camera.picture(waves, 0.4))
        camera.calibration.save(tmp_path / 'c.yaml')
    both = tmp_path / 'both'
    pmcl('evaluate', captures, *options, both)
    assert {each.name for each in whites.values()} <= set(
        json.loads((both / 'settings.json').read_text())['files'])
    found = {each['capture']: without_times(each) for each in rows_of(both / 'results.csv')}
    assert set(found) == {'100', '600'}
    pmcl('evaluate', captures, '--only', 600, '--white', whites[600], *options, tmp_path / 'one')
    row, = rows_of(tmp_path / 'one' / 'results.csv')
    assert without_times(row) == found['600']
    pmcl('evaluate', captures, '--only', 100, '--white', whites[600], *options,
         tmp_path / 'wrong', status=1)
    assert 'zoom step 100, the nearest white image' in caplog.text
    (captures / 'white').rename(tmp_path / 'elsewhere')
    refused = pmcl('evaluate', captures, *options, tmp_path / 'none', status=1)
    assert f'there is no {captures / "white"}; give it by --white' in refused.stderr


def test_a_folder_has_the_results_of_one_run_alone(captures, tmp_path):
    one = ('evaluate', captures, '--only', 'glass', '--trials', 1, '--processes', 1, '--out',
           tmp_path, '--modes', 'centre')
    pmcl(*one, '--sweep', 'particles=8,16')
    (tmp_path / 'own.png').write_text('mine')
    pmcl(*one)
    assert {each.name for each in tmp_path.iterdir()} == {
        '.pmcl_results.json', 'own.png', 'results.csv', 'results.md', 'settings.json',
        'success.png', 'errors.png', 'coverage.png', 'time.png', 'bop_centre.csv'}


def test_a_row_that_is_given_twice_is_run_once(captures, tmp_path):
    pmcl('evaluate', captures, '--only', 'glass', '--trials', 1, '--processes', 1, '--modes',
         'centre,centre', '--set', 'particles=8', '--sweep', 'particles=8,16', '--out', tmp_path)
    assert [each['mode'] for each in rows_of(tmp_path / 'results.csv')] == [
        'centre', 'particles=8', 'particles=16']


@pytest.mark.parametrize(('number', 'processes'), [(signal.SIGINT, 2), (signal.SIGTERM, 1)])
def test_an_interrupted_run_writes_what_it_has(captures, tmp_path, number, processes):
    """As a terminal does it: Ctrl-C reaches all processes of the group."""
    out, scratch = tmp_path / 'out', tmp_path / 'scratch'
    scratch.mkdir()
    with subprocess.Popen(command(captures, '--set', QUICK, '--modes', 'default', '--trials', 500,
                                  '--processes', processes, '--out', out), text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
                          env=os.environ | {'TMPDIR': str(scratch)}) as process:
        results = out / 'results.csv'
        while process.poll() is None and not (results.exists() and rows_of(results)):
            time.sleep(0.1)
        if number == signal.SIGINT:
            os.killpg(process.pid, number)
        else:
            process.send_signal(number)
        stdout, stderr = process.communicate()
    assert process.returncode == 130, stderr
    assert 'Traceback' not in stderr
    assert 'interrupted after' in stderr
    rows = rows_of(results)
    assert 1 <= len(rows) < 1000
    assert len({(row['mode'], row['capture'], row['seed']) for row in rows}) == len(rows)
    assert (out / 'results.md').read_text() == stdout
    assert f'| glass | default | {len(rows)} |' in stdout
    assert (out / 'success.png').exists()
    assert not list(scratch.iterdir())
    deadline = time.monotonic() + 60  # Python's own helper ends when it sees that nobody is left
    while group_lives(process.pid) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not group_lives(process.pid)


def test_views_are_read_as_the_options_say(captures, tmp_path):
    pmcl('evaluate', captures, '--only', 'glass', '--trials', 1, '--processes', 1, '--modes',
         'centre', '--shrink', 2, '--out', tmp_path)
    width, = {int(each['width_px']) for each in rows_of(tmp_path / 'results.csv')}
    assert width == read_light_field(captures / 'glass').grid.pinhole.width // 2
    done = pmcl('evaluate', captures, '--sigma-mm', 1, status=2)
    assert 'has no pictures with poses of their cameras' in ' '.join(done.stderr.split())


def test_what_cannot_be_done_is_told_at_once(captures):
    done = pmcl('evaluate', captures, '--set', 'moves=0', status=1)
    assert 'moves' in done.stderr
