"""Takes nodes through their lifecycle, by their services, as a manager or a user would."""

import time
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from pmcl_ros.errors import PmclError

CONFIGURE, ACTIVATE = 'configure', 'activate'
_IDS = {CONFIGURE: Transition.TRANSITION_CONFIGURE, ACTIVATE: Transition.TRANSITION_ACTIVATE,
        'deactivate': Transition.TRANSITION_DEACTIVATE, 'cleanup': Transition.TRANSITION_CLEANUP}


class LifecycleError(PmclError):
    """A node did not make a transition."""


class Lifecycle:
    """Asks nodes for transitions and waits for the answers.

    node, executor: to ask with. alive: raises when waiting for the node of that name is in vain.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor,
                 alive: Callable[[str], None] = lambda _: None) -> None:
        self._node, self._executor, self._alive = node, executor, alive

    def change(self, name: str, transition: str, timeout: float) -> None:
        """Make one transition; LifecycleError names the node that did not within `timeout` [s]."""
        deadline = time.monotonic() + timeout
        client = self._node.create_client(ChangeState, f'{name}/change_state')
        try:
            self._wait(name, client.service_is_ready, deadline, f'{client.srv_name} is not there')
            request = ChangeState.Request(transition=Transition(id=_IDS[transition]))
            future = client.call_async(request)
            self._wait(name, future.done, deadline, f'it did not {transition}')
            response: Any = future.result()
        finally:
            self._node.destroy_client(client)
        if not response.success:
            raise LifecycleError(f'{name} could not {transition}; its log says why')

    def _wait(self, name: str, ready: Callable[[], bool], deadline: float, problem: str) -> None:
        while not ready():
            self._alive(name)
            if time.monotonic() > deadline:
                raise LifecycleError(f'gave up on {name}: {problem} in time')
            self._executor.spin_once(timeout_sec=0.05)
