"""Runs nodes: starts and ends ROS, and gives each node a thread.

rclpy's own signal handlers take ROS away while callbacks are at work, and crash where several
executors run. Here signals are noted and asked for instead: nodes finish what they do, and are
closed while ROS is still there.
"""

import ctypes
import logging
import os
import select
import signal
import socket
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from pmcl_ros.nodes.runtime import shared_memory
from pmcl_ros.nodes.runtime.parameter_file import check_parameter_file, parameter_files
from pmcl_ros.runtime.errors import SettingsError

if TYPE_CHECKING:  # it imports numba, which player and recorder do not need
    from pmcl_ros.nodes.runtime.base import StageNode

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# In the environment of a node that shall not outlive who started it: that process's number.
PARENT = 'PMCL_BRINGUP_PID'
_NOTED, _NOTE = socket.socketpair()
_PR_SET_PDEATHSIG = 1  # of <linux/prctl.h>


class Interrupted(Exception):  # noqa: N818 -- nothing went wrong
    """One of SIGNALS came."""


@contextmanager
def ros(args: list[str] | None = None) -> Iterator[None]:
    """ROS while it lasts; an Interrupted from inside ends it without a trace.

    SettingsError for arguments that ROS refuses, as a parameter file that it cannot read.
    The process is expected to end soon after it.
    """
    _note_signals()
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # all of rclpy's about arguments and parameter files are such
        raise SettingsError(f'ROS does not start with these arguments: {error}') from None
    core, handler = logging.getLogger('pmcl_ros'), RosLog()
    core.addHandler(handler)
    core.setLevel(logging.INFO)
    if problem := shared_memory.problem_here():
        rclpy.logging.get_logger('pmcl_ros').warning(problem)
    try:
        yield
    except Interrupted:
        pass
    finally:
        core.removeHandler(handler)
        rclpy.shutdown(uninstall_handlers=False)  # none are; it would reset ours for a moment
        for each in SIGNALS:  # it is ending: one more must not cut that short
            signal.signal(each, signal.SIG_IGN)


def _note_signals() -> None:
    # Not blocked and waited for: threads that libraries made when they were imported, as numpy's,
    # block nothing, and a signal that hits one of them would end the process on the spot.
    _NOTE.setblocking(False)
    signal.set_wakeup_fd(_NOTE.fileno(), warn_on_full_buffer=False)
    for each in SIGNALS:
        # What nohup has turned off stays off.
        if each != signal.SIGHUP or signal.getsignal(each) != signal.SIG_IGN:
            signal.signal(each, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)  # bring-up starts processes with a mask


def pause(seconds: float) -> None:
    """Let `seconds` pass; Interrupted when one of SIGNALS comes, or has come."""
    came, _, _ = select.select([_NOTED], [], [], max(seconds, 0))
    if came:
        raise Interrupted


class NodeThread:
    """A node of this process, with a thread and an executor of its own."""

    def __init__(self, node: 'StageNode') -> None:
        self._node = node
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._stopping = False
        self._thread = threading.Thread(target=self._spin, name=node.get_name())
        self._thread.start()

    def alive(self) -> bool:
        """Whether it still runs."""
        return self._thread.is_alive()

    def end(self) -> str:
        """How it ended."""
        return 'ended with its thread'

    def stop(self) -> None:
        """End the thread once its callback is done, then the node."""
        self._stopping = True  # not shutdown(), which crashes when another thread spins
        self._executor.create_task(lambda: None)  # wakes it
        self._thread.join()
        self._executor.shutdown()
        self._node.close()

    def _spin(self) -> None:
        try:
            while not self._stopping:
                self._executor.spin_once()
        except Exception:
            self._node.get_logger().fatal(f'unexpected error\n{traceback.format_exc()}')


def run(node_class: 'type[StageNode]') -> int:
    """Main function of a node's executable."""
    _end_with_parent()
    try:
        for file in parameter_files(sys.argv):
            check_parameter_file(file, node_class.name)
        with ros():
            node = NodeThread(node_class())
            try:
                while node.alive():
                    pause(0.5)
            finally:
                node.stop()
            return 1
    except SettingsError as error:
        sys.stderr.write(f'{node_class.name}: {error}\n')
        return 1
    return 0


def _end_with_parent() -> None:
    """Be interrupted when bring-up ends, also where that cannot do it any more."""
    parent = os.environ.get(PARENT)
    if parent is None:
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
    if os.getppid() != int(parent):  # it has ended before
        sys.exit(f'bring-up (process {parent}) has ended')


class RosLog(logging.Handler):
    """Passes what the core logs on to ROS."""

    def emit(self, record: logging.LogRecord) -> None:
        """Log `record` under its module's name; rclpy wants one line of code per severity."""
        logger = rclpy.logging.get_logger(record.name)
        if record.levelno >= logging.ERROR:
            logger.error(self.format(record))
        elif record.levelno >= logging.WARNING:
            logger.warning(self.format(record))
        else:
            logger.info(self.format(record))
