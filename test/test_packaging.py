"""Files for other people's tools, as far as they can be checked without these tools."""

import ast
import json
import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
from catkin_pkg.changelog import get_changelog_from_path

import pmcl_ros

ROOT = Path(__file__).parents[1]
# What package.xml may name beside ROS's packages: Ubuntu 24.04 has a package, and rosdep its key.
NOBLE = {f'python3-{name}' for name in (
    'click', 'jinja2', 'matplotlib', 'numpy', 'opencv', 'pytest', 'requests', 'rich', 'scipy',
    'venv', 'yaml', 'zeroconf')}
# Of requirements.txt: it has none, or one that is too old for this package, or rosdep no key.
BY_PIP = {'numba', 'trimesh', 'fast-simplification', 'moderngl', 'rosbags', 'pydantic', 'lz4',
          'zstandard'}
KEYS = {'opencv-python-headless': 'opencv', 'PyYAML': 'yaml'}
# Modules of Python's packages: those with other names than their package, and what these bring.
MODULES = {'cv2', 'yaml', 'annotated_types', 'pydantic_core', 'markupsafe', 'drjit', 'keras',
           'google', 'urllib3'}
# Of ROS, only where it is installed, and names of types in bags: docs/howto/pipelines.md.
OPTIONAL = {'vision_msgs', 'moveit_msgs', 'object_recognition_msgs', 'shape_msgs', 'tf2_msgs'}
# What MoveIt brings, for examples that ask it, and rclpy, for its actions.
OPTIONAL |= {'moveit', 'rclcpp', 'action_msgs'}


def dependencies(kind):
    return {each.text for each in ElementTree.parse(ROOT / 'package.xml').iter(kind)}


def stages():
    """The stages of the Dockerfile: [(from, name, its instructions)]."""
    text = re.sub(r'^#.*\n', '', (ROOT / 'Dockerfile').read_text(), flags=re.MULTILINE)
    lines = [line for line in text.replace('\\\n', ' ').splitlines() if line]
    found = []
    for line in lines:
        word, rest = line.split(maxsplit=1)
        if word == 'FROM':
            image, *name = rest.split(' AS ')
            found.append((image, ''.join(name), []))
        else:
            found[-1][2].append((word, rest))
    return found


def test_rosdep_can_satisfy_package_xml_on_ubuntu_2404():
    named = {each for kind in ('exec_depend', 'test_depend', 'depend', 'build_depend')
             for each in dependencies(kind)}
    assert {each for each in named if each.startswith('python3-')} <= NOBLE
    assert not any('numba' in each or each.endswith('-pip') for each in named)


def test_package_xml_and_requirements_agree():
    listed = re.findall(r'^([\w-]+)', (ROOT / 'requirements.txt').read_text(), re.MULTILINE)
    wanted = {f'python3-{KEYS.get(each, each)}' for each in listed if each not in BY_PIP}
    assert set(listed) > BY_PIP
    assert {each for each in dependencies('exec_depend') if each.startswith('python3-')} == {
        *wanted, 'python3-venv'}  # it makes the environment for what comes from pip


def named_packages():
    """What modules import, and the packages of message types that they name as text."""
    for folder in ('pmcl_ros', 'examples', 'launch'):
        for path in (ROOT / folder).rglob('*.py'):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    yield from (each.name.partition('.')[0] for each in node.names)
                elif isinstance(node, ast.ImportFrom):
                    yield node.module.partition('.')[0]
                elif isinstance(node, ast.Constant) and (found := re.fullmatch(
                        r'([a-z][a-z0-9_]*)/(msg|srv)/\w+', str(node.value))):
                    yield found[1]


def test_package_xml_names_every_ros_package_that_is_imported():
    listed = '\n'.join(path.read_text() for path in ROOT.glob('requirements*.txt'))
    of_pip = {each.replace('-', '_').lower()
              for each in re.findall(r'^([\w-]+)', listed, re.MULTILINE)}
    own = {'pmcl_ros', *(path.stem for path in (ROOT / 'examples').glob('*.py'))}
    found = {*named_packages()} - {*own, *sys.stdlib_module_names, *of_pip, *MODULES}
    assert found >= OPTIONAL
    packages = {'tf2_ros': 'tf2_ros_py'}
    assert {packages.get(each, each) for each in found - OPTIONAL} == {
        each for each in dependencies('exec_depend') if not each.startswith('python3-')}


# Names with an underscore that Python documents for users.
DOCUMENTED = {'_replace', '_exit'}


def private_names(path):
    """Those of others in a file: `x._name`, where x is not self, imports, and setattr of them."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in ('self', 'cls')
            names = [] if own else [node.attr]
        elif isinstance(node, ast.ImportFrom):
            names = [each.name for each in node.names]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).endswith('setattr'):
            names = [each.value.rpartition('.')[2] for each in node.args
                     if isinstance(each, ast.Constant) and isinstance(each.value, str)]
        else:
            continue
        yield from (f'{path.relative_to(ROOT)}:{node.lineno}: {name}' for name in names
                    if re.match('_(?!_)', name) and name not in DOCUMENTED)


def test_no_test_reads_a_private_name():
    assert [each for path in sorted((ROOT / 'test').rglob('*.py'))
            for each in private_names(path)] == []


def test_every_step_of_the_image_is_small_pinned_and_of_a_user():
    all_stages = stages()
    names = [name for _, name, _ in all_stages]
    for number, (image, _, steps) in enumerate(all_stages):
        assert image in names[:number] or re.fullmatch(r'[\w./-]+:(?!latest)[\w.-]+', image)
        for word, rest in steps:
            if word == 'RUN' and 'apt-get install' in rest:
                assert 'apt-get update' in rest
                assert '--no-install-recommends' in rest
                assert 'rm -rf /var/lib/apt/lists/*' in rest
            if word == 'RUN':
                assert 'sudo' not in rest
                assert ';' not in rest  # a step that fails ends the build
            if word == 'COPY' and '--from' not in rest:
                *sources, _ = [part for part in rest.split() if not part.startswith('--')]
                assert all((ROOT / each).exists() for each in sources)
            assert word in ('RUN', 'COPY', 'WORKDIR', 'USER', 'ENV', 'CMD')
    base = next(steps for _, name, steps in all_stages if name == 'base')
    assert base[-1] == ('USER', 'ubuntu')
    assert all_stages[-1][0] == 'base'  # who runs is not root
    assert not any(word == 'USER' for word, _ in all_stages[-1][2])
    assert json.loads(all_stages[-1][2][-1][1])[0] == 'bash'
    assert any('pmcl warm-up' in rest for _, rest in all_stages[-1][2])


def test_nothing_that_git_ignores_goes_into_the_image():
    left_out = {each.removeprefix('**/')
                for each in (ROOT / '.dockerignore').read_text().split()}
    ignored = {each.rstrip('/') for each in (ROOT / '.gitignore').read_text().split()}
    assert left_out >= {*ignored, '.git', '.import_linter_cache'}


def test_the_devcontainer_is_a_stage_of_the_image():
    folder = ROOT / '.devcontainer'
    read = json.loads((folder / 'devcontainer.json').read_text())
    assert (folder / read['build']['dockerfile']).resolve() == ROOT / 'Dockerfile'
    assert (folder / read['build']['context']).resolve() == ROOT
    assert read['build']['target'] in [name for _, name, _ in stages()]
    assert read['remoteUser'] == 'ubuntu'
    create = read['postCreateCommand']
    for name in re.findall(r'-r (\S+)', create):
        assert (ROOT / name).is_file()
    # In the container's home: the tree is the host's, with an environment of its own from `make`.
    assert re.search(r'-m venv --system-site-packages ~/venv ', create)
    assert '.venv' not in create
    assert create.endswith("echo '. /opt/ros/jazzy/setup.bash && . ~/venv/bin/activate' "
                           '>> ~/.bashrc')
    interpreter = read['customizations']['vscode']['settings']['python.defaultInterpreterPath']
    assert interpreter == '/home/ubuntu/venv/bin/python'


def commands_with_a_full_ros(page):
    """The lines of the first block under that heading."""
    text = page.read_text().split('## With a full ROS 2 Jazzy\n', 1)[1]
    return re.search(r'(?:^    .*\n)+', text, re.MULTILINE)[0]


def test_the_readme_installs_as_the_guide_does():
    commands = commands_with_a_full_ros(ROOT / 'docs/howto/deploy.md')
    assert 'rosdep install' in commands
    assert 'python -m colcon build' in commands
    assert commands_with_a_full_ros(ROOT / 'README.md') == commands


def test_pixi_brings_every_ros_package_of_package_xml():
    tomllib = pytest.importorskip('tomllib', reason='Python 3.11')
    read = tomllib.loads((ROOT / 'pixi.toml').read_text())
    ros = {f'ros-jazzy-{each.replace("_", "-")}' for each in dependencies('exec_depend')
           if not each.startswith('python3-')}
    assert ros <= set(read['dependencies'])
    assert read['pypi-dependencies'] == {'pmcl_ros': {'path': '.', 'editable': True}}
    assert read['workspace']['channels'] == ['robostack-jazzy', 'conda-forge']
    assert {command.split()[0] for command in read['tasks'].values()} <= {
        'pmcl', 'pmcl_bringup', 'python'}


def test_the_changelog_is_one_that_ros_reads():
    changelog = get_changelog_from_path(str(ROOT), 'pmcl_ros')
    assert [version for version, _, _ in changelog.foreach_version()] == [pmcl_ros.__version__]
    assert changelog.get_content_of_version(pmcl_ros.__version__)
    assert '\nForthcoming\n-----------\n* ' in (ROOT / 'CHANGELOG.rst').read_text()


@pytest.mark.parametrize('name', ['CONTRIBUTING.md', 'QUALITY_DECLARATION.md'])
def test_what_the_documents_name_is_there(name):
    text = (ROOT / name).read_text()
    named = re.findall(r'`([\w./-]+\.(?:md|yaml|txt|xml)|[\w./-]+/(?:run)?)`|'
                       r'\]\((?!http)([^)#]+)', text)
    paths = [first or second for first, second in named]
    assert paths
    for each in paths:
        assert (ROOT / each).exists(), each
    targets = set(re.findall(r'make ([\w-]+)', text))
    assert targets <= set(re.findall(r'^([\w-]+):', (ROOT / 'Makefile').read_text(), re.MULTILINE))
