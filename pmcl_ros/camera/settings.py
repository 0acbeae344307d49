"""Parameters of the camera."""

from pydantic import Field

from pmcl_ros.settings import Settings


class CameraSettings(Settings):
    """Pictures -> RawFrame."""

    source: str = Field('', description='path of a .RAW or .RAW.xz picture with its .TXT beside '
                        'it, or of a folder of such')
    period: float = Field(0.0, ge=0, le=86400, description='time from picture to picture [s]; '
                          '0: only when ~/capture is called')
    loop: bool = Field(False, description='begin again after the last picture')
    frame_id: str = Field('lytro_optical_frame', min_length=1, description='name of the optical '
                          'frame of the camera (x right, y down, z forward)')
