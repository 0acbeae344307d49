"""One thread does everything with the thing that it owns; the newest job wins."""

import threading
from functools import partial

import pytest
from harness import PATIENCE

from pmcl_ros.nodes.runtime.worker import Worker


class Tool:
    """Notes the threads that touch it."""

    def __init__(self):
        self.threads = [threading.get_ident()]
        self.jobs = []

    def use(self, job):
        self.threads.append(threading.get_ident())
        self.jobs.append(job)

    def close(self):
        self.threads.append(threading.get_ident())


@pytest.fixture
def worker():
    worker = Worker(Tool)
    worker.resume()
    yield worker
    worker.close()


def held(started, release, tool):
    started.set()
    assert release.wait(PATIENCE)
    tool.use('held')


def test_all_happens_on_one_other_thread():
    worker = Worker(Tool)
    done = threading.Event()
    worker.offer(lambda tool: (tool.use(1), done.set()))
    assert done.wait(PATIENCE)
    worker.close()
    assert len(worker.owned.threads) == 3
    assert len(set(worker.owned.threads)) == 1
    assert worker.owned.threads[0] != threading.get_ident()


def test_what_making_raises_comes_out():
    def make():
        raise OSError('no GL')
    with pytest.raises(OSError, match='no GL'):
        Worker(make)


def test_the_newest_of_the_waiting_jobs_runs(worker):
    started, release, done = (threading.Event() for _ in range(3))
    assert worker.offer(partial(held, started, release)) is None
    assert started.wait(PATIENCE)
    old = partial(Tool.use, job='old')
    assert worker.offer(old) is None
    assert worker.offer(lambda tool: (tool.use('new'), done.set())) is old
    release.set()
    assert done.wait(PATIENCE)
    assert worker.owned.jobs == ['held', 'new']


def test_stopping_ends_the_running_job_and_forgets_the_waiting_one(worker):
    started = threading.Event()

    def search(tool):
        started.set()
        while not worker.stopping:
            pass
        tool.use('stopped')

    worker.offer(search)
    assert started.wait(PATIENCE)
    waiting = partial(Tool.use, job='never')
    worker.offer(waiting)
    assert worker.stop() is waiting  # who offered it can say that it is lost
    assert worker.owned.jobs == ['stopped']
    assert worker.stop() is None
    worker.resume()
    done = threading.Event()
    worker.offer(lambda tool: (tool.use('after'), done.set()))
    assert done.wait(PATIENCE)
    assert worker.owned.jobs == ['stopped', 'after']
