"""LightField -> DepthLikelihoodVolume."""

import sys
from functools import partial

from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.back_end import choose
from pmcl_ros.dlv.build import build_volume, warm_up
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.dlv.volume import DepthLikelihoodVolume
from pmcl_ros.drawing.pictures import layers_picture
from pmcl_ros.lightfield.light_field import LightField
from pmcl_ros.messages.buffer import Buffer
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import Part, part_from
from pmcl_ros.messages.image import depth_to_message, picture_to_message
from pmcl_ros.messages.light_field import light_field_from, mosaic_from, pupil_from
from pmcl_ros.messages.volume import edges_to_message, volume_to_message
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


class DlvNode(StageNode):
    """Builds the volume of each capture whose `views`, camera_info and pupil have all come."""

    name = 'dlv_node'
    settings_class = DlvSettings

    def set_up(self, settings: DlvSettings) -> None:
        """Compile, so that the first capture need not wait for it."""
        self._settings = settings
        warm_up(settings.back_end, settings.layers)
        self.health.back_end = ('numpy' if settings.interpolation == 'phase'
                                else choose(settings.back_end))
        volume = ValuePublisher(self, Float32MultiArray, 'dlv', BIG, volume_to_message,
                                each_a_capture=True)
        edges = ValuePublisher(self, Float32MultiArray, 'dlv/edges', BIG,
                               edges_to_message)
        depth = ValuePublisher(self, Image, 'dlv/depth', SMALL, depth_to_message)
        layers = ValuePublisher(self, Image, 'dlv/layers', SMALL, self._layers_to_message)
        self._outputs = [Output(volume.wanted, volume.publish),
                         Output(edges.wanted, lambda made: edges.publish(made.edges)),
                         Output(depth.wanted, depth.publish),
                         Output(layers.wanted, layers.publish)]

    def start(self) -> None:
        """Listen."""
        # The small topics bring as many captures as their history holds before the big one's turn.
        self._matching = ExactSynchronizer(list(_INPUTS), SMALL.depth, self.dropped)
        self._audience = DeferredPublisher(self, self._outputs, 'views: nobody listens to dlv')
        for topic, (kind, check, qos) in _INPUTS.items():
            subscribe_value(self, kind, topic, part_from(check),
                            partial(self._on_part, topic), qos, each_a_capture=topic == 'views',
                            announced=True)

    def _on_part(self, topic: str, part: LightField | Part) -> None:
        self.health.frames_in += topic == 'views'
        if isinstance(part, LightField):  # handed over: the whole, on each of the three
            if topic == 'views':
                self._audience.tell(partial(build_volume, part, self._settings),
                                    f'capture {part.header.stamp_ns}')
            return
        complete = self._matching.add(topic, part.header.stamp_ns, part.message)
        if complete:
            self._audience.tell(partial(self._build, *complete), f'capture {part.header.stamp_ns}')

    def _build(self, camera_info: CameraInfo, pupil: Image, views: Image) -> DepthLikelihoodVolume:
        return build_volume(light_field_from(camera_info, pupil, views),
                            self._settings)

    def _layers_to_message(self, volume: DepthLikelihoodVolume,
                           buffer: Buffer) -> Image:
        picture = layers_picture(volume.layers(), self._settings.near, self._settings.far)
        return picture_to_message(volume.header, picture, buffer)


def main() -> int:
    """Entry point."""
    return run(DlvNode)


if __name__ == '__main__':
    sys.exit(main())
