"""The package is one that colcon takes for ament_python, and its arrows point one way."""

import ast
import os
import shutil
import subprocess
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / 'pmcl_ros'
STAGES = ['camera', 'lightfield', 'dlv', 'pmcl', 'grasps', 'evaluation']
NODES = ['lytro_driver', 'subaperture_node', 'dlv_node', 'pmcl_node']
MODULES = sorted(path.relative_to(ROOT) for path in PACKAGE.rglob('*.py'))
ROS = ('rclpy', 'rcl_interfaces', 'builtin_interfaces', 'std_srvs', 'launch', 'launch_ros')


def imported(path):
    """Every module that a file imports, wherever in it."""
    for node in ast.walk(ast.parse((ROOT / path).read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert not node.level, f'{path}: relative import'
            yield node.module
            yield from (f'{node.module}.{alias.name}' for alias in node.names)


def may_import_ros(path):
    return path.parts[1] in ('nodes', 'conversions.py')


@pytest.mark.parametrize('path', MODULES, ids=str)
def test_arrows_point_one_way(path):
    part = path.parts[1].removesuffix('.py')
    later = STAGES[STAGES.index(part) + 1:] if part in STAGES else []
    if not may_import_ros(path):
        later = [*later, 'nodes', 'conversions']
    forbidden = {f'pmcl_ros.{each}' for each in later}
    found = {'.'.join(module.split('.')[:2]) for module in imported(path)}
    assert not found & forbidden


@pytest.mark.parametrize('path', [each for each in MODULES if not may_import_ros(each)], ids=str)
def test_ros_is_imported_only_in_nodes_and_conversions(path):
    roots = {module.split('.')[0] for module in imported(path)}
    assert not [each for each in roots if each in ROS or each.endswith('_msgs')]


def test_the_core_can_be_imported_without_ros():
    names = ['.'.join(path.with_suffix('').parts) for path in MODULES if not may_import_ros(path)]
    script = f"""
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        root = name.split('.')[0]
        if root in {ROS!r} or root.endswith('_msgs'):
            raise ImportError(name + ' is blocked')
sys.meta_path.insert(0, Blocker())
import importlib
for name in {[each.removesuffix('.__init__') for each in names]!r}:
    importlib.import_module(name)
"""
    subprocess.run([sys.executable, '-c', script], cwd=ROOT, check=True)


@pytest.fixture(scope='module')
def workspace(tmp_path_factory):
    """A colcon workspace with a copy of what belongs to the package."""
    if not colcon().exists():
        pytest.skip('colcon is not installed beside this Python')
    workspace = tmp_path_factory.mktemp('workspace')
    source = workspace / 'src' / 'pmcl_ros'
    for each in ('pmcl_ros', 'config', 'examples', 'launch', 'models', 'resource'):
        shutil.copytree(ROOT / each, source / each, ignore=shutil.ignore_patterns('__pycache__'))
    for each in ('package.xml', 'setup.py', 'setup.cfg', 'requirements.txt',
                 'requirements-ros.txt'):
        shutil.copy(ROOT / each, source / each)
    return workspace


def colcon():
    return Path(sys.executable).with_name('colcon')


def test_colcon_takes_it_for_ament_python(workspace):
    # An invalid maintainer e-mail is enough to make it a plain (python) package, which ROS does
    # not find. This is what `colcon list` prints.
    from colcon_core.package_descriptor import PackageDescriptor
    from colcon_ros.package_identification.ros import RosPackageIdentification
    package = PackageDescriptor(workspace / 'src' / 'pmcl_ros')
    RosPackageIdentification().identify(package)
    assert (package.name, package.type) == ('pmcl_ros', 'ros.ament_python')


def test_colcon_installs_every_node_and_file(workspace):
    subprocess.run([colcon(), 'build'], cwd=workspace, check=True, capture_output=True)
    install = workspace / 'install' / 'pmcl_ros'
    assert (install / 'share' / 'pmcl_ros' / 'hook' / 'ament_prefix_path.sh').is_file()
    for each in (*NODES, 'grasp_node', 'sweep_driver', 'pmcl_bringup', 'pmcl_record',
                 'pmcl_replay', 'pmcl'):
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
    assert sys.executable in script.read_text().splitlines()[0]


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
