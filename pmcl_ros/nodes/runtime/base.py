"""The base class of the nodes: a lifecycle node that survives its users' mistakes.

rclpy 7.1 leaves gaps that are closed here once: an impossible transition ends the process,
exceptions in transitions vanish without a line, destroyed publishers stay registered, and
subscriptions, timers and services run in every state.
"""

import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from threading import Lock
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import PublisherEventCallbacks
from rclpy.lifecycle import LifecycleNode, LifecyclePublisher, LifecycleState
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from std_srvs.srv import Trigger

from pmcl_ros.nodes.runtime.health import Health
from pmcl_ros.nodes.runtime.namesakes import PATIENCE, Namesakes
from pmcl_ros.nodes.runtime.parameters import Parameters
from pmcl_ros.nodes.runtime.qos_overrides import overridable, warn_of_unknown
from pmcl_ros.nodes.runtime.repeated_lines import RepeatedLines
from pmcl_ros.nodes.transport.intra_process_bus import IntraProcessBus
from pmcl_ros.nodes.transport.losses import SequenceGaps
from pmcl_ros.runtime import kernels
from pmcl_ros.runtime.errors import PmclError, error_line, is_foreseen
from pmcl_ros.runtime.settings import Settings

# Both ends of every big topic: best effort loses messages of this size; only the newest counts.
BIG = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
# Late subscribers get the last message too.
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE,
                     durability=DurabilityPolicy.TRANSIENT_LOCAL)
SMALL = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
# Poses of an arm, that come up to 1000 times a second.
MANY = QoSProfile(depth=200, reliability=ReliabilityPolicy.RELIABLE)
_PERIOD = 1.0  # s: of /diagnostics


class StageNode(LifecycleNode):
    """A lifecycle node with a name, settings, a `set_up` (configure) and a `start` (activate).

    Both acquire resources by the helpers below, or push their release onto `configured` or
    `active`: all is released in reverse order when the node leaves that state. A PmclError is one
    that the user can mend: one line is logged, the transition fails, and the node stays.

    bus: shared by the nodes of the graph that live in this process.
    """

    name: ClassVar[str]
    settings_class: ClassVar[type[Settings]]
    patience: ClassVar[float] = PATIENCE  # with other nodes of its name [s]

    def __init__(self, bus: IntraProcessBus | None = None, **options: Any) -> None:
        super().__init__(self.name, **options)
        self.bus = bus or IntraProcessBus()
        self.configured, self.active = ExitStack(), ExitStack()
        self.health = Health()
        self.heard: set[str] = set()  # topics of which something has come since activation
        self.sent_ns = 0  # when the message in hand was sent, by its publisher's clock
        self._repeated = RepeatedLines()
        self._described = Parameters(self, self.settings_class)
        self._diagnostics: Publisher | None = None
        self._diagnostics_lock = Lock()  # held while the publisher is used or taken away
        self._next_failure = 0.0  # that is published at once, by the monotonic clock [s]
        self._next_report = 0.0  # of the kernels that are compiled, by the monotonic clock [s]
        self._guard_transitions()

    def set_up(self, settings: Any) -> None:
        """Load and check everything that `settings` name, make publishers."""
        raise NotImplementedError

    def start(self) -> None:
        """Make subscriptions, timers and services."""
        raise NotImplementedError

    # for set_up

    def publisher(self, kind: type, topic: str, qos: QoSProfile,
                  joined: Callable[[], None] | None = None) -> LifecyclePublisher:
        """A publisher for as long as the node is configured; silent while it is inactive.

        joined: called after a subscription has come.
        """
        def matched(status: Any) -> None:
            if joined is not None and status.current_count_change > 0:
                with self.watched(topic):
                    joined()

        events = PublisherEventCallbacks(matched=None if joined is None else matched)
        with overridable(self, topic, qos, qos is BIG) as (profile, options):
            publisher = self.create_lifecycle_publisher(
                kind, topic, profile, qos_overriding_options=options, event_callbacks=events)
        self.configured.callback(self.destroy_lifecycle_publisher, publisher)
        return publisher

    # for start

    def subscribe(self, kind: type, topic: str, callback: Callable[[Any], None],
                  qos: QoSProfile, raw: bool = False,
                  missed: Callable[[int], None] = lambda _: None,
                  scope: ExitStack | None = None) -> Subscription:
        """A subscription while the node is active; errors of `callback` are logged and counted.

        raw: the callback gets the serialised message. missed: called with the number of messages
        that were overwritten before this one was read, if there are any. scope: closed when the
        subscription is to end; default: when the node is deactivated.
        """
        gaps = SequenceGaps()

        def received(message: Any, info: dict[str, int | None]) -> None:
            with self.watched(topic):
                count = gaps.missed(info['publication_sequence_number'],
                                    subscription.get_publisher_count())
                if count:
                    missed(count)
                self.sent_ns = info['source_timestamp'] or 0
                self.heard.add(subscription.topic_name)
                callback(message)

        with overridable(self, topic, qos, qos is BIG) as (profile, options):
            with_info: Any = received  # rclpy's type hints know the callback without info only
            subscription = self.create_subscription(kind, topic, with_info, profile, raw=raw,
                                                    qos_overriding_options=options)
        (self.active if scope is None else scope).callback(self.destroy_subscription, subscription)
        return subscription

    @staticmethod
    def take_all(subscription: Subscription) -> None:
        """Handle all that has come to a subscription of `subscribe` now, not when it is due."""
        with subscription.handle:
            while taken := subscription.handle.take_message(subscription.msg_type,
                                                            subscription.raw):
                subscription.callback(*taken)

    def every(self, period: float, callback: Callable[[], None]) -> Timer:
        """A timer while the node is active, `period` in seconds."""
        def due() -> None:
            with self.watched('timer'):
                callback()

        # Steady, not the node's: with use_sim_time that one stands still, or jumps.
        timer = self.create_timer(period, due, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.active.callback(self.destroy_timer, timer)
        return timer

    def serve(self, service: str, callback: Callable[[], str]) -> None:
        """A Trigger service while the node is active; `callback` returns what to answer."""
        def called(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            with self.watched(service) as problems:
                try:
                    response.message, response.success = callback(), True
                except PmclError as error:  # the caller's matter, not the node's health
                    response.message = str(error)
                    self.get_logger().warning(f'{service}: {error}')
            response.message = problems[0] if problems else response.message
            return response

        server = self.create_service(Trigger, service, called)
        self.active.callback(self.destroy_service, server)

    @contextmanager
    def watched(self, what: str) -> Iterator[list[str]]:
        """Log and count what goes wrong inside; the list that is yielded then holds it.

        What goes wrong with every picture of a camera is logged once in ten seconds.
        """
        problems: list[str] = []
        try:
            yield problems
        except Exception as error:
            if is_foreseen(error):
                problems.append(error_line(error))
                told = problems[0] if problems[0].startswith(f'{what}: ') else (
                    f'{what}: {problems[0]}')
                if line := self._repeated(told):
                    self.get_logger().error(line)
            else:
                problems.append(f'{type(error).__name__}: {error}')
                if line := self._repeated(f'{what}: unexpected error\n{traceback.format_exc()}'):
                    self.get_logger().error(line)
        if problems:
            self.health.failed(f'{what}: {problems[0]}')
            if (now := time.monotonic()) >= self._next_failure:  # more are told by the timer
                self._next_failure = now + _PERIOD
                self.publish_diagnostics()

    def publish_last(self, publisher: LifecyclePublisher, message: object) -> None:
        """Publish when the node leaves active, unless ROS has been shut down around it."""
        if self.context.ok():
            publisher.publish(message)

    def done(self, latency: float, message: str) -> None:
        """Count and log a result that was published `latency` seconds after its input came."""
        self.health.done(latency, message)
        self.get_logger().info(f'{message}, in {1e3 * latency:.0f} ms')

    def dropped(self, what: str, count: int = 1) -> None:
        """Count and log an input, or several, that are given up."""
        with self.health.lock:
            self.health.dropped += count
        self.get_logger().warning(f'dropped {what}')

    def publish_diagnostics(self) -> None:
        """Publish /diagnostics now, not at the next second; any thread may."""
        with self._diagnostics_lock:
            if self._diagnostics is not None:
                now = self.get_clock().now().nanoseconds
                # /diagnostics is one topic for all graphs: with its namespace a name is one node's
                name = self.get_fully_qualified_name().lstrip('/')
                self._diagnostics.publish(self.health.to_message(now, name))

    # transitions

    def on_configure(self, _: LifecycleState) -> Result:
        """Read the parameters and `set_up`."""
        return self._enter('configure', self.configured, self._configure)

    def on_activate(self, state: LifecycleState) -> Result:
        """Let publishers speak, then `start`."""
        return self._enter('activate', self.active, lambda: self._activate(state))

    def on_deactivate(self, _: LifecycleState) -> Result:
        """Undo `start`."""
        return self._leave('deactivate', self.active)

    def on_cleanup(self, _: LifecycleState) -> Result:
        """Undo `set_up`."""
        return self._leave('cleanup', self.configured)

    def on_shutdown(self, _: LifecycleState) -> Result:
        """Undo whatever has been done; what fails in that is logged, and the node is final."""
        self._leave('shutdown', self.active, self.configured)
        return Result.SUCCESS

    def on_error(self, _: LifecycleState) -> Result:
        """Undo whatever has been done, to be configured again."""
        self._leave('error', self.active, self.configured)
        return Result.SUCCESS

    def close(self) -> None:
        """Release all and end the node."""
        self._leave('close', self.active, self.configured)
        self.destroy_node()

    def _configure(self) -> None:
        settings = self._described.read()
        self.configured.enter_context(self._described.used(settings))
        self.get_logger().info(f'configured with {settings!r}')
        self.health = Health(message='configuring')
        with self._diagnostics_publisher(), kernels.reporting(self._report_compiling):
            self.publish_diagnostics()
            self.set_up(settings)

    def _activate(self, state: LifecycleState) -> None:
        super().on_activate(state)
        self.active.callback(super().on_deactivate, state)
        self.health = Health(back_end=self.health.back_end)
        self._repeated, self.heard = RepeatedLines(), set()
        self.active.enter_context(self._diagnostics_publisher())
        namesakes = Namesakes(self, self.patience)
        self.every(_PERIOD, lambda: self._report(namesakes))
        self.start()
        warn_of_unknown(self)

    def _report(self, namesakes: Namesakes) -> None:
        if (count := namesakes.count()) > 1:
            self.health.extra['nodes of this name'] = count
        else:
            self.health.extra.pop('nodes of this name', None)
        self.publish_diagnostics()

    def _report_compiling(self, kernel: str) -> None:
        """Log and publish, at most once a second, how many kernels are compiled."""
        if (now := time.monotonic()) < self._next_report:
            return
        self._next_report = now + _PERIOD
        count, total = kernels.progress()
        text = f'compiling kernels: {count} of {total}, {kernel}'
        self.get_logger().info(text)
        self.health.message = f'configuring; {text}'
        self.publish_diagnostics()

    @contextmanager
    def _diagnostics_publisher(self) -> Iterator[None]:
        """Keep a publisher of /diagnostics as long as the context lasts."""
        publisher = self.create_publisher(DiagnosticArray, '/diagnostics', SMALL)
        self._diagnostics = publisher
        try:
            yield
        finally:
            with self._diagnostics_lock:
                self._diagnostics = None
            self.destroy_publisher(publisher)

    def _enter(self, transition: str, scope: ExitStack, step: Callable[[], None]) -> Result:
        try:
            step()
        except Exception as error:
            if is_foreseen(error):
                self.get_logger().error(f'cannot {transition}: {error_line(error)}')
                released = self._leave(transition, scope)
                return Result.FAILURE if released == Result.SUCCESS else released
            self.get_logger().error(f'cannot {transition}: unexpected error\n'
                                    f'{traceback.format_exc()}')
            return Result.ERROR  # on_error releases
        return Result.SUCCESS

    def _leave(self, transition: str, *scopes: ExitStack) -> Result:
        result = Result.SUCCESS
        for scope in scopes:
            try:
                scope.close()  # runs all that it holds, whatever fails
            except Exception:
                self.get_logger().error(f'{transition}: unexpected error\n'
                                        f'{traceback.format_exc()}')
                result = Result.ERROR
        return result

    def _guard_transitions(self) -> None:
        # rclpy 7.1 (issue 1209) lets an impossible request's RCLError end the process. Beside
        # these two private names this package uses one of rclpy's inside: unknown_parameters.
        change, machine = self._service_change_state.callback, self._state_machine

        def guarded(request: ChangeState.Request,
                    response: ChangeState.Response) -> ChangeState.Response:
            wanted = request.transition
            possible = {each[1]: each[0] for each in machine.available_transitions}
            if wanted.label in possible or (not wanted.label and wanted.id in possible.values()):
                return change(request, response)
            self.get_logger().error(
                f'no transition {wanted.label or wanted.id} from {machine.current_state[1]}; '
                f'possible: {possible}')
            response.success = False
            return response

        self._service_change_state.callback = guarded
