"""A simulated arm takes things out of water through the real nodes, over real DDS."""

from dataclasses import replace

import pytest
from only_required import environment

from pmcl_ros.evaluation.manipulation.series import Series
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.resources import resolve
from pmcl_ros.simulation.manipulation.workplace import OBJECTS

REQUIRED = ('requirements.txt', 'requirements-ros.txt', 'requirements-manipulate.txt')
CAMERA = '{width: 320, height: 240, fx: 300, cx: 159.5, cy: 119.5}'


@pytest.fixture(autouse=True)
def _only_required(tmp_path, monkeypatch):
    """The programs of a trial find what `make demo SCENE=sink` installs, and no more."""
    monkeypatch.setenv('PYTHONPATH', environment(tmp_path / 'needed', *REQUIRED)['PYTHONPATH'])


@pytest.fixture
def series(tmp_path):
    return series_of('sink', tmp_path)


def series_of(place, folder):
    name, mass = OBJECTS[place]
    (folder / 'camera.yaml').write_text(CAMERA)
    return Series(place, resolve(f'package://pmcl_ros/config/objects/{name}.yaml', 'object'), mass,
                  str(folder / 'camera.yaml'), 'fast', 1, folder / 'out')


def test_a_glass_is_seen_by_an_f01_grasped_and_put_upright_on_the_tray(series):
    series = replace(series, camera='f01')
    trial = series.run(1)
    folder = series.file(1).parent
    logs = '\n'.join(each.read_text() for each in folder.glob('*.log'))
    assert trial.done, logs
    assert trial.cause == ''
    assert not trial.stands
    assert len(trial.pictures) >= 3
    for each in trial.pictures:  # the centre views
        assert read_picture(folder / each.file).shape == (328, 328, 3)
    assert (series.pinhole.width, series.pinhole.height) == (328, 328)
    assert (folder / 'film.png').is_file()
    assert trial.poses[-1][0] < 10  # mm
    assert [each.held for each in trial.grips][-1]
    assert trial.largest_touch < 10  # N
    assert series.run(1) == trial  # it is kept


def test_a_drifting_bottle_is_seen_by_a_camera_behind_a_film_and_lifted(tmp_path):
    series = replace(series_of('tank', tmp_path), samples=4)
    trial = series.run(1)
    logs = '\n'.join(each.read_text() for each in series.file(1).parent.glob('*.log'))
    assert trial.done, logs
    assert trial.cause == ''
    assert trial.poses[-1][0] < 10  # mm
    assert trial.grips[-1].moved > 1  # mm: it drifted after it was seen
    assert trial.largest_touch < 10  # N


def test_a_folder_is_of_one_series(series):
    series.claim()
    series.claim()
    with pytest.raises(SettingsError, match='has trials of another series'):
        replace(series, camera='f01').claim()
    with pytest.raises(SettingsError, match='has trials of another series'):
        replace(series, samples=2).claim()
    camera = series.out.parent / 'camera.yaml'
    camera.write_text(CAMERA.replace('300', '310'))
    with pytest.raises(SettingsError, match=r'has other SHA-256 of camera\.yaml\): choose'):
        series.claim()
    camera.write_text(CAMERA)
    series.claim()
