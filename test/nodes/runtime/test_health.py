"""What a node tells of itself is what happened."""

import itertools
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from pmcl_ros.nodes.runtime.health import Health


@pytest.fixture
def health():
    health = Health(back_end='numba', clock=lambda: health_time[0])
    yield health
    health_time[0] = 0.0


health_time = [0.0]


def told(health):
    status, = health.to_message(5, 'dlv_node').status
    return status, {each.key: each.value for each in status.values}


def test_the_rate_is_that_of_the_last_seconds(health):
    for second in range(1, 31):
        health_time[0] = float(second)
        health.done(0.25)
    assert told(health)[1]['rate [Hz]'] == '1.00'
    health_time[0] = 35.0
    assert told(health)[1]['rate [Hz]'] == '0.50'
    health_time[0] = 60.0
    assert told(health)[1]['rate [Hz]'] == '0.00'


def test_soon_after_the_start_the_rate_is_that_since_then(health):
    for _ in range(3):
        health_time[0] += 0.5
        health.done(0.1)
    assert health.rate == pytest.approx(2.0)


def test_all_is_told(health):
    health.frames_in = 4
    health.done(0.25)
    health.dropped += 1
    health.count('dlv sent')
    health.count('dlv sent')
    health.extra = {'object': 'cup'}
    health.failed('views: dark')
    status, values = told(health)
    assert (status.name, status.level) == ('dlv_node', DiagnosticStatus.ERROR)
    assert values == {
        'frames in': '4', 'frames out': '1', 'dropped': '1', 'errors': '1',
        'last error': 'views: dark', 'last latency [ms]': '250.0', 'back end': 'numba',
        'rate [Hz]': '1.00', 'dlv sent': '2', 'object': 'cup'}
    health.done(0.1)
    status, values = told(health)
    assert status.level == DiagnosticStatus.OK
    assert values['last error'] == 'views: dark'


def test_what_is_awaited_is_told_until_it_or_a_result_comes(health):
    """It hides nothing that is worse, and leaves the state as it was."""
    health.done(0.25, 'found')
    health.awaits('awaits /views', DiagnosticStatus.WARN)
    assert health.state == (DiagnosticStatus.WARN, 'awaits /views')
    assert (told(health)[0].level, told(health)[0].message) == health.state
    health.failed('views: dark')
    assert health.state == (DiagnosticStatus.ERROR, 'views: dark')
    health.came()
    assert health.state == (DiagnosticStatus.ERROR, 'views: dark')
    health.done(0.25, 'found')
    health.awaits('awaits /views', DiagnosticStatus.OK)
    assert health.state == (DiagnosticStatus.OK, 'awaits /views')
    health.came()
    assert health.state == (DiagnosticStatus.OK, 'found')
    for result, level in ((lambda: health.done(0.1, 'next'), DiagnosticStatus.OK),
                          (lambda: health.warn('next'), DiagnosticStatus.WARN)):
        health.awaits('awaits /views', DiagnosticStatus.WARN)
        result()
        assert health.state == (level, 'next')


def test_no_report_has_a_part_of_a_result(health):
    """One thread sets results, another tells: as a search and the timer of /diagnostics do."""
    ended = threading.Event()

    def search():
        for number in itertools.count():
            with health.lock:
                health.done(0.1, str(number))
                time.sleep(1e-4)  # a switch of threads, where it would do harm
                health.extra = {'capture': number}
            time.sleep(1e-4)
            if ended.is_set():
                return

    health.message, health.extra = '0', {'capture': 0}
    with ThreadPoolExecutor(1) as pool:
        searching, seen = pool.submit(search), {}
        while len(seen) < 20:
            status, values = told(health)
            seen[status.message] = values['capture']
            time.sleep(1e-4)
        ended.set()
        searching.result()
    assert all(message == capture for message, capture in seen.items())


def test_threads_count_together(health):
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(4) as pool:
            for each in [pool.submit(lambda: [health.count('sent') for _ in range(20_000)])
                         for _ in range(4)]:
                each.result()
    finally:
        sys.setswitchinterval(usual)
    assert told(health)[1]['sent'] == '80000'
