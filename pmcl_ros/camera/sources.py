"""CameraSettings -> CameraClient: the camera of `lytro_driver`; pictures on disk as a camera."""

import time
from collections import deque
from pathlib import Path
from typing import Literal

from pydantic import Field

from pmcl_ros.camera.client import CameraClient, CameraStatus, Picture
from pmcl_ros.camera.files import list_pictures, read_metadata, read_picture
from pmcl_ros.camera.gateway.client import GatewayClient
from pmcl_ros.camera.gateway.settings import GatewaySettings, read_token
from pmcl_ros.camera.lytro.address import Address, LinkSettings, find_camera
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.runtime.errors import CameraError, SettingsError
from pmcl_ros.runtime.settings import Settings

Source = Literal['wifi', 'gateway', 'files']
_LINK = LinkSettings()
_KEPT = 100  # pictures of files that may wait to be published; a loop takes them without end


class CameraSettings(Settings):
    """Pictures -> RawFrame."""

    source: Source = Field('wifi', description='source of pictures: wifi, a Lytro whose '
                           'network this machine has joined; gateway, a Lytro behind another '
                           'machine (pmcl camera gateway); files')
    address: str = Field(Address().host, min_length=1, description='wifi: HOST[:PORT'
                         '[:CALLBACK_PORT]] of the camera, or mdns: the one that announces itself')
    gateway: str = Field('', description='gateway: its address, http://HOST:PORT')
    token_file: str = Field('', description='gateway: path of the file with its token; empty: '
                            'no token')
    path: str = Field('', description='files: path of a .RAW or .RAW.xz picture with its .TXT '
                      'beside it, of an .LFP, or of a folder of pictures')
    loop: bool = Field(False, description='files: start again after the last picture')
    delete: bool = Field(False, description='wifi: delete each picture from the camera after '
                         'publishing it')
    picture_timeout: float = Field(
        _LINK.picture_timeout, gt=0, le=3600, description='wifi: longest time from the capture '
        'command until the picture is available [s]')
    patience: float = Field(
        _LINK.patience, gt=0, le=3600, description='wifi and gateway: retry after lost '
        'connections until nothing was received for this time [s]')
    period: float = Field(0.0, ge=0, le=86400, description='interval between pictures [s]; '
                          '0: only when ~/capture is called')
    frame_id: str = Field('lytro_optical_frame', min_length=1, description='name of the optical '
                          'frame of the camera (x right, y down, z forward)')


class NoMorePictures(CameraError):  # noqa: N818 -- the end of a folder, no failure
    """All pictures of the folder are published."""


class FileCamera:
    """A `CameraClient` that takes the pictures on disk one after the other.

    path: a picture or a folder. loop: start again after the last picture.
    Raises CameraError when there is no picture.
    """

    def __init__(self, path: Path | str, loop: bool = False) -> None:
        self._folder, self._paths, self._loop = path, list_pictures(path), loop
        self._count = 0
        self._taken: deque[Picture] = deque(maxlen=_KEPT)

    def status(self) -> CameraStatus:
        """The serial number of the first picture's camera."""
        return CameraStatus(read_metadata(self._paths[0]).serial, '', None)

    def pictures(self) -> list[Picture]:
        """The last pictures taken, 100 at most, oldest first."""
        return list(self._taken)

    def capture(self) -> Picture:
        """Take the next picture, stamped with the present time; NoMorePictures after the last."""
        count = self._count
        if count == len(self._paths) and not self._loop:
            raise NoMorePictures(f'all {count} pictures of {self._folder} are published; set loop '
                                 'to begin again')
        path = self._paths[count % len(self._paths)]
        self._count += 1
        self._taken.append(Picture(f'{self._count} {path.name}', time.time_ns()))
        return self._taken[-1]

    def fetch(self, picture: Picture) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON)."""
        number = int(picture.id.partition(' ')[0]) - 1
        return read_picture(self._paths[number % len(self._paths)])

    def delete(self, picture: Picture) -> None:
        """Do nothing: files are never deleted."""

    def close(self) -> None:
        """Do nothing: no file is open."""


def open_camera(settings: CameraSettings) -> CameraClient:
    """Connect to the camera of `settings.source`.

    Raises CameraError when the camera cannot be reached, SettingsError for an invalid address or
    an option that the source does not support.
    """
    if settings.delete and settings.source == 'gateway':
        raise SettingsError('a gateway deletes no pictures: set delete to false, and use `pmcl '
                            'camera capture --download all --delete` where the gateway runs')
    if settings.source == 'files':
        return FileCamera(settings.path, settings.loop)
    if settings.source == 'gateway':
        token = read_token(settings.token_file) if settings.token_file else None
        return GatewayClient(settings.gateway, token, GatewaySettings(patience=settings.patience))
    link = LinkSettings(patience=settings.patience, picture_timeout=settings.picture_timeout)
    return LytroClient(find_camera(settings.address), link)
