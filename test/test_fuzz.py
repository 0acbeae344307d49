"""Files of every format, damaged in ways that are drawn: refused in one line, or read.

`make fuzz` runs ten thousand of them and more; here are a hundredth.
"""

import math
import os
import resource
import shutil
import signal
import warnings
from contextlib import contextmanager

import pytest
from damaged_files import formats
from damaged_settings import UNREADABLE, settings_formats
from hypothesis import HealthCheck, given, settings
from mutations import MUTATIONS, mutated

from pmcl_ros.runtime.errors import PmclError

NAMES = [
    'mcap of raw', 'mcap of views', 'mcap of posed', 'mcap of robot', 'mcap without checksum',
    'message of raw', 'message of views', 'message of posed', 'message of robot',
    'metadata.yaml', 'db3', 'png', 'png with right checksums', 'jpg', 'tif', 'bmp', 'webp', 'ppm',
    'mosaic', 'stl', 'stl in text', 'obj', 'ply', 'ply in text', 'off', 'glb', 'object', 'grasps',
    'light_field.yaml', 'views.yaml', 'sweep.yaml', 'transforms.json', 'bop', 'scene_gt.json',
    'scene_gt_info.json', 'targets', 'hci', 'cameras.txt', 'images.txt',
    'cameras.bin', 'images.bin',
    'npz', 'npz with right checksums', 'txt', 'raw', 'xz', 'lfp', 'calibration', 'truth',
    'sweep plan', 'camera plan', 'camera', 'camera of ROS', 'collect', 'candidates',
    'gripper', 'token',
    'parameters', 'appearance', 'labelled picture', 'contour_map.onnx', 'hand-eye',
    'learned contour', 'learned creases', 'learned contour_map', 'learned contour_map_evidence',
    'learned views']
MANY = os.environ.get('PMCL_FUZZ_INPUTS')
INPUTS = int(MANY or 100)
SECONDS, MEGABYTES = 5, 700


@pytest.fixture(scope='module')
def made(tmp_path_factory, camera_text):
    folder = tmp_path_factory.mktemp('formats')
    found = formats(folder, camera_text)
    found |= settings_formats(folder / 'settings', folder / 'bags' / 'robot')
    assert sorted(found) == sorted(NAMES)
    return found


@contextmanager
def in_time():
    def late(*_):
        raise AssertionError(f'not done after {SECONDS} s')
    before = signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize('name', NAMES)
def test_a_damaged_file(made, name):
    if name in UNREADABLE:
        pytest.skip("it is read with the extra 'simulate'")
    of = made[name]
    expected = of.read(of.write(of.data)) if of.exact else None
    wanted, tried = math.ceil(INPUTS / len(NAMES)), 0
    megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000

    @settings(max_examples=wanted, derandomize=MANY is None,
              database=None, suppress_health_check=[*HealthCheck])
    @given(MUTATIONS)
    def check(steps):
        nonlocal tried
        tried += 1
        source, found, told = of.write(mutated(of.data, steps)), expected, ''
        try:
            with in_time(), warnings.catch_warnings():
                warnings.simplefilter('error', RuntimeWarning)
                found = of.read(source)
        except PmclError as error:
            told = str(error)
        assert not of.exact or found == expected
        assert not told or source.stem in told or source.parent.name in told
        assert (told + 'x').isprintable()
        assert len(told) < 2500
        if source.parent.name.startswith('message '):
            shutil.rmtree(source)
    check()
    assert tried >= wanted
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000 < megabytes + MEGABYTES
