"""The driver's camera: its settings, pictures on disk as a camera, and how to open one."""

import time
from pathlib import Path
from typing import Literal

from pydantic import Field

from pmcl_ros.camera.client import CameraClient, CameraStatus, Picture
from pmcl_ros.camera.files import list_pictures, read_metadata, read_picture
from pmcl_ros.camera.gateway.client import GatewayClient
from pmcl_ros.camera.gateway.settings import GatewaySettings, read_token
from pmcl_ros.camera.lytro.address import LinkSettings, find_camera
from pmcl_ros.camera.lytro.client import LytroClient
from pmcl_ros.runtime.errors import CameraError, SettingsError
from pmcl_ros.runtime.settings import Settings

Source = Literal['wifi', 'gateway', 'files']


class CameraSettings(Settings):
    """Pictures -> RawFrame."""

    source: Source = Field('wifi', description='where pictures come from: wifi, a Lytro in '
                           'whose network this machine is; gateway, one that another machine '
                           'reaches (pmcl camera gateway); files')
    address: str = Field('10.100.1.1', min_length=1, description='wifi: HOST[:PORT'
                         '[:CALLBACK_PORT]] of the camera, or mdns: the one that announces itself')
    gateway: str = Field('', description='gateway: its address, http://HOST:PORT')
    token_file: str = Field('', description='gateway: path of the file that holds its token; '
                            'empty: it wants none')
    path: str = Field('', description='files: path of a .RAW or .RAW.xz picture with its .TXT '
                      'beside it, of an .LFP, or of a folder of such')
    loop: bool = Field(False, description='files: begin again after the last picture')
    delete: bool = Field(False, description='wifi: delete each picture from the camera once it is '
                         'published')
    picture_timeout: float = Field(30.0, gt=0, le=3600, description='wifi: from the command to '
                                   'take a picture until it can be downloaded [s]')
    patience: float = Field(20.0, gt=0, le=3600, description='wifi and gateway: reconnect and try '
                            'again until nothing has come for so long [s]')
    period: float = Field(0.0, ge=0, le=86400, description='time from picture to picture [s]; '
                          '0: only when ~/capture is called')
    frame_id: str = Field('lytro_optical_frame', min_length=1, description='name of the optical '
                          'frame of the camera (x right, y down, z forward)')


class NoMorePictures(CameraError):  # noqa: N818 -- the end of a folder, no failure
    """The last picture has been taken."""


class FileCamera:
    """A `CameraClient` whose card is `path`, a picture or a folder of them.

    loop: begin again after the last. Raises CameraError when there is none.
    """

    def __init__(self, path: Path | str, loop: bool = False) -> None:
        self._folder, self._paths, self._loop = path, list_pictures(path), loop
        self._taken: list[Picture] = []

    def status(self) -> CameraStatus:
        """The serial number of the first picture's camera."""
        return CameraStatus(read_metadata(self._paths[0]).serial, '', None)

    def pictures(self) -> list[Picture]:
        """What has been taken, oldest first."""
        return list(self._taken)

    def capture(self) -> Picture:
        """The next picture's shutter is pressed now; NoMorePictures after the last."""
        count = len(self._taken)
        if count == len(self._paths) and not self._loop:
            raise NoMorePictures(f'all {count} pictures of {self._folder} are published; set loop '
                                 'to begin again')
        path = self._paths[count % len(self._paths)]
        self._taken.append(Picture(f'{count + 1} {path.name}', time.time_ns()))
        return self._taken[-1]

    def fetch(self, picture: Picture) -> tuple[bytes, str]:
        """The .RAW (12 bits, packed) and the .TXT (JSON)."""
        number = int(picture.id.partition(' ')[0]) - 1
        return read_picture(self._paths[number % len(self._paths)])

    def delete(self, picture: Picture) -> None:
        """Nothing: the files stay."""

    def close(self) -> None:
        """Nothing is open."""


def open_camera(settings: CameraSettings) -> CameraClient:
    """Connect to the camera of `settings.source`.

    Raises CameraError when it cannot be reached, SettingsError when its address is none,
    or it cannot do what they ask.
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
