"""Images of a camera that sees a printed board -> camera_pose."""

import sys
import time
from typing import Any

import cv2
import numpy as np
from geometry_msgs.msg import PoseStamped
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import inverse
from pmcl_ros.lightfield.board_camera import BoardCamera, BoardNodeSettings
from pmcl_ros.lightfield.sweep.frame import Lens
from pmcl_ros.messages.camera_info import lens_from
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.pose import pose_to_message, pose_to_transform
from pmcl_ros.nodes.camera_input import (
    Picture,
    Silence,
    pixels_from,
    stamped,
    subscribe_camera,
)
from pmcl_ros.nodes.runtime.base import MANY, StageNode
from pmcl_ros.nodes.runtime.repeated_lines import RepeatedLines
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.transforms import transforms_class
from pmcl_ros.runtime.errors import LightFieldError, MessageError

_LOOK = 1.0  # s between two looks whether pictures come


class BoardNode(StageNode):
    """Publishes where the camera was at each picture that shows the board.

    Of pictures that come faster than boards are found, the newest is taken.
    """

    name = 'board_node'
    settings_class = BoardNodeSettings

    def set_up(self, settings: BoardNodeSettings) -> None:
        """Read what the board is."""
        self._settings, self._board = settings, settings.board
        self._publisher = self.publisher(PoseStamped, 'camera_pose', MANY)
        self._transforms: Any = None
        if settings.broadcast_tf:
            self._transforms = transforms_class('camera_pose')
            self._tf = self.publisher(self._transforms, '/tf', MANY)
        self.get_logger().info(f'looks for the board {self._board.options}; its frame is '
                               f'{settings.fixed_frame}')

    def start(self) -> None:
        """Listen."""
        self._camera = BoardCamera(self._board)
        self._lens: Lens | None = None
        self._early: Picture | None = None  # the last picture that came without a lens
        self._lines = RepeatedLines()
        self._silence = Silence(self, [subscribe_camera(
            self, self._settings, 'image', 'camera_info', self._on_image, self._on_info,
            newest=True)])
        self.every(_LOOK, self._silence.look)

    def _on_info(self, message: CameraInfo) -> None:
        self._lens = None  # where this one is refused, the one before it is outdated
        self._lens = lens_from(message, self._settings.rectified)
        early, self._early = self._early, None
        if early is not None:
            self._find(early, self._lens)

    def _on_image(self, message: Picture) -> None:
        self._silence.broken()
        self.health.frames_in += 1
        if self._lens is not None:
            self._find(message, self._lens)
            return
        before, self._early = self._early, message  # its camera_info may be on its way
        if before is not None:
            raise MessageError('no camera_info that can be used has come on '
                               f'{self.resolve_topic_name("camera_info")}')

    def _find(self, message: Picture, lens: Lens) -> None:
        came, header = time.monotonic(), stamped(message)
        picture = pixels_from(message, self._settings.bits)
        lens.check_size(picture, 'the image')
        if picture.dtype == np.uint16:
            picture = (picture >> 8).astype(np.uint8)
        grey = np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), np.uint8)
        try:
            found = self._camera.find(grey, lens, 'the image')
        except LightFieldError as error:
            with self.health.lock:
                self.health.dropped += 1
                self._warn(header, f'no camera pose: {error}')
            return
        self._publish(header, found.at.camera)
        position, rotation = found.at.sigma_beside(self._board.points)
        with self.health.lock:
            self.health.done(time.monotonic() - came, f'corners {found.at.pixels[0]:.2f} px, '
                             f'errors {1e3 * position:.2f} mm, {np.rad2deg(rotation):.3f} degrees')
            if found.lens is not None:
                self._warn(header, f'the board fits best with {found.lens}: is camera_info that '
                           'of this camera, resolution, zoom and focus?')

    def _warn(self, header: Header, message: str) -> None:
        self.health.warn(message)
        if line := self._lines(message):
            self.get_logger().warning(f'{line} (stamp {header.stamp_ns})')

    def _publish(self, header: Header, camera: NDArray[np.float64]) -> None:
        frame = self._settings.fixed_frame
        of_board = header_to_message(Header(header.stamp_ns, frame))
        self._publisher.publish(PoseStamped(header=of_board, pose=pose_to_message(camera)))
        if self._transforms is None:
            return
        if header.frame_id in ('', frame):
            raise MessageError(f'its frame_id is {header.frame_id!r}, of which {frame!r} is no '
                               'child on /tf: let the camera driver name the optical frame, or '
                               'set broadcast_tf to false')
        board = pose_to_transform(header, inverse(camera), frame)
        self._tf.publish(self._transforms(transforms=[board]))


def main() -> int:
    """Entry point."""
    return run(BoardNode)


if __name__ == '__main__':
    sys.exit(main())
