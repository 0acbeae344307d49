"""Cameras at a simulated wrist: each takes pictures of scenes and publishes them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String

from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.drawing.pictures import write_png
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.messages.camera_info import pinhole_to_message
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import picture_from, picture_to_message
from pmcl_ros.messages.raw_frame import raw_frame_to_messages
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL
from pmcl_ros.runtime.errors import OutputError
from pmcl_ros.simulation.lytro.camera import F01_RAW, LytroCamera
from pmcl_ros.simulation.lytro.centre_view import centre_view
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.manipulation.camera_kinds import load_camera
from pmcl_ros.simulation.ordinary_camera import take_picture
from pmcl_ros.simulation.path_tracing.render import physical, physical_along
from pmcl_ros.simulation.scenes.rays import fast_along
from pmcl_ros.simulation.scenes.render import fast
from pmcl_ros.simulation.scenes.scene import Scene

RENDERERS = {'fast': (fast, fast_along), 'physical': (physical, physical_along)}


class WristEye(Protocol):
    """A camera."""

    def shoot(self, scene: Scene, header: Header, file: Path) -> None:
        """Take a picture, publish it, and keep what is searched for the object as a PNG.

        scene: its sensor is the camera's. header: of the picture's messages.
        """


def keep_picture(node: Node, file: Path, picture: NDArray[np.uint8]) -> None:
    """Write a PNG of (height, width, 3) RGB, or log why not: the trial goes on without it."""
    try:
        write_png(file, picture)
    except OutputError as error:
        node.get_logger().error(str(error))


class PinholeEye:
    """Publishes `image` and `camera_info`, as the driver of an ordinary camera.

    take: (height, width, 3) RGB, 8 bits, of a scene.
    """

    def __init__(self, node: Node, pinhole: Pinhole,
                 take: Callable[[Scene], NDArray[np.uint8]]) -> None:
        self._node, self._pinhole, self._take = node, pinhole, take
        self._info = node.create_publisher(CameraInfo, 'camera_info', SMALL)
        self._image = node.create_publisher(Image, 'image', SMALL)

    def shoot(self, scene: Scene, header: Header, file: Path) -> None:
        """As `WristEye`."""
        picture = self._take(scene)
        keep_picture(self._node, file, picture)
        self._info.publish(pinhole_to_message(header, self._pinhole))
        self._image.publish(picture_to_message(header, picture))


class RawEye:
    """Publishes `metadata` and `image_raw`, as lytro_driver; keeps what `center/image` shows."""

    def __init__(self, node: Node, take: Callable[[Scene], RawFrame]) -> None:
        self._node, self._take = node, take
        self._files: dict[int, Path] = {}
        self._metadata = node.create_publisher(String, 'metadata', LATCHED)
        self._image = node.create_publisher(Image, 'image_raw', BIG)
        node.create_subscription(Image, 'center/image', self._on_centre, SMALL)

    def shoot(self, scene: Scene, header: Header, file: Path) -> None:
        """As `WristEye`; the PNG is written once the picture has been decoded."""
        self._files[header.stamp_ns] = file
        metadata, image = raw_frame_to_messages(replace(self._take(scene), header=header))
        self._metadata.publish(metadata)
        self._image.publish(image)

    def _on_centre(self, message: Image) -> None:
        file = self._files.pop(header_from(message.header).stamp_ns, None)
        if file is not None:
            keep_picture(self._node, file, picture_from(message))


def wrist_eye(node: Node, name: str, rng: np.random.Generator, samples: int, renderer: str
              ) -> WristEye:
    """The camera that `load_camera` knows by this name.

    rng: of its noise. samples: rays, or paths, of a pixel; of F01_RAW, of a raw pixel. renderer:
    of RENDERERS.
    """
    camera, (views, along) = load_camera(name), RENDERERS[renderer]
    if not isinstance(camera, LytroCamera):
        return PinholeEye(node, camera.pinhole,
                          lambda scene: take_picture(scene, camera, rng, samples, views))
    if name == F01_RAW:
        return RawEye(node, lambda scene: raw_picture(camera, along(scene), rng, samples,
                                                      scene.sensor.level))
    return PinholeEye(node, camera.calibration.pinhole,
                      lambda scene: centre_view(scene, camera, rng, samples, views))
