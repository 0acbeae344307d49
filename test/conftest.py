"""What the tests share: a ROS domain of each worker's own, GL, the JSON of a made-up camera."""

import gc
import itertools
import json
import os
import signal
import sys
from pathlib import Path
from shutil import copytree

import hypothesis
import pytest

import pmcl_ros
from pmcl_ros.runtime import kernel_threads
from pmcl_ros.runtime.gl import GlContext
from pmcl_ros.runtime.ros_domain import own_domain

# Modules and tests stay: to look for garbage among them took a quarter of the time of collecting.
_THRESHOLDS = gc.get_threshold()
gc.set_threshold(100_000)
# What tests start is ended by a hang-up, even where they themselves are to outlive a terminal.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
# Before any rclpy.init, and inherited by every process a test starts. Fields are checked, as a
# message that only passes unchecked is not one that another build of ROS takes.
for _each in ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE'):
    os.environ.pop(_each, None)
own_domain()
os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')


# The workers share the cores: threads of theirs would wait for each other, and spin.
kernel_threads.set_threads(1)

# A busy machine takes long now and then; the same examples are drawn each time. (For that alone
# hypothesis is below 6.131: later ones also draw constants of whatever modules are loaded.)
hypothesis.settings.register_profile('pmcl_ros', deadline=None, derandomize=True,
                                     suppress_health_check=[hypothesis.HealthCheck.too_slow])
hypothesis.settings.load_profile('pmcl_ros')


# Rooms and files whose tests start processes, search for poses, trace rays, calibrate simulated
# arms or wait for a camera.
SLOW = {'nodes', 'launch', 'evaluation', 'simulation', 'learning', 'cli', 'tracking',
        'multi_object', 'multi_view', 'test_contour_map_search.py', 'test_sunken.py',
        'test_contour_net.py', 'test_faults.py', 'test_kernels.py', 'test_kernel_threads.py',
        'test_same_digits.py', 'test_localizer.py', 'test_particle_filter.py',
        'test_level_of_detail.py', 'test_proposals.py', 'test_pipeline.py', 'test_package.py',
        'test_launch.py', 'test_docs.py', 'test_calibrate.py', 'test_board_search.py',
        'test_bundle.py',
        'test_back_end.py', 'test_render_back_end.py', 'test_hand_eye.py', 'test_fixed_board.py',
        'test_intrinsics.py', 'test_bent_board.py', 'test_exchanged_pictures.py',
        'test_start.py', 'test_second_search.py', 'test_orientation.py', 'test_measure.py'}
# A file of these rooms that is not: pages that are older than the code are told by a quick run.
QUICK = {'test_reference.py'}


def _is_slow(path):
    return path.name not in QUICK and not SLOW.isdisjoint(_below(path))


def _below(path):
    return path.parts[len(Path(__file__).parent.parts):]


# TensorFlow and Mesa bring an LLVM each: GL crashes in a process that has imported TensorFlow. So
# these rooms and files are for a run of their own, `-m tensorflow`, and no other run imports them.
TENSORFLOW = {'contour_net', 'test_learn_map_command.py'}


def pytest_ignore_collect(collection_path, config):
    """Files of tests that are not to run are not even imported, which takes long too."""
    chosen, apart = config.option.markexpr, not TENSORFLOW.isdisjoint(_below(collection_path))
    if collection_path.is_file() and apart != (chosen == 'tensorflow'):
        return True
    return (chosen == 'not slow' and _is_slow(collection_path)) or None


def pytest_collection_modifyitems(items):
    """The nodes' files in turn with others: nodes wait much, and others compute meanwhile.

    The quick ones last: no worker shall be left alone with a long one.
    """
    files = list(dict.fromkeys(item.path for item in items))
    nodes = [each for each in files if 'nodes' in each.parts]
    others = sorted((each for each in files if each not in nodes),
                    key=lambda path: not _is_slow(path))
    pairs = itertools.chain.from_iterable(itertools.zip_longest(nodes, others))
    rank = {path: number for number, path in enumerate(pairs)}
    items.sort(key=lambda item: rank[item.path])
    for item in items:
        if _is_slow(item.path):
            item.add_marker(pytest.mark.slow)
        if not TENSORFLOW.isdisjoint(_below(item.path)):
            item.add_marker(pytest.mark.tensorflow)


def pytest_collection_finish():
    """What has been imported and collected is no garbage: from now on it is not looked at."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_THRESHOLDS)


@pytest.fixture
def all_threads():
    """Kernels of the test run on as many threads as there are cores; their number."""
    kernel_threads.set_threads(kernel_threads.CORES)
    yield kernel_threads.CORES
    kernel_threads.set_threads(1)


@pytest.fixture
def package_tree(tmp_path):
    """A folder to start Python in: the package, with a copy of its data that a test may change."""
    root, tree = Path(pmcl_ros.__file__).parents[1], tmp_path / 'tree'
    copytree(root / 'config', tree / 'config')
    for each in ('pmcl_ros', 'models'):
        (tree / each).symlink_to(root / each)
    return tree


@pytest.fixture(scope='session')
def camera_text():
    """A function (width, height) -> the JSON that an F01 writes beside a picture of that size."""
    def text(width=3280, height=3280):
        levels = {'r': 168, 'gr': 168, 'gb': 168, 'b': 168}
        image = {
            'width': width, 'height': height,
            'rawDetails': {
                'pixelFormat': {'black': levels, 'white': dict.fromkeys(levels, 4095)},
                'mosaic': {'tile': 'r,gr:gb,b', 'upperLeftPixel': 'b'},
            },
            'color': {'ccmRgbToSrgbArray': [1, 0, 0, 0, 1, 0, 0, 0, 1], 'gamma': 0.41666,
                      'whiteBalanceGain': dict.fromkeys(levels, 1.0)},
        }
        return json.dumps({'image': image})
    return text


@pytest.fixture(scope='session')
def _session_context():
    context = GlContext()
    yield context
    context.close()


@pytest.fixture
def context(_session_context):
    """GL, with a look at its errors before the test and after."""
    assert 'tensorflow' not in sys.modules, 'GL crashes beside it: see TENSORFLOW in conftest.py'
    _session_context.use()
    assert _session_context.gl.error == 'GL_NO_ERROR'
    yield _session_context
    _session_context.use()
    assert _session_context.gl.error == 'GL_NO_ERROR'
