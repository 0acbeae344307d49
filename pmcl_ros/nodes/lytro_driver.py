"""Camera -> RawFrame: takes pictures and publishes each of them once."""

import sys
import time
from concurrent.futures import Future as Job
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from threading import Lock
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.task import Future
from sensor_msgs.msg import Image
from std_msgs.msg import String
from std_srvs.srv import Trigger

from pmcl_ros.camera.client import Picture, PictureQueue
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.camera.packing import unpack12
from pmcl_ros.camera.raw_frame import RawFrame
from pmcl_ros.camera.sources import CameraSettings, NoMorePictures, open_camera
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.messages.raw_frame import raw_frame_to_messages
from pmcl_ros.messages.types import Buffer
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, StageNode
from pmcl_ros.nodes.runtime.running import run
from pmcl_ros.nodes.runtime.shared_memory import standstill
from pmcl_ros.nodes.transport.deferred_publisher import DISCOVERY
from pmcl_ros.nodes.transport.values import ValuePublisher
from pmcl_ros.runtime.errors import CameraError, LinkError, PmclError
from pmcl_ros.runtime.resources import resolve

_LOOK = 2.0  # s between two looks for pictures that nobody here asked for, or that got lost
_LONGEST = 30.0  # s between two when the camera does not answer
_STATUS = 30.0  # s between two questions for the battery
_ARRIVAL = 5.0  # s
_ENDED = 'the node was deactivated meanwhile: the picture is published when it is active again'
_INACTIVE = 'lytro_driver is not active: activate it first'
_NOTHING: 'Job[Any]' = Job()
_NOTHING.set_result(None)


class LytroDriver(StageNode):
    """Publishes `metadata`, then `image_raw`, for each picture: stamp, the time of its shutter.

    Pictures are taken on `~/capture`, on a timer, or by hand. A download takes seconds: it runs on
    a thread of its own, which alone uses the camera, so that the node answers meanwhile.
    """

    name = 'lytro_driver'
    settings_class = CameraSettings

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._streaming = False
        self._answered = self.create_guard_condition(lambda: None)  # wakes the executor
        self._publishing = Lock()  # whoever has it knows whether the node is active, and stays so
        # There in every state, as an answer may take longer than the node is active. In a group of
        # its own: while it waits nothing else of its group runs.
        self.create_service(Trigger, '~/capture', self._asked,
                            callback_group=MutuallyExclusiveCallbackGroup())

    def set_up(self, settings: CameraSettings) -> None:
        """Connect to the camera."""
        names = ('path',) if settings.source == 'files' else ('token_file',)
        paths = {name: str(resolve(value, name)) for name in names
                 if (value := getattr(settings, name)) or name == 'path'}
        self._settings = settings
        # First, to go last: the thread has ended by then.
        self._metadata = self.publisher(String, 'metadata', LATCHED)
        self._image = ValuePublisher(self, Image, 'image_raw', BIG, _image_of)
        self._thread = ThreadPoolExecutor(1, thread_name_prefix='camera')
        self.configured.callback(self._thread.shutdown, cancel_futures=True)
        self._camera = open_camera(settings.model_copy(update=paths))
        self.configured.callback(self._camera.close)  # first: what waits for it gives up
        self._queue = PictureQueue(self._camera)
        self._details: dict[str, object] = {'source': settings.source}
        self._failures, self._next_look = 0, 0.0
        self._ask_status()

    def start(self) -> None:
        """Publish what is taken from now on, and what was taken while the node was inactive."""
        self.health.hardware_id, self.health.extra = self._serial, self._details
        self._found_by = time.monotonic() + DISCOVERY
        self._streaming = True
        self.active.callback(self._stop)
        self._looking: Job[Any] = _NOTHING
        self._capturing: Job[Any] = _NOTHING
        self.every(_LOOK / 4, self._look_if_due)
        self._timer = None
        if self._settings.period > 0:
            self._timer = self.every(self._settings.period, self._due)

    def _stop(self) -> None:
        with self._publishing:
            self._streaming = False

    # on the node's thread

    async def _asked(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._streaming:
            response.message = _INACTIVE
            return response
        answer = Future()
        self._thread.submit(self._capture).add_done_callback(partial(self._answer, answer))
        response.success, response.message = await answer
        return response

    def _answer(self, answer: Future, job: 'Job[tuple[bool, str]]') -> None:
        if job.cancelled():
            answer.set_result((False, _INACTIVE))
        elif (error := job.exception()) is not None:
            answer.set_result((False, f'unexpected error: {error!r}'))
        else:
            answer.set_result(job.result())
        self._answered.trigger()

    def _due(self) -> None:
        if self._capturing.done():
            self._capturing = self._thread.submit(self._capture)
        else:
            self.dropped('a capture: the one before it is on its way; set a longer period')

    def _look_if_due(self) -> None:
        if self._looking.done() and time.monotonic() >= self._next_look:
            self._looking = self._thread.submit(self._look)

    # on the camera's thread

    def _capture(self) -> tuple[bool, str]:
        with self.watched('capture') as problems:
            if not self._streaming:  # it had to wait for what was before it
                return False, _INACTIVE
            try:
                message = self._deliver(self._camera.capture())
                return message != _ENDED, message
            except NoMorePictures as end:
                if self._timer is not None:
                    with suppress(InvalidHandle):  # it ended with the node's activity
                        self._timer.cancel()
                    self.get_logger().info(str(end))
                return False, str(end)
            except LinkError:
                if self._streaming:
                    raise
                return False, _ENDED
        return False, problems[0]

    def _look(self) -> None:
        """Publish what waits on the card; come back later and later while there is no answer."""
        with self.watched('camera'):
            try:
                for picture in self._queue.waiting():
                    self._deliver(picture)
                if time.monotonic() >= self._next_status:
                    self._ask_status()
                if self._failures:
                    self.get_logger().info('the camera answers again')
                    self.health.recovered()
                self._failures, self._details['link'] = 0, 'up'
            except LinkError:
                self._failures, self._details['link'] = self._failures + 1, 'lost'
                if self._streaming:
                    raise
            finally:
                pause = min(_LOOK * 2 ** min(self._failures, 9), _LONGEST)  # 9: no overflow
                self._next_look = time.monotonic() + pause

    def _deliver(self, picture: Picture) -> str:
        """Fetch and publish a picture; one that is no picture is given up in the end."""
        if not self._streaming:
            return _ENDED
        began = time.monotonic()
        frame = self._fetch(picture)
        self._await_listener()
        patience = Duration(seconds=_ARRIVAL)
        with self._publishing:
            if not self._streaming:
                return _ENDED
            self._metadata.publish(String(data=frame.metadata.text))
        # Before the picture: topics are in no order, and a lost message comes again after 3 s.
        received = self._metadata.wait_for_all_acked(patience)
        with self._publishing:
            if not self._streaming:
                return _ENDED
            heard = self._image.wanted()
            self._image.publish(frame)
            self._queue.done(picture)
            self.health.frames_in += 1
            self.done(time.monotonic() - began, f'published {picture.id} as capture '
                      f'{picture.shutter_ns}')
        # The next may follow at once, and the histories of the topics have room for one.
        received = received and self._image.arrived(patience)
        if not (heard and received):
            self._tell_unheard(picture, heard)
        if self._settings.delete:
            self._delete(picture, received and heard)
        return f'published {picture.id} with stamp {picture.shutter_ns}'

    def _fetch(self, picture: Picture) -> RawFrame:
        """The picture; LinkError, or CameraError where what comes is no picture."""
        began = time.monotonic()
        try:
            raw, text = self._camera.fetch(picture)
            seconds = time.monotonic() - began
            metadata = CameraMetadata.parse(text)
            counts = unpack12(raw, metadata.image.width, metadata.image.height)
            header = Header(picture.shutter_ns, self._settings.frame_id)
            header_to_message(header)  # refuses a time that no message can hold
            frame = RawFrame(header, counts, metadata)
        except LinkError:
            raise
        except PmclError as error:  # its own fault, or another client's that uses the camera too
            what = 'is given up' if self._queue.failed(picture) else 'will be tried again'
            raise CameraError(f'picture {picture.id}: {error}; it {what}') from error
        self._details['last download [s]'] = f'{seconds:.2f}'
        self._details['last download [MB/s]'] = f'{len(raw) / seconds / 1e6:.1f}'
        return frame

    def _tell_unheard(self, picture: Picture, heard: bool) -> None:
        """Log that a picture reached nobody, or not everybody.

        heard: image_raw has subscribers. One may have got it then; one that was killed is a while
        in getting it.
        """
        why = (f'not everybody who listens to image_raw got it within {_ARRIVAL:g} s' if heard
               else 'image_raw has no subscriber')
        why = '; '.join(filter(None, (why, standstill())))
        self.dropped(f'capture {picture.shutter_ns}: {why}', int(not heard))

    def _await_listener(self) -> None:
        """Soon after activation it may not have been found yet, and would miss the picture."""
        while (self._streaming and not self._image.wanted()
               and time.monotonic() < self._found_by):
            time.sleep(0.05)

    def _delete(self, picture: Picture, received: bool) -> None:
        if not received:
            self.get_logger().warning(f'{picture.id} stays on the camera: nobody received it')
            return
        with self.watched('delete'):  # the picture was published all the same
            self._camera.delete(picture)

    def _ask_status(self) -> None:
        status = self._camera.status()
        self._serial = status.serial
        if status.firmware:
            self._details['firmware'] = status.firmware
        if status.battery is not None:
            self._details['battery [%]'] = f'{status.battery:.0f}'
        self._next_status = time.monotonic() + _STATUS


def _image_of(frame: RawFrame, buffer: Buffer) -> Image:
    return raw_frame_to_messages(frame, buffer).image


def main() -> int:
    """Entry point."""
    return run(LytroDriver)


if __name__ == '__main__':
    sys.exit(main())
