"""A client of lifecycle nodes: requests transitions by their services."""

import time
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from pmcl_ros.runtime.errors import PmclError

CONFIGURE, ACTIVATE = 'configure', 'activate'
_TRANSITIONS = {  # the id of each, from which state, and to which
    CONFIGURE: (Transition.TRANSITION_CONFIGURE, State.PRIMARY_STATE_UNCONFIGURED,
                State.PRIMARY_STATE_INACTIVE),
    ACTIVATE: (Transition.TRANSITION_ACTIVATE, State.PRIMARY_STATE_INACTIVE,
               State.PRIMARY_STATE_ACTIVE)}
_REPEAT = 5.0  # s: without an answer the node is asked for its state


class LifecycleError(PmclError):
    """A node did not make a transition."""


class Lifecycle:
    """Asks nodes for transitions and waits for the answers.

    node, executor: to ask with. alive: raises when waiting for the node of that name is in vain.
    """

    def __init__(self, node: Node, executor: SingleThreadedExecutor,
                 alive: Callable[[str], None]) -> None:
        self._node, self._executor, self._alive = node, executor, alive

    def change(self, name: str, transition: str, timeout: float) -> None:
        """Take a node through CONFIGURE or ACTIVATE.

        Raises LifecycleError, which names the node, where it did not within `timeout` [s].
        """
        deadline = time.monotonic() + timeout
        number, before, after = _TRANSITIONS[transition]
        client = self._node.create_client(ChangeState, f'{name}/change_state')
        try:
            self._wait(name, client.service_is_ready, deadline, f'{client.srv_name} is not there')
            request = ChangeState.Request(transition=Transition(id=number))
            # DDS may lose a request or an answer right after the two have found each other, or
            # deliver it late: then the node refuses the next one, as it has made the transition.
            again = False
            while not self._answered(name, future := client.call_async(request), deadline):
                again = True
                state = self.state(name, deadline)
                if future.done():  # it was in the transition until now
                    break
                if state == after:
                    return
                if state != before:
                    raise LifecycleError(f'{name} did not {transition}: it is in state {state}')
            response: Any = future.result()
        finally:
            self._node.destroy_client(client)
        if not response.success and not (again and self.state(name, deadline) == after):
            raise LifecycleError(f'{name} could not {transition}; its log says why')

    def state(self, name: str, deadline: float) -> int:
        """The node's state, by lifecycle_msgs/State; there is no answer during a transition.

        It then knows the clients that were made before; DDS announces them in that order. Raises
        LifecycleError after `deadline`, by time.monotonic().
        """
        client = self._node.create_client(GetState, f'{name}/get_state')
        try:
            self._wait(name, client.service_is_ready, deadline, f'{client.srv_name} is not there')
            future = client.call_async(GetState.Request())
            while not self._answered(name, future, deadline):
                future = client.call_async(GetState.Request())
            answer: Any = future.result()
            return int(answer.current_state.id)
        finally:
            self._node.destroy_client(client)

    def _wait(self, name: str, ready: Callable[[], bool], deadline: float, problem: str) -> None:
        while not ready():
            self._alive(name)
            if time.monotonic() > deadline:
                raise LifecycleError(f'gave up on {name}: {problem} in time')
            self._executor.spin_once(timeout_sec=0.05)

    def _answered(self, name: str, future: Any, deadline: float) -> bool:
        """Whether an answer comes within _REPEAT [s]; LifecycleError after `deadline`."""
        soon = time.monotonic() + _REPEAT
        self._wait(name, lambda: future.done() or time.monotonic() > soon, deadline,
                   'it did not answer')
        return bool(future.done())
