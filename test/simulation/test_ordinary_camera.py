"""Photographs by an ordinary camera, their files, and the command that writes them."""

import functools

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.readers.read import read_source
from pmcl_ros.runtime.errors import LightFieldError, SettingsError
from pmcl_ros.simulation.files import write_view
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera, take_picture
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene

CAMERA = {'width': 96, 'height': 64, 'fx': 90.0, 'fy': 92.0, 'cx': 50.0, 'cy': 30.0}


@functools.cache
def taken(samples=24, **values):
    camera = OrdinaryCamera.make(CAMERA | values)
    rng = np.random.default_rng(2)
    settings = SceneSettings(kinds=('opaque',), empty=0, outside=0, field=min(camera.field, 1.5))
    scene = random_scene(rng, settings, sensor=camera.sensor(rng))
    return scene, camera, take_picture(scene, camera, rng, samples)


def off(view, expected, seen):
    """Mean difference of linear light, after the exposures, which differ, are made alike."""
    of, like = view.linear()[seen], expected.linear()[seen]
    return abs(of * (of * like).sum() / (of ** 2).sum() - like).mean()


WIDE = {'fx': 45.0, 'fy': 45.0, 'cx': 47.5, 'cy': 31.5}  # a fisheye's corners are 80 degrees off


@pytest.mark.parametrize(('model', 'numbers', 'changes', 'most'), [
    ('plumb_bob', (-0.25, 0.08, 0.004, -0.003), {}, 0.005),
    ('plumb_bob', (0.2, -0.02, 0.0, 0.0, 0.0), {}, 0.005),
    ('equidistant', (0.04, -0.01, 0.0, 0.0), {}, 0.005),
    ('equidistant', (-0.02, 0.003, -0.002, 0.0004), WIDE, 0.015)])  # its blur is undone too
def test_distorted_pictures_are_read_as_the_pinhole_sees_the_scene(tmp_path, model, numbers,
                                                                   changes, most):
    """The rendering undoes a distortion by iteration, the reader by OpenCV's maps."""
    sharp = {'noise': 0.0, 'blur': 1.0} | changes
    scene, camera, bent = taken(**sharp, model=model, distortion=numbers)
    _, plain, straight = taken(**sharp)
    write_view(tmp_path / 'bent', scene, bent, camera, 1)
    write_view(tmp_path / 'straight', scene, straight, plain, 1)
    write_view(tmp_path / 'unread', scene, bent, plain, 1)
    found, expected = (read_source(tmp_path / each) for each in ('bent', 'straight'))
    assert found.pinhole == expected.pinhole == plain.pinhole
    x, y = camera.lens.places(np.eye(3), camera.pinhole)
    seen = (x > 2) & (x < 93) & (y > 2) & (y < 61)
    assert seen.mean() > 0.5
    assert off(found, expected, seen) < most
    assert off(read_source(tmp_path / 'unread'), expected, seen) > 3 * most


def test_pictures_that_nobody_could_render_are_refused():
    with pytest.raises(SettingsError, match='10000x10000 px are larger than 67 million pixels'):
        OrdinaryCamera.make(CAMERA | {'width': 10_000, 'height': 10_000})


def test_noise_and_exposure_are_those_of_the_camera():
    clean, noisy = (taken(8, noise=each)[2] / 255. for each in (0.0, 0.02))
    light, off = clean ** 2.2, noisy ** 2.2 - clean ** 2.2
    middle = (light > 0.15) & (light < 0.85)
    green = off[..., 1][middle[..., 1]] / np.sqrt(2 * light[..., 1][middle[..., 1]])
    assert green.std() == pytest.approx(0.02, rel=0.2)
    assert 0.15 < light.mean() < 0.45
    taken.cache_clear()
    again = taken(8, noise=0.02)[2] / 255.
    np.testing.assert_array_equal(again, noisy)


@pytest.mark.parametrize('values', [
    {'distortion': (-3.0, 0.0, 0.0, 0.0)},
    {'model': 'equidistant', 'distortion': (0.01, 0.0, 0.0, 0.0)} | WIDE | {'fx': 36, 'fy': 36}])
def test_what_no_pinhole_sees_is_refused(values):
    with pytest.raises(LightFieldError, match=r'cannot be undone over 96x64 px.* 80 deg'):
        taken(samples=1, **values)


def render(tmp_path, *options, **camera):
    (tmp_path / 'camera.yaml').write_text(yaml.safe_dump(CAMERA | camera))
    return CliRunner().invoke(main, [
        'scenes', 'render', '--camera', str(tmp_path / 'camera.yaml'), '--count', '1', '--seed',
        '5', '--samples', '1', '-o', str(tmp_path / 'out'), *options])


def test_the_command_writes_captures_of_one_view(tmp_path):
    done = render(tmp_path, '--views', '1', '--targets', '2', '--kind', 'opaque block', gamma=2.0)
    assert done.exit_code == 0, done.output
    folder = tmp_path / 'out' / '000005'
    assert {each.name for each in folder.iterdir()} >= {'view.png', 'views.yaml', 'model.obj',
                                                        'truth.json', '1'}
    view, truth = read_source(folder), Truth.load(folder / '1' / 'truth.json')
    assert view.pinhole == OrdinaryCamera.make(CAMERA).pinhole
    pixel = view.pinhole.project(truth.pose[:3, 3])
    assert (pixel > -20).all()
    assert (pixel < (116, 84)).all()
    written = yaml.safe_load((folder / 'views.yaml').read_text())['cameras']['camera']
    assert written['gamma'] == 2
    assert 'noise' not in written
    stored = cv2.imread(str(folder / 'view.png'))[..., ::-1] / 255.
    np.testing.assert_allclose(view.linear(), stored ** 2, atol=1e-3)


@pytest.mark.parametrize(('options', 'camera', 'reason'), [
    (('--views', '2'), {}, 'takes one picture'), (('--size', '64'), {}, 'its own size'),
    ((), {'fx': 0.5}, 'fx'), ((), {'sparkle': 1}, 'sparkle'), ((), {'width': None}, 'width')])
def test_what_a_camera_cannot_do_is_said(tmp_path, options, camera, reason):
    done = render(tmp_path, *options, **camera)
    assert done.exit_code != 0
    assert reason in ' '.join(done.output.split())
    assert 'Traceback' not in done.output
