"""Parameters name files by paths or package://pmcl_ros/..., in the source tree or installed."""

from pathlib import Path

import pytest

import pmcl_ros
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.resources import calibration_file, cameras_folder, resolve

ROOT = Path(__file__).parents[2]


def test_a_path_is_itself(tmp_path):
    assert resolve(str(tmp_path), 'source') == tmp_path


def test_a_package_path_is_found_in_the_source_tree():
    assert resolve('package://pmcl_ros/config/pmcl.yaml', 'p') == ROOT / 'config' / 'pmcl.yaml'


def test_a_package_path_is_found_where_it_is_installed(tmp_path, monkeypatch):
    mesh = tmp_path / 'share' / 'pmcl_ros' / 'models' / 'cup.obj'
    mesh.parent.mkdir(parents=True)
    mesh.touch()
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/opt/other:{tmp_path}')
    monkeypatch.setattr(pmcl_ros, '__file__', str(tmp_path / 'lib' / 'pmcl_ros' / '__init__.py'))
    assert resolve('package://pmcl_ros/models/cup.obj', 'object') == mesh


def test_a_package_path_is_found_in_the_prefix_that_the_package_is_installed_in(
        tmp_path, monkeypatch):  # as `pip install --prefix` or `--user` lays it out
    file = tmp_path / 'share' / 'pmcl_ros' / 'config' / 'learned' / 'contour.yaml'
    file.parent.mkdir(parents=True)
    file.touch()
    package = tmp_path / 'lib' / 'python3.12' / 'site-packages' / 'pmcl_ros'
    monkeypatch.delenv('AMENT_PREFIX_PATH', raising=False)
    monkeypatch.setattr(pmcl_ros, '__file__', str(package / '__init__.py'))
    assert resolve('package://pmcl_ros/config/learned/contour.yaml', 'learned') == file


@pytest.mark.parametrize(('path', 'reason'), [
    ('', "parameter 'object' is empty"),
    ('/nowhere/cup.obj', "parameter 'object': there is no /nowhere/cup.obj"),
    ('cup.obj', 'there is no /.*cup.obj'),
    ('package://pmcl_ros/cup.obj', 'cup.obj is in none of /'),
    ('package://other/cup.obj', 'there is no'),
])
def test_what_is_not_there_is_told(path, reason):
    with pytest.raises(SettingsError, match=reason):
        resolve(path, 'object')


def test_a_calibration_is_found_by_its_path_or_the_name_of_its_camera(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CONFIG_HOME', str(tmp_path / 'home'))
    monkeypatch.chdir(tmp_path)
    shipped = ROOT / 'config' / 'cameras' / 'demo.yaml'
    assert calibration_file(str(shipped)) == shipped
    assert calibration_file('package://pmcl_ros/config/cameras/demo.yaml') == shipped
    assert calibration_file('demo') == shipped
    with pytest.raises(SettingsError, match=r'no camera of that name; known are demo\. pmcl '
                                            r'calibrate --camera kitchen makes one'):
        calibration_file('kitchen')
    cameras_folder().mkdir(parents=True)
    for name in ('kitchen', 'demo'):  # the user's own before the shipped one
        (cameras_folder() / f'{name}.yaml').touch()
        assert calibration_file(name) == tmp_path / 'home/pmcl_ros/cameras' / f'{name}.yaml'
    Path('kitchen').touch()  # a file of that very name
    assert calibration_file('kitchen') == Path('kitchen')
    with pytest.raises(SettingsError, match=r'there is no .*kitchen\.yaml'):
        calibration_file('kitchen.yaml')
    with pytest.raises(SettingsError, match='is empty'):
        calibration_file('')
