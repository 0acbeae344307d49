"""A Lytro on the network: commands, callbacks, downloads that survive lost connections."""

import logging
import threading
import time
from datetime import datetime, timedelta, timezone

from pmcl_ros.camera.client import CameraStatus, Picture
from pmcl_ros.camera.lytro import protocol
from pmcl_ros.camera.lytro.address import Address, LinkSettings
from pmcl_ros.camera.lytro.events import (
    NEW_PICTURE,
    SHUTTER_PRESSED,
    Arrivals,
    CallbackListener,
    Event,
    Shot,
)
from pmcl_ros.camera.lytro.link import Link
from pmcl_ros.camera.lytro.protocol import (
    Command,
    HardwareInfo,
    PictureRecord,
    Request,
    decode_battery,
    decode_files,
    decode_picture_list,
    decode_time,
)
from pmcl_ros.camera.metadata import CameraMetadata
from pmcl_ros.runtime.closing import Closing
from pmcl_ros.runtime.errors import CameraError, LinkError
from pmcl_ros.runtime.progress import BytesProgress

_PAUSE = 0.2  # seconds between two requests of the picture list

_LOG = logging.getLogger(__name__)


class LytroClient(Closing):
    """A `CameraClient` by the camera's own protocol; usable from several threads.

    The constructor raises LinkError when nobody answers. Later, methods reconnect and retry for
    `settings.patience`, then raise LinkError; other errors are CameraError. Two threads listen to
    the callbacks and keep the camera's Wi-Fi on.
    Only documented commands are sent: no unlock, exposure or ISO.
    """

    def __init__(self, address: Address, settings: LinkSettings | None = None) -> None:
        self._address, self._settings = address, settings or LinkSettings()
        self._arrivals = Arrivals()
        self._closed = threading.Event()
        self._link = Link(self._address, self._settings)
        self._listener: CallbackListener | None = None
        self._keeper = threading.Thread(target=self._keep_alive, name='lytro keep-alive',
                                        daemon=True)
        try:
            self._link.open()
            self._known = self._link.made
            self._info = self.hardware_info()
            self._compare_clocks()
            self._listener = CallbackListener(self._address, self._settings, self._heard,
                                              self._arrivals.callbacks)
            pictures = self.pictures()
        except BaseException:
            self.close()
            raise
        _LOG.info('Lytro %s (%s) at %s, %d pictures', self._info.serial, self._info.software,
                  self._address, len(pictures))
        self._keeper.start()

    # CameraClient

    def status(self) -> CameraStatus:
        """Serial number, software version, and the present charge of the battery."""
        return CameraStatus(self._info.serial, self._info.software, self.battery())

    def pictures(self) -> list[Picture]:
        """The complete pictures on the card, oldest first.

        `shutter_ns` is the arrival of the ShutterPressed callback, or else the time just before
        the command was sent. If this client saw neither, it is the camera's date minus the
        difference of the two clocks, accurate to about a second.
        """
        return self._arrivals.listed(self.records())

    def capture(self) -> Picture:
        """Take a picture; returns when it can be fetched. CameraError when none comes."""
        return self.wait_for_picture(self.take_picture())

    def fetch(self, picture: Picture, progress: BytesProgress | None = None) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON).

        The text must be a camera's metadata, and the .RAW of the length that it states.
        progress: of the .RAW.
        """
        record = self.record(picture)
        path = record.path('TXT')
        try:
            text = self.download(path).rstrip(b'\0').decode()
            image = CameraMetadata.parse(text).image
        except UnicodeDecodeError:
            raise CameraError(f'{path} of the camera is not text') from None
        except LinkError:
            raise
        except CameraError as error:
            raise CameraError(f'{path} of the camera: {error}') from None
        path = record.path('RAW')
        raw = self._link.load(protocol.load_file(path), path, image.width * image.height * 3 // 2,
                              progress)
        return raw, text

    def close(self) -> None:
        """End threads and connections; calls that wait in other threads raise LinkError."""
        self._closed.set()
        self._link.close()
        self._arrivals.callbacks(False)  # wakes threads that wait for a picture
        if self._listener is not None:
            self._listener.close()
        if self._keeper.is_alive():
            self._keeper.join(self._settings.timeout)

    # more

    def hardware_info(self) -> HardwareInfo:
        """Identity of the camera."""
        return HardwareInfo.decode(self._link.load(protocol.LOAD_HARDWARE_INFO, 'hardware info'))

    def battery(self) -> float:
        """Percent."""
        return decode_battery(self._link.ask(protocol.BATTERY))

    def camera_time(self) -> datetime:
        """The camera's clock, UTC; a real camera's has a resolution of a second."""
        return decode_time(self._link.ask(protocol.CAMERA_TIME))

    def records(self) -> list[PictureRecord]:
        """The picture list, newest first; LinkError when another camera answers now."""
        listed = self._link.load(protocol.LOAD_PICTURE_LIST, 'the picture list', grows=True)
        if (made := self._link.made) != self._known:
            self._recognize()
            self._known = made
        return decode_picture_list(listed)

    def record(self, picture: Picture) -> PictureRecord:
        """The record of a picture; CameraError when it is not on the card."""
        for record in self.records():
            if record.id == picture.id:
                return record
        raise CameraError(f'the camera has no picture {picture.id} (any more)')

    def calibration(self) -> dict[str, bytes]:
        """The camera's calibration files, path -> content."""
        return decode_files(self._link.load(protocol.LOAD_CALIBRATION, 'the calibration'))

    def download(self, path: str) -> bytes:
        r"""A file by its path on the camera (I:\DCIM\100PHOTO\IMG_0001.RAW)."""
        return self._link.load(protocol.load_file(path), path)

    def take_picture(self) -> Shot:
        """Press the shutter without waiting for the picture.

        The command is sent once: where its reply is lost, the picture may have been taken.
        """
        self.battery()  # detects and replaces a dead connection before the command
        shot = self._arrivals.commanded(time.time_ns())
        try:
            self._link.ask_once(protocol.TAKE_PICTURE)
        except LinkError as error:
            _LOG.warning('a picture may have been taken: %s', error)
        except BaseException:
            self._arrivals.given_up(shot)
            raise
        return shot

    def wait_for_picture(self, shot: Shot) -> Picture:
        """The picture of `shot`; CameraError when none comes within the picture timeout."""
        seconds = self._settings.picture_timeout
        deadline = time.monotonic() + seconds
        while True:
            last = time.monotonic() >= deadline
            if last or self._arrivals.pending:
                records = self.records()
                self._arrivals.listed(records, all_complete=last)
            if shot.picture is not None:
                return shot.picture
            if last:
                break
            if self._arrivals.pending:
                self._closed.wait(_PAUSE)
            else:
                self._arrivals.wait(max(0.0, deadline - time.monotonic()))
        self._arrivals.given_up(shot)
        heard = 'pressed the shutter' if shot.pressed_ns else 'did not press the shutter'
        raise CameraError(
            f'no picture within {seconds:g} s of the command; the camera {heard} and holds '
            f'{len(records)} pictures: it is busy, or its memory is full (delete some), or '
            'it is in a menu')

    def delete(self, picture: Picture) -> None:
        """Delete a picture from the card; CameraError when it stays in the list."""
        self._link.ask(Request(Command.DELETE_PICTURE, self.record(picture).key))
        deadline = time.monotonic() + self._settings.timeout
        while picture.id in {each.id for each in self.records()}:
            if time.monotonic() > deadline:
                raise CameraError(f'the camera keeps {picture.id} despite the delete command; '
                                  'delete it on the camera')
            self._closed.wait(_PAUSE)

    def _recognize(self) -> None:
        """Check the serial number: all cameras have one address, another one may answer now."""
        serial = self.hardware_info().serial
        if serial != self._info.serial:
            raise LinkError(f'camera {serial} answers at {self._address}, where '
                            f'{self._info.serial} was: connect to it anew, or bring that one back')

    def _heard(self, event: Event) -> None:
        """Record an event; runs in the thread of the callbacks."""
        _LOG.debug('%s', event)
        if event.name == SHUTTER_PRESSED:
            self._arrivals.pressed(event.arrived_ns)
        elif event.name == NEW_PICTURE and event.arguments:
            self._arrivals.announced(event.arguments[0])

    def _compare_clocks(self) -> None:
        before = time.time_ns()
        camera = self.camera_time()
        host = datetime.fromtimestamp((before + time.time_ns()) / 2e9, timezone.utc)
        self._arrivals.clock_ahead_ns = 1000 * ((camera - host) // timedelta(microseconds=1))

    def _keep_alive(self) -> None:
        interval = self._settings.keep_alive
        while not self._closed.wait(interval / 5):
            if time.monotonic() - self._link.last_exchange > interval:
                try:
                    self.battery()
                except CameraError as error:
                    _LOG.warning('the camera may turn its Wi-Fi off: %s', error)
