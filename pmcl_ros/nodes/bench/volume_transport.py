"""Time of a volume from one process to another: by its topic, and by copies of its data alone.

Prints one JSON object; `pmcl bench transport` runs it.
"""

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from mmap import mmap
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume, depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.cdr import message_from, type_name
from pmcl_ros.messages.types import Buffer
from pmcl_ros.messages.volume import volume_from, volume_to_message
from pmcl_ros.nodes.runtime.base import BIG
from pmcl_ros.nodes.runtime.running import pause, ros
from pmcl_ros.runtime.errors import PmclError

_TOPIC = 'bench/dlv'
_PATIENCE = 60.0  # s: for a process to find the other, or a message to come


class TransportError(PmclError):
    """The two processes did not find each other, or a message did not come."""


def noise(side: int, labels: int) -> DepthLikelihoodVolume:
    """A volume of which no value can be missing or wrong without being seen."""
    likelihood = np.random.default_rng(0).random((side, side, labels), np.float32)
    return DepthLikelihoodVolume(Header(), likelihood, depth_labels(0.3, 0.9, labels),
                                 Pinhole(side, side, side, side, side / 2, side / 2))


def measure(side: int, labels: int, messages: int, copies: int) -> dict[str, object]:
    """Send volumes to another process; the data of the first `copies` are also merely copied.

    ROS copies the data seven times: from the volume into the message, into its C form, into the
    serialised sample, into memory that both processes see; out of that into a sample, out of the
    history, into bytes. The same copies are made here, between the same processes, one after the
    other, where ROS has new memory in new memory. Times are from the volume to a numpy view of
    what came, medians; the two ways take turns.
    """
    volume = noise(side, labels)
    size = volume.likelihood.nbytes
    with ros(), _shared(size) as (shared, descriptor), _receiver(side, labels, descriptor) as ask:
        node = Node('sender')
        publisher = node.create_publisher(Float32MultiArray, _TOPIC, BIG)
        _wait(publisher.get_subscription_count, 'the receiver')
        ask('meet')
        buffer, sample = Buffer(), np.empty(volume.likelihood.size, np.float32)
        both = np.frombuffer(shared, np.float32)
        took: dict[str, list[float]] = {'topic': [], 'copies': []}
        equal = 0
        for number in range(messages):
            volume = _numbered(volume, number)
            if number < copies:
                began = time.monotonic()
                data = np.frombuffer(volume_to_message(volume, buffer).data, np.float32)
                sample[:] = data[-sample.size:].copy()
                both[:] = sample
                answer = ask('copy')
                took['copies'].append(answer['at'] - began)
            began = time.monotonic()
            publisher.publish(volume_to_message(volume, buffer))
            answer = ask(f'take {number}')
            if answer['at'] is not None:
                took['topic'].append(answer['at'] - began)
            equal += answer['equal']
        node.destroy_node()
        del both
    ms = {name: 1e3 * float(np.median(times)) for name, times in took.items()}
    return {'megabytes': volume.likelihood.nbytes / 1e6, 'sent': messages,
            'received': len(took['topic']), 'equal': equal, 'ms': ms,
            'ratio': ms['topic'] / ms['copies']}


def _numbered(volume: DepthLikelihoodVolume, number: int) -> DepthLikelihoodVolume:
    volume.likelihood[0, 0, 0] = number
    return volume


def _wait(condition: Callable[[], object], what: str) -> None:
    deadline = time.monotonic() + _PATIENCE
    while not condition():
        pause(0.01)
        if time.monotonic() > deadline:
            raise TransportError(f'{what} was not found within {_PATIENCE:g} s')


@contextmanager
def _shared(size: int) -> Iterator[tuple[mmap, int]]:
    """Memory for this process and those that get the descriptor."""
    descriptor = os.memfd_create('transport')
    try:
        os.ftruncate(descriptor, size)
        with mmap(descriptor, size) as memory:
            yield memory, descriptor
    finally:
        os.close(descriptor)


@contextmanager
def _receiver(side: int, labels: int, descriptor: int
              ) -> Iterator[Callable[[str], dict[str, Any]]]:
    """The other process; a function that asks it for something and returns its answer."""
    arguments = ['--receive', str(descriptor), '--side', str(side), '--labels', str(labels)]
    with subprocess.Popen([sys.executable, '-m', 'pmcl_ros.nodes.bench.volume_transport',
                           *arguments],
                          stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                          bufsize=1, pass_fds=[descriptor]) as process:
        def ask(question: str) -> dict[str, Any]:
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(f'{question}\n')
            answer = process.stdout.readline()
            if not answer:
                raise TransportError('the receiving process has ended; its lines say why')
            result: dict[str, Any] = json.loads(answer)
            return result

        try:
            yield ask
        finally:
            if process.stdin is not None:
                process.stdin.close()  # which ends it


def receive(descriptor: int, side: int, labels: int, out: TextIO) -> None:
    """Answer questions, one a line: what came by the topic, or through shared memory."""
    expected = noise(side, labels)
    came: list[tuple[float, DepthLikelihoodVolume]] = []
    with ros(), mmap(descriptor, 0) as shared:
        node = Node('receiver')
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        subscription = node.create_subscription(
            Float32MultiArray, _TOPIC, lambda cdr: came.append(_read(cdr)), BIG, raw=True)
        both, sample = np.frombuffer(shared, np.float32), expected.likelihood.flatten()
        for line in sys.stdin:
            question, *given = line.split()
            answer: dict[str, object] = {}
            if question == 'meet':
                _wait(subscription.get_publisher_count, 'the sender')
            elif question == 'take':
                _numbered(expected, int(given[0]))
                answer = _take(executor, came, expected.likelihood)
            else:
                sample[:] = both
                sample.copy().copy()
                answer = {'at': time.monotonic()}
            out.write(json.dumps(answer) + '\n')
        del both
        executor.shutdown()
        node.destroy_node()


def _read(cdr: Any) -> tuple[float, DepthLikelihoodVolume]:
    """As `subscribe_value` does, and when the data are there; the volume is checked afterwards."""
    message = message_from(cdr, type_name(Float32MultiArray))
    at = time.monotonic()
    return at, volume_from(message)


def _take(executor: SingleThreadedExecutor, came: list[tuple[float, DepthLikelihoodVolume]],
          expected: NDArray[np.float32]) -> dict[str, object]:
    deadline = time.monotonic() + _PATIENCE
    while not came and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=1.0)
    if not came:
        return {'at': None, 'equal': False}
    (at, volume), = came
    came.clear()
    return {'at': at, 'equal': np.array_equal(volume.likelihood, expected)}


def main() -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--receive', type=int, metavar='FD', help='be the other process')
    parser.add_argument('--side', type=int, default=328, help='of the volume [px]')
    parser.add_argument('--labels', type=int, default=75)
    parser.add_argument('--messages', type=int, default=200)
    parser.add_argument('--copies', type=int, default=200, help='how many go the plain way too')
    options = parser.parse_args()
    out = os.fdopen(os.dup(1), 'w', buffering=1)
    os.dup2(2, 1)  # Fast DDS complains there
    if options.receive is not None:
        receive(options.receive, options.side, options.labels, out)
        return 0
    try:
        result = measure(options.side, options.labels, options.messages, options.copies)
    except PmclError as error:
        sys.stderr.write(f'{error}\n')
        return 1
    out.write(json.dumps(result) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
