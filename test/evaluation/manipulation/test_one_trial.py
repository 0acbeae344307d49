"""A simulated arm takes a glass out of water through the real nodes, over real DDS."""

from dataclasses import replace

import pytest

from pmcl_ros.evaluation.manipulation.series import Series
from pmcl_ros.lightfield.readers.pictures import read_picture
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.resources import resolve

CAMERA = '{width: 320, height: 240, fx: 300, cx: 159.5, cy: 119.5}'


@pytest.fixture
def series(tmp_path):
    (tmp_path / 'camera.yaml').write_text(CAMERA)
    return Series('sink', resolve('package://pmcl_ros/config/objects/tumbler.yaml', 'object'), 0.2,
                  str(tmp_path / 'camera.yaml'), 'fast', 1, tmp_path / 'out')


def test_a_glass_is_found_grasped_and_put_upright_on_the_tray(series):
    trial = series.run(1)
    logs = '\n'.join(each.read_text() for each in series.file(1).parent.glob('*.log'))
    assert trial.done, logs
    assert trial.cause == ''
    assert not trial.stands
    assert len(trial.pictures) >= 3
    assert (series.file(1).parent / 'film.png').is_file()
    assert trial.poses[-1][0] < 10  # mm
    assert [each.held for each in trial.grips][-1]
    assert trial.largest_touch < 10  # N
    assert series.run(1) == trial  # it is kept


def test_the_same_by_the_centre_views_of_an_f01(series):
    series = replace(series, camera='f01')
    trial = series.run(1)
    assert trial.done, '\n'.join(each.read_text() for each in
                                 series.file(1).parent.glob('*.log'))
    assert trial.poses[-1][0] < 10  # mm
    for each in trial.pictures:
        assert read_picture(series.file(1).parent / each.file).shape == (328, 328, 3)
    assert (series.pinhole.width, series.pinhole.height) == (328, 328)


def test_a_folder_is_of_one_series(series):
    series.claim()
    series.claim()
    with pytest.raises(SettingsError, match='has trials of another series'):
        replace(series, camera='f01').claim()
    with pytest.raises(SettingsError, match='has trials of another series'):
        replace(series, samples=2).claim()
