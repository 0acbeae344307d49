"""The package is one that colcon takes for ament_python, and its core needs no ROS."""

import os
import shutil
import subprocess
import sys
from importlib.metadata import requires
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'pmcl_ros'
NODES = ['lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node']
ROS = ('rclpy', 'rcl_interfaces', 'builtin_interfaces', 'std_srvs', 'launch', 'launch_ros')
WITH_ROS = ('nodes/', 'simulated_robot/robot_node', 'simulated_robot/wrist_eyes',
            *(f'evaluation/bench/{name}.py' for name in ('latency', 'ros_programs', 'soak')),
            *(f'messages/{name}.py' for name in ('diagnostics', 'grasp', 'marker')))


def core_modules():
    """The names of all modules that must work where ROS is not installed."""
    paths = [path.relative_to(PACKAGE) for path in sorted(PACKAGE.rglob('*.py'))]
    return ['.'.join(('pmcl_ros', *path.with_suffix('').parts)).removesuffix('.__init__')
            for path in paths if not path.as_posix().startswith(WITH_ROS)]


def test_the_core_can_be_imported_without_ros():
    script = f"""
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        root = name.split('.')[0]
        if root in {ROS!r} or root.endswith('_msgs'):
            raise ImportError(name + ' is blocked')
sys.meta_path.insert(0, Blocker())
import gc, importlib
gc.disable()  # TensorFlow comes in a quarter of the time
for name in {core_modules()!r}:
    importlib.import_module(name)
"""
    subprocess.run([sys.executable, '-c', script], cwd=ROOT, check=True)


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A colcon workspace with a copy of what belongs to the package."""
    if find_spec('colcon') is None:
        pytest.skip('colcon is not installed beside this Python')
    workspace = tmp_path_factory.mktemp('workspace')
    source = workspace / 'src' / 'pmcl_ros'
    for each in ('pmcl_ros', 'config', 'examples', 'launch', 'models', 'resource'):
        shutil.copytree(ROOT / each, source / each, ignore=shutil.ignore_patterns('__pycache__'))
    for each in (*(ROOT / each for each in ('package.xml', 'setup.py', 'setup.cfg')),
                 *ROOT.glob('requirements*.txt')):
        shutil.copy(each, source)
    return workspace


def test_colcon_takes_it_for_ament_python(workspace):
    # An invalid maintainer e-mail is enough to make it a plain (python) package, which ROS does
    # not find. This is what `colcon list` prints.
    from colcon_core.package_descriptor import PackageDescriptor
    from colcon_ros.package_identification.ros import RosPackageIdentification
    package = PackageDescriptor(workspace / 'src' / 'pmcl_ros')
    RosPackageIdentification().identify(package)
    assert (package.name, package.type) == ('pmcl_ros', 'ros.ament_python')


def test_colcon_installs_every_node_and_file(workspace):
    subprocess.run([sys.executable, '-m', 'colcon', 'build'], cwd=workspace, check=True,
                   capture_output=True)
    install = workspace / 'install' / 'pmcl_ros'
    assert (install / 'share' / 'pmcl_ros' / 'hook' / 'ament_prefix_path.sh').is_file()
    for each in (*NODES, 'grasp_node', 'sweep_driver', 'fixed_cameras', 'board_node',
                 'pmcl_bringup', 'pmcl_record', 'pmcl_replay', 'pmcl'):
        assert os.access(install / 'lib' / 'pmcl_ros' / each, os.X_OK), each
    share = install / 'share'
    assert (share / 'ament_index' / 'resource_index' / 'packages' / 'pmcl_ros').exists()
    for each in ('package.xml', 'config/pmcl.yaml', 'config/fastdds_shm.xml',
                 'config/learned/contour.yaml', 'config/learned/creases.yaml',
                 'launch/pmcl.launch.py', 'config/cameras/demo.yaml', 'models/wine_glass.obj'):
        assert (share / 'pmcl_ros' / each).is_file(), each
    for each in ('page.html', 'page.css'):  # beside the modules that read them
        assert list(install.rglob(f'pmcl_ros/evaluation/report/{each}')), each
    # the installed node's own Python finds it
    script = install / 'lib' / 'pmcl_ros' / 'dlv_node'
    interpreter = Path(script.read_text().splitlines()[0].removeprefix('#!'))
    assert interpreter.name == Path(sys.executable).name
    assert interpreter.parent.samefile(Path(sys.executable).parent)


def test_versions_agree():
    import pmcl_ros
    version = pmcl_ros.__version__
    assert f'<version>{version}</version>' in (ROOT / 'package.xml').read_text()
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    assert f'## {version}' in (ROOT / 'CHANGES.md').read_text()


def test_ros_wheels_are_an_extra():
    # pip would put them into a machine that has /opt/ros
    of_ros = [each for each in requires('pmcl_ros') if each.startswith('ros-')]
    assert len(of_ros) == 3
    assert all(each.endswith('extra == "ros"') for each in of_ros)
    base = [each for each in requires('pmcl_ros') if 'extra' not in each]
    assert len(base) > 10
