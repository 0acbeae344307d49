"""A capture is made for those who listen, once, and waits for them while they may be found."""

import time

import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor

from pmcl_ros.nodes.runtime.base import StageNode
from pmcl_ros.nodes.transport.deferred_publisher import DeferredPublisher, Output
from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.settings import Settings

LONG = 3600.0  # s: longer than any test


class Speaker(StageNode):
    """Publishes to two lists of words, when somebody `listens`."""

    name, settings_class = 'speaker', Settings
    patience = LONG

    def set_up(self, _):
        self.listens, self.made = set(), []
        self.said = {'loud': [], 'soft': []}

    def start(self):
        outputs = [Output(lambda name=name: name in self.listens, words.append)
                   for name, words in self.said.items()]
        self.deferred = DeferredPublisher(self, outputs, 'nobody listens', self.patience)

    def say(self, word):
        def make():
            self.made.append(word)
            if word == 'bad':
                raise PmclError('no such word')
            return word
        self.deferred.publish(make, f'word {word}')


@pytest.fixture
def speaker():
    """An active speaker; spun by `spin`."""
    context = Context()
    rclpy.init(context=context)
    node = Speaker(context=context)
    node.trigger_configure()
    node.trigger_activate()
    yield node
    node.close()
    rclpy.shutdown(context=context)


@pytest.fixture
def listen(speaker, user):
    """A function that lets somebody listen to a topic, and waits for what comes."""
    executor = SingleThreadedExecutor(context=speaker.context)
    executor.add_node(speaker)
    user.others.append(executor)

    def listen(name):
        speaker.listens.add(name)
        user.wait(lambda: speaker.said[name], 'a word')
    yield listen
    user.others.clear()
    executor.shutdown()


def test_what_is_wanted_is_made_once_and_at_once(speaker):
    speaker.listens = {'loud', 'soft'}
    speaker.say('one')
    assert speaker.said == {'loud': ['one'], 'soft': ['one']}
    assert speaker.made == ['one']
    assert speaker.health.frames_out == 1


def test_what_nobody_wants_yet_waits_unmade(speaker, listen):
    began = time.monotonic()
    speaker.say('one')
    assert speaker.made == []
    listen('soft')
    assert speaker.said == {'loud': [], 'soft': ['one']}
    assert 0 < speaker.health.latency_ms < 1e3 * (time.monotonic() - began)
    assert (speaker.health.frames_out, speaker.health.dropped) == (1, 0)


def test_who_is_found_later_gets_the_same(speaker, listen):
    speaker.listens = {'soft'}
    speaker.say('one')
    assert speaker.said == {'loud': [], 'soft': ['one']}
    listen('loud')
    assert speaker.said == {'loud': ['one'], 'soft': ['one']}
    assert speaker.made == ['one']
    assert speaker.health.frames_out == 1


def test_the_newest_waits_and_the_other_is_dropped(speaker, listen, capfd):
    speaker.say('one')
    speaker.say('two')
    assert speaker.health.dropped == 1
    assert 'dropped word one: a newer one came' in capfd.readouterr().err
    listen('loud')
    assert speaker.said['loud'] == ['two']
    assert speaker.made == ['two']


def test_later_nothing_waits(speaker):
    speaker.trigger_deactivate()
    speaker.patience = -1.0
    speaker.trigger_activate()
    speaker.say('one')
    assert (speaker.made, speaker.health.dropped) == ([], 1)
    speaker.listens = {'loud'}
    speaker.say('two')
    assert speaker.said == {'loud': ['two'], 'soft': []}
    assert speaker.health.dropped == 1


def test_what_waits_when_the_time_is_over_is_dropped(speaker, user, listen, capfd):
    speaker.trigger_deactivate()
    speaker.patience = 0.5
    speaker.trigger_activate()
    speaker.say('one')
    user.wait(lambda: speaker.health.dropped, 'the end')
    assert 'dropped word one: nobody listens' in capfd.readouterr().err
    assert speaker.made == []


def test_nothing_outlives_the_activity(speaker, listen):
    speaker.say('one')
    speaker.trigger_deactivate()
    speaker.trigger_activate()
    speaker.listens = {'loud'}
    speaker.say('two')
    listen('soft')
    assert speaker.said == {'loud': ['two'], 'soft': ['two']}


def test_what_cannot_be_made_is_told_once(speaker, listen):
    speaker.listens = {'loud'}
    with pytest.raises(PmclError, match='no such word'):
        speaker.say('bad')
    speaker.say('good')
    listen('soft')
    assert speaker.said == {'loud': ['good'], 'soft': ['good']}
    assert speaker.made == ['bad', 'good']


def test_what_cannot_be_made_when_somebody_is_found_is_an_error_of_the_node(speaker, user, listen):
    speaker.say('bad')
    speaker.listens = {'loud', 'soft'}
    user.wait(lambda: speaker.health.errors, 'the error')
    later = time.monotonic() + 0.3  # it looks for others each 0.1 s
    user.wait(lambda: time.monotonic() > later, 'more looks')
    speaker.say('good')
    assert speaker.said == {'loud': ['good'], 'soft': ['good']}
    assert speaker.made == ['bad', 'good']
    assert speaker.health.errors == 1
