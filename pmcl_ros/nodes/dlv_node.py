"""LightField or PosedViews -> evidence and DepthLikelihoodVolume: what has a subscriber."""

import sys
from dataclasses import dataclass
from functools import cached_property, partial

from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.build import build_volume, choose, tiny_light_field, warm_up
from pmcl_ros.dlv.plane_sweep import build_volume_of_views
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import layers_picture
from pmcl_ros.evidence.build_map import build_map, warn_of_one_colour
from pmcl_ros.evidence.contour_map import ContourMap
from pmcl_ros.evidence.contour_net import contour_net
from pmcl_ros.evidence.edges import EdgeVolume, build_edges
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import Part, part_from
from pmcl_ros.messages.image import depth_to_message, picture_to_message
from pmcl_ros.messages.light_field import light_field_from, mosaic_from, pupil_from
from pmcl_ros.messages.types import Buffer
from pmcl_ros.messages.volume import edges_to_message, map_to_message, volume_to_message
from pmcl_ros.nodes.posed_views_input import subscribe_posed_views
from pmcl_ros.nodes.runtime.awaited_inputs import AwaitedInputs
from pmcl_ros.nodes.runtime.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.transport.deferred_publisher import DeferredPublisher, Output
from pmcl_ros.nodes.transport.exact_synchronizer import ExactSynchronizer
from pmcl_ros.nodes.transport.values import ValuePublisher, subscribe_value

# topic: type, what reads (and so checks) a message as it comes, quality of service
_INPUTS = {
    'views/camera_info': (CameraInfo, pinhole_from, SMALL),
    'views/pupil': (Image, pupil_from, SMALL),
    'views': (Image, mosaic_from, BIG),
}


@dataclass(frozen=True)
class Products:
    """What is made of a light field, when it is first asked for."""

    light_field: LightField
    settings: DlvSettings

    @cached_property
    def checked(self) -> LightField:
        """The light field, after a warning where it shows nothing."""
        warn_of_one_colour(self.light_field)
        return self.light_field

    @cached_property
    def edges(self) -> EdgeVolume:
        """For `dlv/edges`."""
        return build_edges(self.checked, self.settings)

    @cached_property
    def contour_map(self) -> ContourMap:
        """For `dlv/contour_map`."""
        return build_map(self.checked, self.settings)

    @cached_property
    def volume(self) -> DepthLikelihoodVolume:
        """For `dlv` and the pictures of it."""
        return build_volume(self.checked, self.settings)


class DlvNode(StageNode):
    """Publishes evidence and volume of each capture whose views, camera_info and pupil came.

    Of posed views the volume alone: `pmcl_node` reads these views themselves.
    """

    name = 'dlv_node'
    settings_class = DlvSettings

    def set_up(self, settings: DlvSettings) -> None:
        """Compile, so that the first capture need not wait for it, and load the network."""
        self._settings = settings
        contour_net()  # a broken file is an error here, not at the first capture
        build_edges(tiny_light_field(), DlvSettings(edge_labels=2, views=3))
        warm_up(settings.back_end, settings.layers)
        self.health.back_end = ('numpy' if settings.interpolation == 'phase'
                                else choose(settings.back_end))
        # First, so that whoever finds the publisher of dlv has found these before.
        edges = ValuePublisher(self, Float32MultiArray, 'dlv/edges', BIG,
                               edges_to_message, each_a_capture=True)
        odds = ValuePublisher(self, Float32MultiArray, 'dlv/contour_map', BIG, map_to_message,
                              each_a_capture=True)
        volume = ValuePublisher(self, Float32MultiArray, 'dlv', BIG, volume_to_message,
                                each_a_capture=True)
        depth = ValuePublisher(self, Image, 'dlv/depth', SMALL, depth_to_message)
        layers = ValuePublisher(self, Image, 'dlv/layers', SMALL, self._layers_to_message)
        self._volumes = [Output[DepthLikelihoodVolume](each.wanted, each.publish)
                         for each in (volume, depth, layers)]
        self._outputs: list[Output[Products]] = [
            Output(edges.wanted, lambda made: edges.publish(made.edges)),
            # Where edges are wanted the search reads those, and the map only where it needs to.
            Output(odds.wanted, lambda made: odds.publish(
                made.contour_map, each_a_capture=not edges.wanted())),
            *map(_of_light_field, self._volumes)]

    def start(self) -> None:
        """Listen."""
        # The small topics bring as many captures as their history holds before the big one's turn.
        self._matching = ExactSynchronizer(list(_INPUTS), SMALL.depth, self.dropped)
        self._deferred = DeferredPublisher(
            self, self._outputs, 'no subscriber of dlv/edges, dlv/contour_map, dlv, '
            'dlv/depth or dlv/layers')
        # `pmcl_node` reads posed views themselves: their volume is for whoever wants it.
        self._of_views = DeferredPublisher(self, self._volumes, '')
        posed = subscribe_posed_views(self, self._on_views)
        views = [subscribe_value(self, kind, topic, part_from(check),
                                 partial(self._on_part, topic), qos,
                                 each_a_capture=topic == 'views', announced=True)
                 for topic, (kind, check, qos) in _INPUTS.items()]
        AwaitedInputs(self, lambda: (views, posed))

    def _on_part(self, topic: str, part: LightField | Part) -> None:
        self.health.frames_in += topic == 'views'
        if isinstance(part, LightField):  # by reference, on each of the three topics
            if topic == 'views':
                self._deferred.publish(partial(Products, part, self._settings),
                                       f'capture {part.header.stamp_ns}')
            return
        complete = self._matching.add(topic, part.header.stamp_ns, part.message)
        if complete:
            self._deferred.publish(
                lambda: Products(light_field_from(*complete), self._settings),
                f'capture {part.header.stamp_ns}')

    def _on_views(self, views: PosedViews) -> None:
        self.health.frames_in += 1
        if len(views.views) > 1:  # one alone has no depth
            self._of_views.publish(partial(build_volume_of_views, views, self._settings),
                                   f'capture {views.header.stamp_ns}')

    def _layers_to_message(self, volume: DepthLikelihoodVolume,
                           buffer: Buffer) -> Image:
        picture = layers_picture(volume.layers(), self._settings.near, self._settings.far)
        return picture_to_message(volume.header, picture, buffer)


def _of_light_field(volumes: Output[DepthLikelihoodVolume]) -> Output[Products]:
    return Output(volumes.wanted, lambda made: volumes.publish(made.volume))


def main() -> int:
    """Entry point."""
    return run(DlvNode)


if __name__ == '__main__':
    sys.exit(main())
