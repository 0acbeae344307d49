"""A signal ends a program in order, wherever it is and whichever of its threads is hit."""

import signal
import subprocess
import sys

import pytest
from harness import PATIENCE, ROOT, Process

# The thread is as those that libraries start when they are imported: it blocks no signal.
PROGRAM = """
import sys, threading
threading.Thread(target=threading.Event().wait, daemon=True).start()
from pmcl_ros.nodes.runtime.running import pause, ros

def say(what):
    print(what, flush=True)
    return sys.stdin.readline() if what != 'closed' else None

with ros():
    try:
        say('at work')
        pause(0 if 'soon' in sys.argv else 600)
    finally:
        say('closed')
say('ended')
"""


def test_a_file_that_ros_refuses_is_told_in_a_line(tmp_path):
    file = tmp_path / 'parameters.yaml'
    file.write_text('dlv_node: {ros__parameters: {crop: [0, 0.5, a, 1]}}')
    node = Process(tmp_path, 'pmcl_ros.nodes.dlv_node', '--ros-args', '--params-file', file)
    assert node.popen.wait(PATIENCE) == 1
    assert 'dlv_node: ROS does not start with these arguments: ' in node.log
    assert 'Sequence should be of same type' in node.log
    assert 'Traceback' not in node.log


@pytest.mark.parametrize(('text', 'reason'), [
    ('dlv_nod: {ros__parameters: {labels: 5}}', "did you mean 'dlv_node'"),
    ('dlv_node: {ros__parameters: {seed: 5}}', "unknown parameter 'seed'; pmcl_node has it")])
def test_what_ros_would_pass_over_is_told_in_a_line(tmp_path, text, reason):
    file = tmp_path / 'parameters.yaml'
    file.write_text(text)
    node = Process(tmp_path, 'pmcl_ros.nodes.dlv_node', '--ros-args', '--params-file', file)
    assert node.popen.wait(PATIENCE) == 1
    assert reason in node.log
    assert 'Traceback' not in node.log


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP],
                         ids=['INT', 'TERM', 'HUP'])
@pytest.mark.parametrize('soon', [[], ['soon']], ids=['later', 'at once'])
def test_a_signal_is_noted_while_the_program_does_something_else(number, soon):
    with subprocess.Popen([sys.executable, '-c', PROGRAM, *soon], cwd=ROOT, stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True, bufsize=1) as program:
        try:
            assert program.stdout.readline() == 'at work\n'
            program.send_signal(number)
            program.stdin.write('go on\n')
            assert program.stdout.readline() == 'closed\n'
            assert program.stdout.readline() == 'ended\n'
            program.send_signal(number)  # impatience
            program.stdin.write('go on\n')
            program.stdin.close()
            assert program.wait() == 0
        finally:
            program.kill()
