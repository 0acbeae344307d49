"""Captures that `pmcl scenes render` writes are captures that the package reads."""

import numpy as np
import pytest
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.readers.read import read_light_field, read_source
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.simulation.files import write_capture, write_view
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene
from pmcl_ros.simulation.scenes.render import render


def test_what_is_written_is_read(tmp_path):
    rng = np.random.default_rng(21)
    settings = SceneSettings(views=3, size=40, empty=1, targets=2, kinds=('opaque film',))
    scene = random_scene(rng, settings)
    capture = render(scene, rng, 1)
    write_capture(tmp_path / 'one', scene, capture, 21)
    read = read_light_field(tmp_path / 'one')
    assert read.views == pytest.approx(capture.light_field.views, abs=1e-3)
    assert read.grid.pinhole == capture.light_field.grid.pinhole
    assert np.array_equal(read.grid.positions, capture.light_field.grid.positions)
    assert read.colour == capture.light_field.colour
    for place, target in zip(('one', 'one/1'), scene.targets, strict=True):
        truth = Truth.load(tmp_path / place / 'truth.json')
        assert truth.pose == pytest.approx(target.pose)
        assert truth.roi_center == pytest.approx(target.roi_center)
        assert truth.roi_size == pytest.approx(target.roi_size)
        assert truth.empty
        model = ObjectModel.load(tmp_path / place / 'model.obj')
        assert model.vertices == pytest.approx(target.vertices, abs=1e-6)
        assert model.closed
        assert model.axis is not None
        assert np.abs(model.axis) == pytest.approx(target.axis)
    with np.load(tmp_path / 'one' / 'depth.npz') as file:
        assert np.array_equal(file['labels'], capture.labels)


def test_nothing_of_a_capture_that_was_there_stays(tmp_path):
    """Of two targets and a picture; then of one and a light field."""
    camera = OrdinaryCamera(width=24, height=18, fx=30.0, cx=12, cy=9)
    settings = SceneSettings(views=3, size=16, empty=0, targets=2, kinds=('opaque block',))
    first = random_scene(np.random.default_rng(1), settings,
                         sensor=camera.sensor(np.random.default_rng(1)))
    write_view(tmp_path / 'one', first, np.zeros((18, 24, 3), np.uint8), camera, 1)
    assert (tmp_path / 'one' / 'model.yaml').exists()
    assert (tmp_path / 'one' / '1' / 'truth.json').exists()
    (tmp_path / 'one' / 'notes.txt').write_text('mine')
    rng = np.random.default_rng(2)
    second = random_scene(rng, SceneSettings(views=3, size=16, empty=0, kinds=('opaque',)))
    write_capture(tmp_path / 'one', second, render(second, rng, 1), 2)
    assert {each.name for each in (tmp_path / 'one').iterdir()} == {
        'views.npz', 'centre.png', 'depth.npz', 'model.obj', 'truth.json', 'notes.txt',
        '.pmcl_results.json'}
    assert isinstance(read_source(tmp_path / 'one'), LightField)


@pytest.mark.parametrize('targets', [3, 8])
def test_every_target_has_a_spot(targets):
    for seed in range(8):
        scene = random_scene(np.random.default_rng(seed),
                             SceneSettings(views=3, size=16, empty=0, targets=targets))
        assert len(scene.targets) == targets


def test_the_command_renders_the_scenes_of_consecutive_seeds(tmp_path):
    options = ['scenes', 'render', '--views', '3', '--size', '32', '--samples', '1']
    for arguments in (['--count', '2', '--seed', '3', '--jobs', '2', '-o', str(tmp_path / 'a')],
                      ['--count', '1', '--seed', '4', '-o', str(tmp_path / 'b')]):
        result = CliRunner().invoke(main, options + arguments)
        assert result.exit_code == 0, result.output
    assert [each.name for each in sorted((tmp_path / 'a').iterdir())] == ['000003', '000004']
    first, second = (read_light_field(tmp_path / each / '000004') for each in 'ab')
    assert np.array_equal(first.views, second.views)


def test_the_command_keeps_scenes_of_the_same_options(tmp_path):
    options = ['scenes', 'render', '--views', '3', '--size', '32', '-o', str(tmp_path)]
    written = []
    for samples, count in (('1', '1'), ('1', '2'), ('2', '1')):
        result = CliRunner().invoke(main, [*options, '--samples', samples, '--count', count])
        assert result.exit_code == 0, result.output
        written.append((tmp_path / '000000' / 'views.npz').stat().st_mtime_ns)
    assert written[0] == written[1] < written[2]
    assert (tmp_path / '000001').is_dir()


def test_the_command_says_what_is_impossible(tmp_path):
    result = CliRunner().invoke(main, ['scenes', 'render', '--views', '4', '-o', str(tmp_path)])
    assert result.exit_code == 1
    assert 'views' in result.output
    assert 'odd' in result.output
