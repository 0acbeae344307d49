"""The input of pmcl_node: the evidence of each capture, from `dlv/edges` or `dlv`."""

import time
from collections.abc import Callable
from contextlib import ExitStack

from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.evidence.edges import EdgeVolume
from pmcl_ros.messages.volume import edges_from, volume_from
from pmcl_ros.nodes.runtime.base import BIG, StageNode
from pmcl_ros.nodes.transport.values import subscribe_value
from pmcl_ros.pipeline import Evidence
from pmcl_ros.pmcl.settings import Mode

ENDED = 'the node was reset or deactivated before it was searched'
_NO_EDGES = 'no dlv/edges came with it before the next'
_LOOK = 0.25  # s between two looks for publishers
_PATIENCE = 5.0  # s: how much later than its volume an edge volume may come
_DISCOVERY = 4.0  # s: DDS repeats lost discovery messages every 3 s


class EvidenceInput:
    """Subscribes to the evidence of captures, for `start` of a node.

    In the mode faithful that is `dlv`, else `dlv/edges`. While `dlv` is published and `dlv/edges`
    is not, `dlv` replaces it: a likelihood alone is less exact. DDS may discover the publishers
    one after the other: the first volumes wait some seconds for their edges.
    callback: gets the evidence of each capture, once. discovery: how long after the subscription
    to `dlv` a publisher of `dlv/edges` may still be discovered [s].
    """

    def __init__(self, node: StageNode, mode: Mode, callback: Callable[[Evidence], None],
                 discovery: float = _DISCOVERY) -> None:
        self._node, self._callback, self._discovery = node, callback, discovery
        self._volumes: ExitStack | None = None  # the subscription to dlv, while there is one
        self._since = 0.0  # when it was made
        self._alone = False  # at the last look: dlv was published, and dlv/edges was not
        # A volume that waits for its edges, and since when.
        self._held: tuple[float, DepthLikelihoodVolume] | None = None
        if mode == 'faithful':
            subscribe_value(node, Float32MultiArray, 'dlv', volume_from, callback, BIG)
            return
        self._edges = subscribe_value(node, Float32MultiArray, 'dlv/edges', edges_from,
                                      self._on_edges, BIG)
        node.active.callback(self.forget)
        node.active.callback(self._end_volumes)
        node.every(_LOOK, self._look)

    def forget(self) -> None:
        """Drop the volume that waits for its edges."""
        self._drop_held(ENDED)

    def _on_edges(self, edges: EdgeVolume) -> None:
        self._end_volumes()  # a volume that comes after its edges would be searched too
        if self._held is not None and self._held[1].header.stamp_ns == edges.header.stamp_ns:
            self._held = None
        self._drop_held(_NO_EDGES)
        self._callback(edges)

    def _on_volume(self, volume: DepthLikelihoodVolume) -> None:
        self._drop_held(_NO_EDGES)
        self._held = time.monotonic(), volume
        self._wait_no_longer()

    def _drop_held(self, why: str) -> None:
        held, self._held = self._held, None
        if held is not None:
            self._node.dropped(f'capture {held[1].header.stamp_ns}: {why}')

    def _published(self) -> bool:
        """Whether DDS has discovered a publisher of dlv/edges."""
        return self._edges.get_publisher_count() > 0

    def _look(self) -> None:
        """Subscribe to dlv or end that, as publishers come and go."""
        published = self._published()
        alone = not published and self._node.count_publishers(
            self._node.resolve_topic_name('dlv')) > 0
        # Topics of one publisher are discovered at different times: one look is no proof.
        if alone and self._alone and self._volumes is None:
            self._volumes, self._since = ExitStack(), time.monotonic()
            subscribe_value(self._node, Float32MultiArray, 'dlv', volume_from,
                            self._on_volume, BIG, scope=self._volumes)
        elif published:
            self._end_volumes()
        self._alone = alone
        self._wait_no_longer()

    def _wait_no_longer(self) -> None:
        """Deliver the volume that waits when its edges have had their time."""
        if self._held is None:
            return
        came, volume = self._held
        end, why = ((came + _PATIENCE, 'its dlv/edges do not come') if self._published()
                    else (self._since + self._discovery, 'nobody publishes dlv/edges'))
        if time.monotonic() > end:
            self._node.get_logger().warning(f'localizes from dlv alone: {why}', once=True)
            self._held = None
            self._callback(volume)

    def _end_volumes(self) -> None:
        if self._volumes is not None:
            self._volumes.close()
            self._volumes = None
