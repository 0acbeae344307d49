"""Volumes reach another process whole and without loss, with and without the shipped profile."""

import json
import os
import subprocess
import sys

import pytest
from harness import PATIENCE, ROOT

from pmcl_ros.nodes.runtime.shared_memory import VARIABLE, problem

PROFILE = ROOT / 'config' / 'fastdds_shm.xml'
SMALL = ['--side', '48', '--labels', '20', '--copies', '1']
BARE = {name: value for name, value in os.environ.items() if name != VARIABLE}


def python(*arguments, profile=None):
    """(what a Python program prints, and its errors)."""
    environment = BARE | ({VARIABLE: str(profile)} if profile else {})
    done = subprocess.run([sys.executable, *map(str, arguments)], cwd=ROOT, env=environment,
                          capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout, done.stderr


@pytest.mark.parametrize('profile', [None, PROFILE], ids=['default', 'shared memory'])
@pytest.mark.parametrize(('messages', 'arguments'), [(200, SMALL), (3, ['--copies', '3'])],
                         ids=['many', 'of full size'])
def test_no_volume_is_lost_or_changed(messages, arguments, profile):
    out, errors = python('-m', 'pmcl_ros.nodes.bench.volume_transport', '--messages',
                         messages, *arguments, profile=profile)
    result = json.loads(out)
    assert (result['sent'], result['received'], result['equal']) == (messages,) * 3
    assert set(result['ms']) == {'topic', 'copies'}
    assert 'XMLPARSER' not in errors  # which tells of a bad profile


def test_the_profile_is_used():
    """Its segment is mapped by a process that has a node."""
    script = """
import rclpy
from rclpy.node import Node
rclpy.init()
node = Node('mapped')
for line in open('/proc/self/maps'):
    if '/dev/shm/fastrtps_' in line and 'port' not in line:
        first, last = (int(each, 16) for each in line.split()[0].split('-'))
        print(last - first)
"""
    out, errors = python('-c', script, profile=PROFILE)
    assert 'XMLPARSER' not in out + errors
    if 'RTPS_TRANSPORT_SHM' in out + errors:
        pytest.skip(f'/dev/shm has too little room: {problem(str(PROFILE)) or out + errors}')
    assert max(map(int, out.split())) >= 128 << 20


def test_a_profile_that_cannot_be_used_is_told(tmp_path):
    greedy, broken = tmp_path / 'greedy.xml', tmp_path / 'broken.xml'
    greedy.write_text(PROFILE.read_text().replace('134217728', str(1 << 60)))
    broken.write_text('<profiles>')
    assert 'is no file' in problem('/nowhere.xml')
    assert 'is no profile of Fast DDS' in problem(str(broken))
    said = problem(str(greedy), memory=str(tmp_path))
    assert 'needs 1152921504607 MB' in said
    assert 'messages go by UDP instead' in said
    assert '--shm-size' in said
    assert problem(str(ROOT / 'package.xml'), memory=str(tmp_path)) == ''  # it needs none


def test_a_node_tells_of_it():
    script = 'from pmcl_ros.nodes.runtime.running import ros\nwith ros(): pass'
    assert 'names /nowhere.xml, which is no file' in python(
        '-c', script, profile='/nowhere.xml')[1]
    assert 'Fast DDS' not in python('-c', script)[1]
