"""LightField -> DepthLikelihoodVolume."""

import sys
import time
from functools import partial

from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from pmcl_ros import conversions
from pmcl_ros.dlv.build import build_volume, warm_up
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evaluation.pictures import layers_picture
from pmcl_ros.nodes.base import BIG, SMALL, StageNode
from pmcl_ros.nodes.matching import Matching
from pmcl_ros.nodes.running import run

# topic: type, what reads (and so checks) a message as it comes, quality of service
_INPUTS = {
    'views/camera_info': (CameraInfo, conversions.pinhole_from, SMALL),
    'views/pupil': (Image, conversions.pupil_from, SMALL),
    'views': (Image, conversions.mosaic_from, BIG),
}


class DlvNode(StageNode):
    """Builds the volume of each capture whose `views`, camera_info and pupil have all come."""

    name = 'dlv_node'
    settings_class = DlvSettings

    def set_up(self, settings: DlvSettings) -> None:
        """Compile, so that the first capture need not wait for it."""
        self._settings = settings
        warm_up(settings.back_end)
        self._volume = self.publisher(Float32MultiArray, 'dlv', BIG)
        self._edges = self.publisher(Float32MultiArray, 'dlv/edges', BIG)
        self._depth = self.publisher(Image, 'dlv/depth', SMALL)
        self._layers = self.publisher(Image, 'dlv/layers', SMALL)
        self._buffers = {each: conversions.Buffer()
                         for each in ('volume', 'edges', 'depth', 'layers')}

    def start(self) -> None:
        """Listen."""
        self._matching = Matching(list(_INPUTS), 2, self.dropped)
        for topic, (kind, _, qos) in _INPUTS.items():
            self.subscribe(kind, topic, partial(self._on_part, topic), qos)

    def _on_part(self, topic: str, message: CameraInfo | Image) -> None:
        self.health.frames_in += topic == 'views'
        _, check, _ = _INPUTS[topic]
        check(message)
        stamp = conversions.header_from(message.header).stamp_ns
        complete = self._matching.add(topic, stamp, message)
        if complete:
            self._build(*complete)

    def _build(self, camera_info: CameraInfo, pupil: Image, views: Image) -> None:
        began = time.monotonic()
        if not any(each.get_subscription_count()
                   for each in (self._volume, self._edges, self._depth, self._layers)):
            self.dropped('views: nobody listens to dlv')
            return
        light_field = conversions.light_field_from(camera_info, pupil, views)
        volume = build_volume(light_field, self._settings)
        if self._volume.get_subscription_count():
            self._volume.publish(conversions.volume_to_message(volume, self._buffers['volume']))
        if volume.edges is not None and self._edges.get_subscription_count():
            self._edges.publish(conversions.edges_to_message(volume.edges, self._buffers['edges']))
        if self._depth.get_subscription_count():
            self._depth.publish(conversions.depth_to_message(volume, self._buffers['depth']))
        if self._layers.get_subscription_count():
            picture = layers_picture(volume.layers(), self._settings.near, self._settings.far)
            self._layers.publish(conversions.picture_to_message(volume.header, picture,
                                                                self._buffers['layers']))
        self.health.done(time.monotonic() - began)


def main() -> int:
    """Entry point."""
    return run(DlvNode)


if __name__ == '__main__':
    sys.exit(main())
