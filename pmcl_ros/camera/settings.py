"""Parameters of the camera."""

from typing import Literal

from pydantic import Field

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
