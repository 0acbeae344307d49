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

_LOOK = 0.25  # s between two looks for publishers
_PATIENCE = 5.0  # s: how much later than its volume an edge volume may come
# s: how much later it may be found who publishes it. DDS repeats what may have been lost every 3.
_DISCOVERY = 4.0


class EvidenceInput:
    """Subscribes to the evidence of captures, for `start` of a node.

    In the mode faithful that is `dlv`, else `dlv/edges`. While `dlv` is published and `dlv/edges`
    is not, `dlv` replaces it: a likelihood alone is less exact. DDS may find the publishers one
    after the other: the first volumes wait some seconds for their edges.
    callback: gets the evidence of each capture, once.
    """

    def __init__(self, node: StageNode, mode: Mode, callback: Callable[[Evidence], None]) -> None:
        self._node, self._callback = node, callback
        self._volumes: ExitStack | None = None  # the subscription to dlv, while there is one
        self._since = 0.0  # when it was made
        self._alone = False  # at the last look: dlv was published, and dlv/edges was not
        self.forget()
        if mode == 'faithful':
            subscribe_value(node, Float32MultiArray, 'dlv', volume_from, callback, BIG)
            return
        self._edges = subscribe_value(node, Float32MultiArray, 'dlv/edges', edges_from,
                                      self._on_edges, BIG)
        node.active.callback(self._end_volumes)
        node.every(_LOOK, self._look)

    def forget(self) -> None:
        """Drop the volume that waits for its edges."""
        self._held: tuple[float, DepthLikelihoodVolume] | None = None  # since when without edges
        self._edges_ns: int | None = None  # stamp of the last edges

    def _on_edges(self, edges: EdgeVolume) -> None:
        held, self._held = self._held, None
        if held is not None and held[1].header.stamp_ns != edges.header.stamp_ns:
            self._give_up(held[1])
        self._edges_ns = edges.header.stamp_ns
        self._callback(edges)

    def _on_volume(self, volume: DepthLikelihoodVolume) -> None:
        if volume.header.stamp_ns == self._edges_ns:  # of a capture that is searched already
            return
        if self._held is not None:
            self._give_up(self._held[1])
        self._held = time.monotonic(), volume
        if not self._published() and time.monotonic() - self._since > _DISCOVERY:
            self._deliver_alone('nobody publishes dlv/edges')

    def _give_up(self, volume: DepthLikelihoodVolume) -> None:
        self._node.dropped(f'capture {volume.header.stamp_ns}: no dlv/edges came with it before '
                           'the next')

    def _published(self) -> bool:
        """Whether somebody publishes dlv/edges, as far as is known."""
        return self._edges.get_publisher_count() > 0

    def _look(self) -> None:
        """Subscribe to dlv or end that, as publishers come and go."""
        published = self._published()
        alone = not published and self._node.count_publishers(
            self._node.resolve_topic_name('dlv')) > 0
        # Topics of one publisher are found at different times: one look is no proof.
        if alone and self._alone and self._volumes is None:
            self._volumes, self._since = ExitStack(), time.monotonic()
            subscribe_value(self._node, Float32MultiArray, 'dlv', volume_from,
                            self._on_volume, BIG, scope=self._volumes)
        elif published:
            self._end_volumes()
        self._alone = alone
        if self._held is None:
            return
        patience, since = ((_PATIENCE, self._held[0]) if published
                           else (_DISCOVERY, self._since))
        if time.monotonic() - since > patience:
            self._deliver_alone('its dlv/edges do not come' if published
                                else 'nobody publishes dlv/edges')

    def _deliver_alone(self, why: str) -> None:
        if self._held is not None:
            self._node.get_logger().warning(f'localizes from dlv alone: {why}', once=True)
            (_, volume), self._held = self._held, None
            self._callback(volume)

    def _end_volumes(self) -> None:
        if self._volumes is not None:
            self._volumes.close()
            self._volumes = None
