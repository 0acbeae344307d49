"""`dlv/edges`, `dlv/contour_map` or `dlv` -> the evidence of each capture, for pmcl_node."""

import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from functools import partial

from rclpy.subscription import Subscription
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.evidence.evidence_volume import EvidenceVolume
from pmcl_ros.messages.volume import edges_from, map_from, volume_from
from pmcl_ros.nodes.runtime.base import BIG, StageNode
from pmcl_ros.nodes.transport.values import subscribe_value
from pmcl_ros.pipeline import Evidence
from pmcl_ros.pmcl.settings import PmclSettings

# of each kind: its topic, and what reads a message
_TOPICS: dict[str, tuple[str, Callable[..., EvidenceVolume]]] = {
    'edges': ('dlv/edges', edges_from), 'map': ('dlv/contour_map', map_from)}
ENDED = 'the node was reset or deactivated before it was searched'
_LOOK = 0.25  # s between two looks for publishers
_EVIDENCE_PATIENCE = 5.0  # s: how much later than its volume the evidence may come
_DISCOVERY = 4.0  # s: DDS repeats lost discovery messages every 3 s
_MAPS = 4  # captures whose contour maps are kept
# s: how much later than the search by its edges a contour map may come. Fast DDS sends what was
# lost, as 1 MB may be on a busy machine, again with the next heartbeat, after up to 3 s.
_MAP_PATIENCE = 4.0


class EvidenceInput:
    """Subscribes to the evidence of captures, for `start` of a node.

    In the mode faithful that is `dlv`, else the topic of its kind (auto: edges). While `dlv` is
    published and that topic is not, `dlv` replaces it: a likelihood alone is less exact. DDS may
    discover the publishers one after the other: the first volumes wait some seconds for their
    evidence.
    callback: gets the evidence of each capture, once. both: whether edges come with the contour
    map of the capture (`EdgeVolume.other`), where that is published. discovery: how long after the
    subscription to `dlv` a publisher of the evidence may still be discovered; patience: how long
    after the search by edges a contour map may still come [s].
    """

    def __init__(self, node: StageNode, settings: PmclSettings,
                 callback: Callable[[Evidence], None], both: bool = False,
                 discovery: float = _DISCOVERY, patience: float = _MAP_PATIENCE) -> None:
        self._node, self._callback, self._discovery = node, callback, discovery
        self._topic, read = _TOPICS['map' if settings.evidence == 'map' else 'edges']
        self._maps: _Maps | None = None
        self._evidence: Subscription | None = None  # but in the mode faithful
        self._scope = ExitStack()  # of the subscription to dlv, where edges may come
        self._volumes: Subscription | None = None  # while there is one
        self._since = 0.0  # when it was made
        self._alone = False  # at the last look: dlv was published, and the evidence was not
        # A volume that waits for its evidence, and since when.
        self._held: tuple[float, DepthLikelihoodVolume] | None = None
        if settings.mode == 'faithful':
            self._volumes = subscribe_value(node, Float32MultiArray, 'dlv', volume_from, callback,
                                            BIG)
            return
        self._evidence = subscribe_value(node, Float32MultiArray, self._topic, read,
                                         self._on_evidence, BIG)
        if both:
            # After the edges: a publisher that has discovered this has discovered those.
            self._maps = _Maps(node, patience)
        node.active.callback(self.forget)
        node.active.callback(self._end_volumes)
        node.every(_LOOK, self._look)

    def ways(self) -> list[list[Subscription]]:
        """The subscriptions that there are, for `AwaitedInputs`: any one is enough."""
        return [[each] for each in (self._evidence, self._volumes) if each is not None]

    def forget(self) -> None:
        """Drop the volume that waits for its evidence, and what came before."""
        self._drop_held(ENDED)
        if self._maps is not None:
            self._maps.forget()

    def wait_no_more(self) -> None:
        """Let no search wait for a contour map, until `forget`."""
        if self._maps is not None:
            self._maps.wait_no_more()

    def _on_evidence(self, evidence: EvidenceVolume) -> None:
        self._end_volumes()  # a volume that comes after its evidence would be searched too
        if self._held is not None and self._held[1].header.stamp_ns == evidence.header.stamp_ns:
            self._held = None
        self._drop_held(f'no {self._topic} came with it before the next')
        if self._maps is not None and isinstance(evidence, EdgeVolume):
            evidence = self._maps.beside(evidence)
        self._callback(evidence)

    def _on_volume(self, volume: DepthLikelihoodVolume) -> None:
        self._drop_held(f'no {self._topic} came with it before the next')
        self._held = time.monotonic(), volume
        self._deliver_overdue()

    def _drop_held(self, why: str) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._node.dropped(f'capture {held[1].header.stamp_ns}: {why}')

    def _published(self) -> bool:
        """Whether DDS has discovered a publisher of the evidence."""
        return self._evidence is not None and self._evidence.get_publisher_count() > 0

    def _look(self) -> None:
        """Subscribe to dlv or end that, as publishers come and go."""
        published = self._published()
        alone = not published and self._node.count_publishers(
            self._node.resolve_topic_name('dlv')) > 0
        # Topics of one publisher are discovered at different times: one look is no proof.
        if alone and self._alone and self._volumes is None:
            self._since = time.monotonic()
            self._volumes = subscribe_value(self._node, Float32MultiArray, 'dlv', volume_from,
                                            self._on_volume, BIG, scope=self._scope)
        elif published:
            self._end_volumes()
        self._alone = alone
        self._deliver_overdue()

    def _deliver_overdue(self) -> None:
        """Deliver the volume that waits when its evidence has had its time."""
        if self._held is None:
            return
        came, volume = self._held
        if self._published():
            end, why = came + _EVIDENCE_PATIENCE, f'its {self._topic} does not come'
        else:
            end, why = self._since + self._discovery, f'nobody publishes {self._topic}'
        if time.monotonic() > end:
            self._node.get_logger().warning(f'localizes from dlv alone: {why}', once=True)
            self._held = None
            self._callback(volume)

    def _end_volumes(self) -> None:
        self._scope.close()
        self._volumes = None


class _Maps:
    """The contour maps of the last captures, for the thread that searches in their edges."""

    def __init__(self, node: StageNode, patience: float) -> None:
        self._patience = patience
        self._kept: dict[int, ContourMap] = {}  # by stamp
        self._edges_ns = 0  # stamp of the last edges
        self._came, self._ended = threading.Condition(), False
        # One that is lost is no capture lost: its edges are searched all the same.
        self._subscription = subscribe_value(
            node, Float32MultiArray, 'dlv/contour_map', map_from, self._on_map, BIG,
            each_a_capture=False)

    def beside(self, edges: EdgeVolume) -> EdgeVolume:
        """The edges, with the map of their capture if anybody publishes maps."""
        if not self._subscription.get_publisher_count():
            return edges
        with self._came:
            if edges.header.stamp_ns < self._edges_ns:  # a bag is played again
                self._kept = {stamp: each for stamp, each in self._kept.items()
                              if stamp <= edges.header.stamp_ns}
            self._edges_ns = edges.header.stamp_ns
        return replace(edges, other=partial(self._of, edges.header.stamp_ns))

    def _on_map(self, odds: ContourMap) -> None:
        with self._came:
            self._kept[odds.header.stamp_ns] = odds
            while len(self._kept) > _MAPS:
                del self._kept[next(iter(self._kept))]
            self._came.notify_all()

    def _of(self, stamp: int) -> ContourMap | None:
        """The map of a capture, once it has come; None where it does not.

        Maps come in their order: after a later one it is not waited for.
        """
        with self._came:
            self._came.wait_for(lambda: self._ended or any(each >= stamp for each in self._kept),
                                self._patience)
            return self._kept.get(stamp)

    def wait_no_more(self) -> None:
        """End all waiting: the thread that searches is to stop."""
        with self._came:
            self._ended = True
            self._came.notify_all()

    def forget(self) -> None:
        """Begin anew, without maps."""
        with self._came:
            self._ended = False
            self._kept.clear()
