"""Parameters of the node that joins the pictures of cameras at rest."""

from typing import Annotated

from pydantic import Field, model_validator

from pmcl_ros.lightfield.readers.pictures import Bits
from pmcl_ros.lightfield.view_fields import (
    Common,
    Gamma,
    Reliable,
    Shrink,
    SigmaPosition,
    SigmaRotation,
)
from pmcl_ros.runtime.settings import Settings

_Name = Annotated[str, Field(pattern=r'^/?[A-Za-z]\w*(/[A-Za-z]\w*)*$')]
_MOST_CAMERAS = 9  # as many views as searches were measured with


class FixedCameraSettings(Settings):
    """Images of several cameras at rest -> PosedViews."""

    cameras: tuple[_Name, ...] = Field(
        ('left', 'right'), min_length=1, max_length=_MOST_CAMERAS, description='the cameras: of '
        'each NAME the topics NAME/image_raw (where rectified, NAME/image_rect) and '
        'NAME/camera_info. All views have the pinhole of the first one')
    compressed: bool = Field(False, description='take CompressedImage (JPEG, PNG), from '
                             'NAME/image_raw/compressed or NAME/image_rect/compressed')
    rectified: bool = Field(False, description='the images are rectified: P of camera_info '
                            'applies')
    reliable: Reliable = True
    camera_poses: str = Field('', description='path of a YAML file with `poses` of `cameras`, in '
                              'their order: optical frame to fixed_frame, 16 numbers each; empty: '
                              'by camera_mounts')
    camera_mounts: tuple[float, ...] = Field(
        (0.0,), description='poses of `cameras` as pmcl handeye writes them: x, y, z [m] and '
        'roll, pitch, yaw as in URDF [rad] of each, in fixed_frame; 0 alone: the newest '
        'transforms on /tf, of the frames that the images name')
    fixed_frame: str = Field('base_link', min_length=1, description='fixed frame of the poses')
    masks: tuple[str, ...] = Field(
        ('',), description='paths of pictures of the size of the images, one for each of '
        '`cameras`, in their order: black where all images of a camera show no part of the scene, '
        'as its mount or the robot; empty: nowhere')
    slop: float = Field(0.01, ge=0, le=10, description='largest difference of the stamps of one '
                        'set of pictures; less than half the time between two sets [s]')
    patience: float = Field(1.0, gt=0, le=100, description='longest wait of a picture for those '
                            'of the other cameras [s]')
    period: float = Field(0.0, ge=0, le=1000, description='shortest time between two sets that '
                          'are published; 0: all are [s]')
    sigma_position: SigmaPosition = 0.001
    sigma_rotation: SigmaRotation = 0.0035
    common: Common = 0.0
    shrink: Shrink = 1
    gamma: Gamma = 2.2
    bits: Bits = 16

    @model_validator(mode='after')
    def _different(self) -> 'FixedCameraSettings':
        if len(set(self.cameras)) < len(self.cameras):
            raise ValueError(f'cameras {", ".join(self.cameras)}: one is named twice')
        if self.mounted and self.camera_poses:
            raise ValueError('camera_poses and camera_mounts both say where the cameras are: '
                             'leave one of them out')
        if self.mounted and len(self.camera_mounts) != 6 * len(self.cameras):
            raise ValueError(f'camera_mounts has {len(self.camera_mounts)} numbers, expected 6 '
                             f'for each of {len(self.cameras)} cameras '
                             f'({", ".join(self.cameras)})')
        if any(self.masks) and len(self.masks) != len(self.cameras):
            raise ValueError(f'masks has {len(self.masks)} paths, expected one for each of '
                             f'{len(self.cameras)} cameras ({", ".join(self.cameras)}); one of a '
                             'camera without a mask is empty')
        return self

    @property
    def mounted(self) -> bool:
        """Whether camera_mounts says where the cameras are."""
        return self.camera_mounts != (0.0,)
