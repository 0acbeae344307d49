"""`pmcl simulate` and `pmcl feasibility`, on small pictures."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from click.testing import CliRunner, Result

from pmcl_ros.cli import main
from pmcl_ros.drawing.pictures import silhouette
from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.path_tracing.variant import mitsuba

CAMERA = {'width': 160, 'height': 120, 'fx': 150.0, 'cx': 79.5, 'cy': 59.5}
SMALL = {'width': 44, 'height': 33, 'fx': 41.25, 'cx': 21.5, 'cy': 16.0}  # of the same view


@pytest.fixture
def tumbler(tmp_path: Path) -> Path:
    """An STL of the outer surface in millimetres, and what it is made of."""
    profile = np.array([[0, 0], [27, 0], [28.5, 2], [36, 96], [0, 96]], float)
    mesh = trimesh.creation.revolve(profile, sections=48)
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.fix_normals()
    mesh.export(tmp_path / 'tumbler.stl')
    (tmp_path / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
    described = tmp_path / 'tumbler.yaml'
    described.write_text(yaml.safe_dump({
        'mesh': 'tumbler.stl', 'scale': 0.001,
        'appearance': {'material': 'glass', 'wall': 0.0025, 'floor': 0.008,
                       'mouth': {'z': 0.096, 'open': True}}}))
    return described


def run(tumbler: Path, command: str, *options: str) -> Result:
    return CliRunner().invoke(main, [command, str(tumbler), '--camera',
                                     str(tumbler.with_name('camera.yaml')), *options])


@pytest.mark.parametrize('renderer', ['physical', 'fast'])
def test_captures_show_the_object_where_the_truth_says(tumbler: Path, renderer: str) -> None:
    out = tumbler.parent / 'out'
    options = ('--renderer', renderer, '--samples', '2', '--surroundings', 'table', '--attitude',
               'upright', '--cameras', 'arc:2:20', '--count', '1', '--seed', '3', '-o', str(out))
    made = run(tumbler, 'simulate', *options)
    assert made.exit_code == 0, made.output
    capture, = find_captures(out)
    source = read_source(capture.source)
    assert isinstance(source, PosedViews)
    model = ObjectModel.load(tumbler)
    assert model.clear
    assert ObjectModel.load(capture.model).clear  # its user says so, and the capture after him
    for view in source.views:
        into = np.linalg.inv(view.camera_to_reference)
        inside = silhouette(view.pinhole, model, into @ capture.truth.pose, 1) > 0
        assert 200 < inside.sum() < 0.5 * inside.size
        assert 0.05 < view.picture.mean() < 0.95
    kept = (capture.folder / '000.png').read_bytes()
    (capture.folder / '000.png').write_bytes(b'kept')
    assert run(tumbler, 'simulate', *options).exit_code == 0  # what is there is kept
    assert (capture.folder / '000.png').read_bytes() == b'kept'
    if renderer == 'fast':
        assert run(tumbler, 'simulate', *options, '--force').exit_code == 0
        assert (capture.folder / '000.png').read_bytes() == kept
        (capture.folder / '000.png').write_bytes(b'kept')
        # And made again where it is not whole, but for what is not its own
        (capture.folder / 'truth.json').unlink()
        refused = run(tumbler, 'simulate', *options)
        assert refused.exit_code == 1
        assert '000.png is there already' in refused.output
        assert (capture.folder / '000.png').read_bytes() == b'kept'
        (capture.folder / '000.png').write_bytes(kept)
        assert run(tumbler, 'simulate', *options).exit_code == 0
        assert (capture.folder / '000.png').read_bytes() == kept


@pytest.mark.parametrize(('look', 'clear'), [
    ({'material': 'glass'}, True), ({'material': 'glass', 'roughness': 0.1}, False),
    ({'material': 'frosted'}, False), ({'material': 'glass', 'up': [0, 0, -1]}, True)])
@pytest.mark.parametrize('declared', [
    {}, {'symmetries_continuous': []},
    {'symmetries_discrete': [np.diag([1.0, -1, -1, 1]).ravel().tolist()]},
    {'symmetries_discrete': []}])
def test_captures_keep_symmetry_and_material(tmp_path: Path, look: dict[str, Any], clear: bool,
                                             declared: dict[str, Any]) -> None:
    trimesh.creation.cylinder(0.03, 0.1, sections=32).export(tmp_path / 'rod.stl')
    (tmp_path / 'camera.yaml').write_text(yaml.safe_dump(SMALL))
    rod = tmp_path / 'rod.yaml'
    rod.write_text(yaml.safe_dump({'mesh': 'rod.stl', 'scale': 1.0, **declared,
                                   'appearance': {'solid': True, **look}}))
    made = run(rod, 'simulate', '--renderer', 'fast', '--samples', '1', '--count', '1', '-o',
               str(tmp_path / 'out'))
    assert made.exit_code == 0, made.output
    capture, = find_captures(tmp_path / 'out')
    told, kept = ObjectModel.load(rod), ObjectModel.load(capture.model)
    assert told.clear is kept.clear is clear
    np.testing.assert_allclose(kept.up, told.up)
    none = 'symmetries_continuous' in declared
    assert (kept.axis is None) == (told.axis is None) == none
    if told.axis is not None and kept.axis is not None:
        np.testing.assert_allclose(kept.axis, told.axis, atol=1e-9)
    np.testing.assert_allclose(kept.discrete, told.discrete, atol=1e-9)
    assert len(kept.discrete) == (2 if declared.get('symmetries_discrete', not none) else 1)


def test_feasibility_goes_on_where_it_was(tumbler: Path) -> None:
    out = tumbler.parent / 'out'
    seen = '--renderer', 'fast', '--samples', '2', '--cameras', 'arc:2:30'
    options = *seen, '-o', str(out)
    # Scenes may be simulated elsewhere, as on a cluster.
    assert run(tumbler, 'simulate', '--count', '1', *seen, '-o', f'{out}/scenes').exit_code == 0
    made = run(tumbler, 'feasibility', '--scenes', '1', *options)
    assert made.exit_code == 0, made.output
    assert 'Too few scenes' in made.output
    assert '0 of 1 scenes to make, 1 more to search in' in made.output
    page = (out / 'feasibility.html').read_text()
    assert 'Will it work for tumbler?' in page
    assert page.count('data:image/png') == 2  # scenes, the one that is worst; no curve of one
    assert 'What fails' not in page
    trials = json.loads((out / 'scenes' / '000000' / 'trials.json').read_text())
    assert list(trials) == ['one view', 'two views over 30 degrees']
    before = (out / 'scenes' / '000000' / 'trials.json').stat().st_mtime_ns
    more = run(tumbler, 'feasibility', '--scenes', '2', *options)
    assert more.exit_code == 0, more.output
    assert '1 of 2 scenes to make, 0 more to search in\n' in more.output
    assert 'the first scene took' not in more.output  # nor is anything left after it
    assert (out / 'scenes' / '000000' / 'trials.json').stat().st_mtime_ns == before
    assert (out / 'scenes' / '000001' / 'trials.json').exists()
    same = run(tumbler, 'feasibility', '--scenes', '2', *options)
    assert '0 of 2 scenes to make, 0 more to search in\n' in same.output
    assert 'about' not in same.output
    other = run(tumbler, 'feasibility', '--scenes', '1', '--region', '0.5:0.6', *options)
    assert other.exit_code == 1
    assert 'scenes of another simulation: distance 0.35 to 0.7 m, not 0.5 to 0.6 m' in other.output
    tumbler.write_text(tumbler.read_text().replace('0.0025', '0.003'))
    other = run(tumbler, 'feasibility', '--scenes', '1', *options)
    assert 'scenes of another simulation: object, camera or settings have' in other.output


def test_the_time_is_told_before_the_first_scene(tumbler: Path) -> None:
    """Here the first scene is refused: a file is in its way."""
    out = tumbler.parent / 'out'
    for command, options, file, told in (
            ('simulate', (), 'out/000000/view.png', ''),
            ('feasibility', (), 'out/scenes/000000/000.png', '20 of 20 scenes to make, 0 more to '
             'search in\n'),
            ('simulate', ('--camera', 'f01-raw'), 'out/calibration.yaml',
             'raw pictures take long: ')):
        in_the_way = tumbler.parent / file
        in_the_way.parent.mkdir(parents=True)
        in_the_way.write_text('mine')
        made = run(tumbler, command, '--renderer', 'fast', *options, '-o', str(out))
        assert made.exit_code == 1
        before, after = re.split(r'about \d+ (?:s|min) to \d+ (?:s|min)\n', made.output)
        assert before == told
        assert f'{in_the_way} is there already' in after
        shutil.rmtree(out)


def test_made_anew_by_two_processes_it_has_the_digits_of_one(tumbler: Path) -> None:
    scenes = tumbler.parent / 'out' / 'scenes'
    outputs, studies, times = [], [], []
    for options in ((), ('--force', '--jobs', '2')):
        made = run(tumbler, 'feasibility', '--renderer', 'fast', '--samples', '2', '--cameras',
                   'arc:2:30', '--scenes', '2', *options, '-o', str(scenes.parent))
        assert made.exit_code == 0, made.output
        assert '2 of 2 scenes to make, 0 more' in made.output
        files = sorted(scenes.glob('0*/trials.json'))
        outputs.append(made.output)
        times.append([each.stat().st_mtime_ns for each in files])
        studies.append([{name: {**trial, 'seconds': 0} for name, trial in json.loads(
            each.read_text()).items()} for each in files])
    assert re.search(r'\nabout \d+ (s|min) more: the first scene took \d+ (s|min)\n', outputs[0])
    assert len(studies[0]) == 2
    assert studies[0] == studies[1]
    assert all(after > before for before, after in zip(*times, strict=True))


def test_one_view_alone_needs_no_arm(tumbler: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It is judged by where its camera was, not by where an arm of many errors tells it was."""
    plan = tumbler.with_name('plan.yaml')
    plan.write_text(yaml.safe_dump({'arc': [2, 30], 'sigma_mm': 50.0}))
    out = tumbler.parent / 'out'
    made = run(tumbler, 'feasibility', '--renderer', 'fast', '--samples', '2', '--cameras',
               str(plan), '--scenes', '1', '-o', str(out))
    assert made.exit_code == 0, made.output
    told, = caplog.messages
    assert told.startswith('000000, two views over 30 degrees: lost, ')
    scene = out / 'scenes' / '000000'
    truth = json.loads((scene / 'truth.json').read_text())
    source = read_source(scene)
    assert isinstance(source, PosedViews)
    alone, together = json.loads((scene / 'trials.json').read_text()).values()
    for trial, camera in (
            (alone, np.array(truth['cameras_to_reference'][alone['extra']['picture']])),
            (together, source.views[together['extra']['picture']].camera_to_reference)):
        seen = np.linalg.inv(camera) @ truth['object_to_reference']
        np.testing.assert_allclose(trial['extra']['truth'], seen[:3].ravel(), atol=1e-6)


def test_another_process_goes_on(tumbler: Path) -> None:
    """Whatever order its sets and dictionaries have."""
    options = ('--renderer', 'fast', '--samples', '1', '--count', '1', '-o',
               str(tumbler.parent / 'out'))
    assert run(tumbler, 'simulate', *options).exit_code == 0
    command = [sys.executable, '-m', 'pmcl_ros.cli', 'simulate', str(tumbler), '--camera',
               str(tumbler.with_name('camera.yaml')), *options]
    for seed in ('1', '2'):
        made = subprocess.run(command, env=os.environ | {'PYTHONHASHSEED': seed}, text=True,
                              capture_output=True, timeout=300)
        assert made.returncode == 0, made.stderr


def test_what_is_impossible_is_one_line(tumbler: Path) -> None:
    out = ('-o', str(tumbler.parent / 'out'))
    low = tumbler.with_name('low.yaml')
    low.write_text(yaml.safe_dump(CAMERA | {'height': 31}))
    for options, line in (
            (('--camera', str(low)), '160x31 px; 32 a side are needed'),
            (('--region', 'here'), 'expected NEAR:FAR'),
            (('--region', '0.7:0.35'), 'NEAR is beyond FAR'),
            (('--camera', 'none.yaml'), '--camera none.yaml: there is no such file')):
        for command in ('simulate', 'feasibility'):
            made = run(tumbler, command, *options, *out)
            assert made.exit_code == 1
            assert line in made.output
            assert made.output.count('\n') == 1
    assert not (tumbler.parent / 'out').exists()


@pytest.mark.parametrize('command', [
    'simulate {object} --camera {camera}', 'simulate {object} --camera f01-raw',
    'feasibility {object} --camera {camera}', 'scenes pictures --renderer physical'])
def test_without_the_extra_it_says_what_to_install(tumbler: Path, monkeypatch: pytest.MonkeyPatch,
                                                   command: str) -> None:
    out = tumbler.parent / 'out'
    mitsuba.cache_clear()
    monkeypatch.setitem(sys.modules, 'mitsuba', None)
    made = CliRunner().invoke(main, [*command.format(
        object=tumbler, camera=tumbler.with_name('camera.yaml')).split(), '-o', str(out)])
    mitsuba.cache_clear()
    assert made.exit_code == 1
    assert made.output.strip() == ('Error: physically based pictures need Mitsuba 3: pip install '
                                   "'pmcl_ros[simulate]'")
    assert not list(out.glob('*'))


def test_without_llvm_it_is_said_once_and_raw_pictures_are_refused_before_any_is_made(
        tumbler: Path) -> None:
    pytest.importorskip('mitsuba')
    camera, out = tumbler.with_name('camera.yaml'), tumbler.parent / 'out'
    camera.write_text(yaml.safe_dump(SMALL))
    command = ['simulate', str(tumbler), '--samples', '1', '--count', '2', '-o', str(out)]
    made = subprocess.run(
        [sys.executable, '-c', f"""from pathlib import Path
from pmcl_ros.cli import main
try:
    main({[*command, '--camera', 'f01-raw']})
except SystemExit as error:
    assert error.code == 1
assert not Path({str(out)!r}).exists()
main({[*command, '--camera', str(camera)]})"""],
        env=os.environ | {'DRJIT_LIBLLVM_PATH': os.devnull}, capture_output=True, text=True,
        timeout=300)
    assert made.returncode == 0, made.stderr
    assert made.stdout.splitlines() == [str(out / '000000'), str(out / '000001')]
    lines = made.stderr.splitlines()
    number, = (number for number, line in enumerate(lines) if 'scalar_rgb' in line)
    assert 'WARNING' in lines[number]
    assert 'apt install libllvm15 or newer' in lines[number]
    assert lines[number + 1] == (
        'Error: raw pictures by path tracing need an LLVM library: apt install libllvm15 or '
        'newer, or choose --renderer fast')


def test_what_cannot_be_drawn_takes_no_folder(tumbler: Path) -> None:
    """The first line says what to change, and that is done."""
    described = yaml.safe_load(tumbler.read_text())
    del described['appearance']['floor']
    described['appearance']['liquid'] = {'level': 0.05}
    tumbler.write_text(yaml.safe_dump(described))
    options = ('--renderer', 'fast', '--samples', '1', '--count', '1',
               '-o', str(tumbler.parent / 'out'))
    refused = run(tumbler, 'simulate', '--attitude', 'lying', *options)
    assert 'set attitude: upright' in refused.output
    made = run(tumbler, 'simulate', '--attitude', 'upright', '--region', '0.40:0.7', *options)
    assert made.exit_code == 0, made.output
    more = run(tumbler, 'simulate', '--attitude', 'upright', '--region', '0.4:0.70', *options)
    assert more.exit_code == 0, more.output


def test_other_scenes_are_not_taken_for_those_of_the_object(tumbler: Path) -> None:
    """Nor does `pmcl scenes render` write where `pmcl simulate` did."""
    out = tumbler.parent / 'out'
    (out / '000000').mkdir(parents=True)
    (out / '000000' / 'truth.json').write_text('{}')
    options = '--renderer', 'fast', '--samples', '1', '--count', '1', '-o', str(out)
    refused = run(tumbler, 'simulate', *options)
    assert 'has scenes of something else than pmcl simulate' in refused.output
    (out / '000000' / 'truth.json').unlink()
    assert run(tumbler, 'simulate', *options).exit_code == 0
    other = CliRunner().invoke(main, ['scenes', 'render', '--count', '1', '-o', str(out)])
    assert 'has scenes of pmcl simulate: choose another --out' in other.output


def test_an_object_that_does_not_fit_before_the_camera_is_refused(tumbler: Path) -> None:
    tumbler.write_text(tumbler.read_text().replace('scale: 0.001', 'scale: 0.01').replace(
        '0.096', '0.96').replace('0.0025', '0.025').replace('0.008', '0.08'))
    made = run(tumbler, 'simulate', '--renderer', 'fast', '-o', str(tumbler.parent / 'out'))
    assert made.exit_code == 1
    assert 'the object is 1.4 m across' in made.output
    assert 'check scale' in made.output
