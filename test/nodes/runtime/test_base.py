"""What the base class promises to a node: logged failures, and everything released in order."""

import re
import subprocess
import sys
import threading
import time
from itertools import count

import cv2
import numpy as np
import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import ACTIVATE, CONFIGURE
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from pydantic import Field
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from std_msgs.msg import String

from pmcl_ros.nodes.runtime.base import LATCHED, StageNode
from pmcl_ros.runtime import kernels
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.settings import Settings


class ProbeSettings(Settings):
    """A probe's."""

    size: float = Field(1.0, gt=0, le=2, description='size [m]')


class Probe(StageNode):
    """Does what a test asks for, and notes what happens to it."""

    name = 'probe'
    settings_class = ProbeSettings

    def __init__(self, **options):
        super().__init__(**options)
        self.notes = []
        self.wrong = {}

    def set_up(self, settings):
        self.out = self.publisher(String, 'out', LATCHED)
        for each in ('file', 'context'):
            self.notes.append(f'open {each}')
            self.configured.callback(self.release, each)
        self.raise_in('set_up')
        self.settings = settings

    def start(self):
        self.active.callback(self.release, 'stream')
        self.subscribe(String, 'in', self.received, LATCHED)
        self.serve('~/call', self.called)
        self.raise_in('start')

    def release(self, what):
        self.notes.append(f'close {what}')
        self.raise_in(what)

    def received(self, message):
        self.notes.append(message.data)
        self.raise_in(message.data)

    def called(self):
        self.raise_in('call')
        return 'done'

    def raise_in(self, where):
        if where in self.wrong:
            raise self.wrong[where]


@pytest.fixture
def context():
    context = Context()
    rclpy.init(context=context)
    yield context
    rclpy.shutdown(context=context)


@pytest.fixture
def probe(context):
    probe = Probe(context=context)
    yield probe
    probe.wrong = {}
    probe.close()


def test_life_without_mistakes(probe):
    assert probe.trigger_configure() == Result.SUCCESS
    assert probe.settings.size == 1.0
    assert not probe.out.is_activated
    assert probe.trigger_activate() == Result.SUCCESS
    assert probe.out.is_activated
    assert probe.trigger_deactivate() == Result.SUCCESS
    assert not probe.out.is_activated
    assert probe.trigger_cleanup() == Result.SUCCESS
    assert '/out' not in [each.topic_name for each in probe.publishers]
    assert probe.notes == ['open file', 'open context', 'close stream', 'close context',
                           'close file']


def test_a_node_that_compiles_says_so_in_its_log_and_in_diagnostics(
        probe, user, capfd, tmp_path, monkeypatch):
    kernels.progress()  # those that are imported keep their places
    monkeypatch.setattr(kernels, 'cache_folder', lambda: tmp_path)  # nothing is there
    messages = []
    user.node.create_subscription(DiagnosticArray, '/diagnostics', messages.append, 10)

    def compiling():
        return [each.status[0] for each in messages if 'compiling' in each.status[0].message]

    def set_up(_):
        for number in count():  # a subscriber that is found late gets no earlier message
            names = {'__name__': 'made_up'}
            exec(f'def scaled(x): return {number} * x', names)
            assert kernels.compiled()(names['scaled'])(2) == 2 * number
            user.spin()
            if compiling():
                return

    probe.set_up = set_up
    assert probe.trigger_configure() == Result.SUCCESS
    status = compiling()[0]
    assert (status.name, status.level) == ('probe', DiagnosticStatus.OK)
    found = re.fullmatch(r'configuring; compiling kernels: (\d+) of (\d+), made_up.scaled',
                         status.message)
    assert int(found[1]) < int(found[2])
    assert status.message.removeprefix('configuring; ') in capfd.readouterr().err


def test_each_activation_counts_anew_with_the_back_end_of_its_configuration(probe, capfd):
    began = []
    probe.set_up = lambda _: (began.append(probe.health.message),
                              setattr(probe.health, 'back_end', 'numba'))
    probe.trigger_configure()
    assert began == ['configuring']
    for _ in range(2):
        probe.trigger_activate()
        assert (probe.health.message, probe.health.frames_out) == ('active', 0)
        assert probe.health.back_end == 'numba'
        probe.done(0.25, 'found it')
        assert 'found it, in 250 ms' in capfd.readouterr().err
        probe.trigger_deactivate()


def test_parameters_are_read_again_at_each_configure(probe):
    probe.trigger_configure()
    probe.trigger_cleanup()
    probe.set_parameters([Parameter('size', value=1.5)])
    probe.trigger_configure()
    assert probe.settings.size == 1.5


def of_opencv():
    """What OpenCV raises where it gets no memory."""
    with pytest.raises(cv2.error) as problem:
        cv2.copyMakeBorder(np.zeros((1, 1), np.uint8), 0, 2 ** 30, 0, 2 ** 16, cv2.BORDER_CONSTANT)
    return problem.value


@pytest.mark.parametrize(('problem', 'told'), [
    (PmclError('no such mesh; give its path'), 'no such mesh; give its path'),
    (MemoryError('Unable to allocate 9 GiB'),
     'there is not enough memory: Unable to allocate 9 GiB; make pixels larger'),
    (None, 'there is not enough memory: OpenCV')])
def test_what_a_user_can_mend_is_one_line(probe, capfd, problem, told):
    probe.wrong['set_up'] = problem or of_opencv()
    assert probe.trigger_configure() == Result.FAILURE
    assert probe.notes[-2:] == ['close context', 'close file']
    error = capfd.readouterr().err
    assert f'cannot configure: {told}' in error
    assert 'Traceback' not in error
    probe.wrong.clear()
    assert probe.trigger_configure() == Result.SUCCESS


def test_a_fault_is_logged_with_its_traceback_and_all_is_released(probe, capfd):
    probe.wrong['set_up'] = ZeroDivisionError('oh')
    assert probe.trigger_configure() == Result.ERROR
    assert probe.notes[-2:] == ['close context', 'close file']
    error = capfd.readouterr().err
    assert 'Traceback' in error
    assert 'ZeroDivisionError: oh' in error
    assert 'raise_in' in error
    probe.wrong.clear()
    assert probe.trigger_configure() == Result.SUCCESS


@pytest.mark.parametrize(('problem', 'result'),
                         [(PmclError('busy'), Result.FAILURE), (KeyError('x'), Result.ERROR)])
def test_a_failed_activation_leaves_nothing_running(probe, problem, result):
    probe.trigger_configure()
    probe.wrong['start'] = problem
    assert probe.trigger_activate() == result
    assert 'close stream' in probe.notes
    assert ('close file' in probe.notes) == (result == Result.ERROR)
    assert probe.count_subscribers('in') == 0
    probe.wrong.clear()
    if result == Result.ERROR:
        assert probe.trigger_configure() == Result.SUCCESS
    assert probe.trigger_activate() == Result.SUCCESS


def test_a_fault_in_release_does_not_stop_the_rest(probe, capfd):
    probe.trigger_configure()
    probe.wrong['context'] = RuntimeError('stuck')
    assert probe.trigger_cleanup() == Result.ERROR
    assert probe.notes[-2:] == ['close context', 'close file']
    assert 'RuntimeError: stuck' in capfd.readouterr().err
    probe.wrong.clear()
    assert probe.trigger_configure() == Result.SUCCESS


def test_a_fault_in_release_after_a_mistake_of_the_user_is_a_fault(probe):
    probe.wrong = {'set_up': PmclError('no such mesh'), 'context': RuntimeError('stuck')}
    assert probe.trigger_configure() == Result.ERROR
    assert probe.notes[-2:] == ['close context', 'close file']


def test_a_transition_is_asked_for_by_its_label_else_by_its_number(probe, user, context):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(probe)
    user.others.append(executor)

    def changed(**wanted):
        request = ChangeState.Request(transition=Transition(**wanted))
        return user.call(ChangeState, '/probe/change_state', request).success

    assert not changed(id=CONFIGURE, label='no such label')
    assert not changed(id=99)
    assert changed(label='configure')
    assert changed(id=ACTIVATE)
    executor.shutdown()


@pytest.mark.parametrize('transitions', [[], ['configure'], ['configure', 'activate']])
def test_shutdown_releases_from_every_state(probe, transitions):
    for each in transitions:
        getattr(probe, f'trigger_{each}')()
    assert probe.trigger_shutdown() == Result.SUCCESS
    assert ('close file' in probe.notes) == bool(transitions)
    assert ('close stream' in probe.notes) == (len(transitions) == 2)


def test_health_is_told_from_any_thread_in_any_state(probe):
    probe.trigger_configure()
    stop, problems = threading.Event(), []

    def tell():
        try:
            while not stop.is_set():
                probe.publish_diagnostics()
        except Exception as problem:
            problems.append(problem)

    threads = [threading.Thread(target=tell) for _ in range(2)]
    for each in threads:
        each.start()
    for _ in range(20):
        assert probe.trigger_activate() == Result.SUCCESS
        assert probe.trigger_deactivate() == Result.SUCCESS
    stop.set()
    for each in threads:
        each.join()
    assert problems == []


def test_messages_and_calls_that_fail_are_counted_and_survived(probe, user, context, capfd):
    from std_srvs.srv import Trigger
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(probe)
    probe.trigger_configure()
    probe.trigger_activate()
    user.others.append(executor)
    publisher = user.node.create_publisher(String, 'in', LATCHED)
    seen = probe.notes

    def send(text):
        publisher.publish(String(data=text))
        user.wait(lambda: text in seen, text)

    def call():
        return user.call(Trigger, '/probe/call', Trigger.Request())

    probe.wrong = {'bad': PmclError('half a message'), 'large': MemoryError(),
                   'worse': IndexError('far')}
    for text in ('bad', 'large', 'worse', 'good'):
        send(text)
    error = capfd.readouterr().err
    assert 'in: half a message' in error
    assert 'in: there is not enough memory; make pixels larger' in error
    assert error.count('Traceback') == 1
    assert 'IndexError: far' in error
    assert probe.health.errors == 3
    assert probe.health.last_error == 'in: IndexError: far'
    assert (call().success, call().message) == (True, 'done')
    probe.wrong = {'call': PmclError('not now')}
    answer = call()
    assert (answer.success, answer.message) == (False, 'not now')
    assert probe.health.errors == 3  # a refusal is the caller's matter
    probe.wrong = {'call': IndexError('farther')}
    answer = call()
    assert (answer.success, answer.message) == (False, 'IndexError: farther')
    assert probe.health.last_error == '~/call: IndexError: farther'
    executor.shutdown()


def test_an_error_is_told_before_the_timer_is_due(probe, user):
    """Nobody spins the node: its timer never is."""
    statuses = []
    user.node.create_subscription(DiagnosticArray, '/diagnostics', statuses.append, 100)
    assert probe.trigger_configure() == probe.trigger_activate() == Result.SUCCESS

    def told():  # a subscriber that is found late gets no earlier message
        with probe.watched('in'):
            raise PmclError('half a message')
        return statuses and statuses[-1].status[0].level == DiagnosticStatus.ERROR

    user.wait(told, 'the error')
    assert statuses[-1].status[0].message == 'in: half a message'


@pytest.mark.parametrize(('kind', 'text'), [
    (PmclError, 'half a message'), (PmclError, 'in: half a message'),
    (ValueError, 'half a message')])
def test_an_error_that_repeats_is_logged_once_in_each_activation(probe, capfd, kind, text):
    probe.trigger_configure()
    for _ in range(2):
        probe.trigger_activate()
        for _ in range(100):
            with probe.watched('in'):
                raise kind(text)
        assert probe.health.errors == 100
        probe.trigger_deactivate()
        log = capfd.readouterr().err
        if kind is PmclError:
            assert log.count('[probe]: in: half a message') == log.count('half a message') == 1
        else:
            assert log.count('in: unexpected error') == 1
            assert log.count('ValueError: half a message') == 1


def test_a_flood_of_bad_messages_is_counted_and_told_at_the_usual_period(probe, user, context):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(probe)
    assert probe.trigger_configure() == probe.trigger_activate() == Result.SUCCESS
    user.others.append(executor)
    statuses = []
    user.node.create_subscription(DiagnosticArray, '/diagnostics', statuses.append, 100)
    publisher = user.node.create_publisher(String, 'in', LATCHED)
    user.wait(publisher.get_subscription_count, 'the node')
    probe.wrong = {'bad': PmclError('half a message')}
    began = time.monotonic()
    for number in range(1, 101):
        publisher.publish(String(data='bad'))
        user.wait(lambda number=number: probe.health.errors >= number, 'its refusal')

    def counted():
        values = {each.key: each.value for each in statuses[-1].status[0].values}
        return values['errors'] == '100'

    user.wait(lambda: statuses and counted(), 'all to be told')
    assert len(statuses) <= 3 + 2 * (time.monotonic() - began)
    executor.shutdown()


class ImpatientProbe(Probe):
    """Does not wait for what a killed node has left; no other test has nodes of its name."""

    name = 'impatient'
    patience = 1.0


def test_another_node_of_its_name_is_told_once_until_it_has_gone(context, user, capfd):
    messages = []
    user.node.create_subscription(DiagnosticArray, '/diagnostics', messages.append, 10)
    node = ImpatientProbe(context=context)
    other = subprocess.Popen(
        [sys.executable, '-c', 'import rclpy, sys; rclpy.init(); '
         'node = rclpy.create_node("impatient"); sys.stdin.read(); node.destroy_node(); '
         'rclpy.shutdown()'], stdin=subprocess.PIPE)
    executor = SingleThreadedExecutor(context=context)
    user.others.append(executor)

    def told():
        return {each.key: each.value for each in messages[-1].status[0].values
                } if messages else {}

    executor.add_node(node)
    assert node.trigger_configure() == node.trigger_activate() == Result.SUCCESS
    user.wait(lambda: told().get('nodes of this name') == '2', 'diagnostics of both')
    user.wait(lambda: len(messages) > 5, 'more of them')
    other.communicate()
    user.wait(lambda: 'nodes of this name' not in told(), 'one is left')
    node.close()
    assert capfd.readouterr().err.count(
        "2 nodes are named /impatient: they get each other's pictures and calls; end") == 1
