"""The graph as it is left alone: captures without end, nodes killed, no memory, strange clocks."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from harness import PATIENCE, ROOT, Process
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

from pmcl_ros.messages.header import header_from, time_to_message
from pmcl_ros.nodes.runtime.shared_memory import TRANSPORTS
from pmcl_ros.nodes.transport.losses import MissingCaptures, SequenceGaps

BRINGUP = 'pmcl_ros.nodes.bringup'
KILLED = ['pmcl_node', 'dlv_node', 'subaperture_node', 'lytro_driver']
MANY = QoSProfile(depth=1000)


@pytest.fixture(scope='module')
def parameter_file(tmp_path_factory, parameters):
    """Of a graph that takes two small pictures a second, for as long as it runs."""
    changes = {
        'lytro_driver': {'loop': True, 'period': 0.5}, 'subaperture_node': {},
        'dlv_node': {'views': 3},
        'pmcl_node': {'mode': 'faithful', 'faithful_iterations': 1, 'faithful_particles': 4}}
    file = tmp_path_factory.mktemp('graph') / 'parameters.yaml'
    file.write_text(yaml.safe_dump({
        f'/**/{name}': {'ros__parameters': parameters[name] | each}
        for name, each in changes.items()}))
    return file


def stamps(poses):
    return [header_from(each.header).stamp_ns for each in poses]


def told(states, node, key):
    """What a node said of itself last."""
    return next((each.value for message in reversed(states) if message.status[0].name == node
                 for each in message.status[0].values if each.key == key), None)


def process_of(chain, name):
    children = Path(f'/proc/{chain.popen.pid}/task/{chain.popen.pid}/children').read_text()
    pid, = (int(each) for each in children.split()
            if f'\0{name}\0' in Path(f'/proc/{each}/cmdline').read_text())
    return pid


def test_a_node_that_is_killed_comes_back_and_poses_with_it(tmp_path, user, parameter_file):
    poses, states = [], []
    user.node.create_subscription(PoseStamped, 'pose', poses.append, MANY)
    user.node.create_subscription(DiagnosticArray, '/diagnostics', states.append, MANY)
    with Process(tmp_path, BRINGUP, '--params-file', parameter_file, '--processes',
                 '--respawn') as chain:
        user.wait(lambda: poses or not chain.alive(), 'a pose')
        for name in KILLED:
            os.kill(process_of(chain, name), signal.SIGKILL)
            user.wait(lambda name=name: f'{name} is active again' in chain.log
                      or not chain.alive(), f'{name} to be active again')
            again = time.time_ns()
            user.wait(lambda again=again: (poses and stamps(poses)[-1] > again)
                      or not chain.alive(), f'a new pose after {name} was killed')
            assert f'{name} was ended by signal 9: captures that were on their way' in chain.log
        assert chain.log.count('captures that were on their way') == len(KILLED)  # once each
        user.wait(lambda: all(told(states, 'pmcl_supervisor', f'{name} started again') == '1'
                              for name in KILLED), 'diagnostics')
    assert stamps(poses) == sorted(set(stamps(poses)))  # each once, none late
    # The next node notices what a dead one swallowed.
    assert 'no evidence came of capture' in chain.log


def test_respawn_needs_processes(tmp_path):
    chain = Process(tmp_path, BRINGUP, '--respawn')
    assert chain.popen.wait(PATIENCE) == 2
    assert '--respawn needs --processes' in chain.log


def may_mount():
    """Whether a process may have a /dev/shm of its own."""
    return not subprocess.run(['unshare', '-m', 'true'], capture_output=True,
                              check=False).returncode


def with_shared_memory(size, *arguments):
    """What to run for a module of Python in a /dev/shm of `size`; skips where that cannot be."""
    if not may_mount():
        pytest.skip('no mount namespace of its own: not root')
    script = f'mount -t tmpfs -o size={size} none /dev/shm && exec "$0" -m "$@"'
    return ['unshare', '-m', 'sh', '-c', script, sys.executable, *arguments]


def soaked(tmp_path, size, captures, *arguments):
    """The report of a soak, whose exit status is 0."""
    # In shared memory of its own: some of what others open there is shared across domains.
    program = ['pmcl_ros.evaluation.bench.soak', '--captures', str(captures), '--quick', '--out',
               tmp_path, *arguments]
    alone = may_mount() or size == '1m'
    done = subprocess.run(
        with_shared_memory(size, *program) if alone else [sys.executable, '-m', *program],
        cwd=ROOT, capture_output=True, text=True, check=False,
        timeout=4 * PATIENCE)  # of its own waits each has a limit
    log = tmp_path / 'graph.log'
    assert done.returncode == 0, (done.stdout + done.stderr
                                  + (log.read_text() if log.exists() else ''))
    return json.loads((tmp_path / 'soak.json').read_text()), done.stdout


@pytest.mark.parametrize(('size', 'arguments'), [
    ('1g', []), ('1m', ['--flood', '--processes'])],
    ids=['in turn', 'flood, little shared memory'])
def test_soak(tmp_path, size, arguments):
    found, printed = soaked(tmp_path, size, 4, *arguments)
    dropped = sum(found['dropped'].values())
    assert found['captures'] == 4 == found['poses'] + found['lost'] + dropped
    assert (found['twice'], found['strange'], found['unreported'], found['left']) == (0, 0, 0, [])
    assert dropped == 0 or arguments
    assert '| captures, poses, lost | 4, ' in printed


def test_soak_with_disturbances(tmp_path):
    """Disks are full, the driver is killed, time jumps, with captures under way: all is told."""
    full = ['--full-disks'] if may_mount() else []
    count = 4 if full else 2
    found, printed = soaked(tmp_path, '1g', 6, '--processes', '--disturbances', str(count),
                            *full)
    assert found['disturbances'] == {'a node is killed': 1, 'time jumps': 1} | (
        {'shared memory is full': 1, 'the disk is full': 1} if full else {})
    assert (found['killed'], found['twice'], found['tracebacks']) == (1, 0, 0)
    assert found['captures'] + found['unanswered'] == 6
    assert found['poses'] + found['lost'] >= 6 - 2  # two were under way
    assert '| disturbance: a node is killed | 1 times |' in printed


def test_a_disk_that_is_filled_has_no_room_until_the_file_is_gone():
    program = """
import os
from pathlib import Path
from pmcl_ros.nodes.bench.disturbances import fill
from pmcl_ros.nodes.runtime.shared_memory import standstill
disk = Path('/dev/shm')
assert standstill() == ''
full = fill(disk)
assert standstill().startswith('/dev/shm has 0.00 MB free: messages between processes may stand')
assert os.statvfs(disk).f_bfree == 0
try:
    (disk / 'more').write_bytes(b'0')
except OSError as error:
    print(error.strerror)
full.unlink()
(disk / 'more').write_bytes(b'0')
"""
    if not may_mount():
        pytest.skip('no mount namespace of its own: not root')
    done = subprocess.run(
        ['unshare', '-m', 'sh', '-c', 'mount -t tmpfs -o size=2m none /dev/shm && exec "$@"', 'sh',
         sys.executable, '-c', program], capture_output=True, text=True, check=True)
    assert done.stdout == 'No space left on device\n'


@pytest.mark.parametrize(('size', 'transports'), [('16k', 'DEFAULT'), ('1m', 'DEFAULT'),
                                                  ('16k', 'UDPv4')])
def test_messages_come_without_room_in_shared_memory(size, transports):
    """16k: no process gets any; 1m: the first one does. UDPv4: none wants any."""
    done = subprocess.run(
        with_shared_memory(size, 'pmcl_ros.nodes.bench.volume_transport', '--messages', '5',
                           '--side', '164', '--copies', '1'),
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False,
        env={**os.environ, TRANSPORTS: transports})
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result['sent'], result['received'], result['equal']) == (5, 5, 5)
    told = re.search(r'/dev/shm has .* by UDP', done.stderr)
    assert (told is None) == (transports == 'UDPv4')


def test_gaps_in_the_numbers_of_one_publisher():
    gaps = SequenceGaps()
    assert [gaps.missed(number, 1) for number in (7, 8, 11, 12)] == [0, 0, 2, 0]
    assert [gaps.missed(number, 1) for number in (1, 4)] == [0, 2]  # it was started again
    assert [gaps.missed(number, 2) for number in (9, 30, 10)] == [0, 0, 0]  # whose?
    assert [gaps.missed(number, 1) for number in (40, 42, None)] == [0, 1, 0]


def test_captures_that_were_announced_only():
    missing = MissingCaptures()
    for stamp in (1, 2, 3):
        missing.announce(stamp)
    assert missing.arrived(3) == [1, 2]
    assert missing.arrived(4) == []  # came before it was announced
    missing.announce(4)
    missing.announce(6)
    assert missing.arrived(5) == []
    assert missing.arrived(6) == []


@pytest.fixture(scope='module')
def two_graphs(tmp_path_factory, parameter_file):
    """Both on simulated time, before anybody publishes any."""
    graphs = [Process(tmp_path_factory.mktemp(name), BRINGUP, '--params-file', parameter_file,
                      '--ros-args', '-r', f'__ns:=/{name}', '-p', 'use_sim_time:=true',
                      '-p', f'frame_id:={name}') for name in ('left', 'right')]
    with graphs[0], graphs[1]:
        yield graphs


def test_two_graphs_keep_to_themselves(two_graphs, user):
    poses = {name: user.listen(PoseStamped, f'/{name}/pose', MANY) for name in ('left', 'right')}
    user.wait(lambda: all(len(each) >= 3 for each in poses.values())
              or not all(graph.alive() for graph in two_graphs), 'poses of both')
    assert all(graph.alive() for graph in two_graphs), [graph.log for graph in two_graphs]
    for name, each in poses.items():
        assert {pose.header.frame_id for pose in each} == {name}
        assert stamps(each) == sorted(set(stamps(each)))
    assert not set(stamps(poses['left'])) & set(stamps(poses['right']))


def test_time_may_stand_still_or_jump(two_graphs, user):
    """Timers, patience and stamps do not follow /clock; only the headers of diagnostics do."""
    poses = user.listen(PoseStamped, '/left/pose', MANY)
    states = user.listen(DiagnosticArray, '/diagnostics', MANY)
    clock = user.publisher(Clock, '/clock', QoSProfile(depth=10))
    began, count = time.monotonic(), 0  # of all rounds: what was under way is counted once
    for now in (1_000, 5, 1_000_000, 0):  # seconds: there, back, far ahead, back
        message = Clock(clock=time_to_message(now * 10**9))
        since = time.time_ns()
        states.clear()

        def follows(message=message):
            clock.publish(message)
            return [each for each in states if each.status[0].name == 'left/dlv_node'
                    and each.header.stamp == message.clock]

        user.wait(lambda: len(follows()) >= 2, f'diagnostics at {now} s')
        user.wait(lambda since=since: stamps(poses)[-2:-1] > [since], f'poses at {now} s')
        count += sum(each.status[0].name == 'left/dlv_node' for each in states)
        assert count <= time.monotonic() - began + 3  # at 1 Hz, and no storm after a jump
    assert all(abs(stamp - time.time_ns()) < 3600e9 for stamp in stamps(poses))
