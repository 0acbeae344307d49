"""Parameters of the pose search."""

import math
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from pmcl_ros.evidence.learned import learned_contour
from pmcl_ros.geometry.interface import Interface
from pmcl_ros.pmcl.render.back_end import BackEnd
from pmcl_ros.runtime.settings import Settings

Mode = Literal['default', 'faithful']
EvidenceKind = Literal['auto', 'edges', 'map']
WIDEST = 10.0  # m: of a region of interest
_Size = Annotated[float, Field(gt=0, le=WIDEST)]
_Depth = Annotated[float, Field(ge=0, le=10)]
_HALF_TURN = 3.1416  # rad, a little more
_Angle = Annotated[float, Field(ge=0, le=_HALF_TURN)]


class PmclSettings(Settings):
    """Evidence -> PoseEstimate."""

    mode: Mode = Field(
        'default', description='default: a global search by contour evidence. faithful: the '
        'particle filter of the paper, in light fields only. For the volume of the paper, too, '
        'set in dlv_node interpolation to phase, truncate to true, view_weights to equal')
    evidence: EvidenceKind = Field(
        'auto', description='default mode: edges of the refocused views (dlv/edges); map, the '
        'contour map of the learned network (dlv/contour_map); auto: the map of pictures of '
        'ordinary cameras; edges of light fields, and the map where these lose the object '
        'or are unsure of it (not with tracking, nor for several objects)')
    object: str = Field('', description='path of the object: a mesh, or an object YAML')
    roi_center: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.55),
        description='centre of the box that holds the origin of the object, camera frame [m]')
    roi_size: tuple[_Size, _Size, _Size] = Field(
        (0.16, 0.16, 0.16), description='size of that box [m]')
    interface_index: float = Field(
        1.0, ge=1, le=3, description='refractive index of a liquid between the camera and the '
        'object, whose surface is flat: 1.33 for water; 1: there is none')
    interface_point: tuple[float, ...] = Field(
        (0.0, 0.0, 0.0), description='any point of that surface, frame of roi_center; of a liquid '
        'that ends at several planes, as water in a tank does at its surface and its front, three '
        'numbers of each [m]')
    interface_normal: tuple[float, ...] = Field(
        (0.0, 0.0, 1.0), description='its direction towards the air, as many numbers')
    roi_depths: tuple[_Depth, _Depth] = Field(
        (0.0, 0.0), description='in place of that box: all that is in view between these two '
        'depths, of several views what all of them see; 0, 0: the box [m]')
    roi_table: tuple[float, float, float, float, float, float] = Field(
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0), description='in place of that box: what stands on a plane '
        'in view, by a point of it and its normal, which points up from the table, in the frame '
        'of the box; zeros: the box [m]')
    roi_up: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description='direction to which roi_tilt is, frame of roi_center; zeros: '
        'the normal of roi_table')
    roi_tilt: tuple[_Angle, _Angle] = Field(
        (0.0, _HALF_TURN), description='least and largest angle between roi_up and what is up of '
        'the object (up of its appearance, else its axis of symmetry, else the z axis of its '
        'mesh): 0 and 0.5 of what stands, 1.2 and 1.9 of what lies; what looks '
        'the same upside down may be either way up [rad]')
    renderer: BackEnd = Field(
        'auto', description='what draws and scores poses: gl (compute shaders), numba (the '
        'processor, without OpenGL), or auto: gl where OpenGL runs on a GPU, else numba. Posed '
        'views, contour maps and what is in water are always scored by numba')
    seed: int = Field(
        0, ge=0, le=2 ** 31 - 1,
        description='seed of the random numbers: the same seed gives the same pose')
    proposals: int = Field(
        600, ge=1, le=1000, description='default mode: poses kept from the scan of the region')
    particles: int = Field(192, ge=2, le=100_000, description='default mode: particles')
    moves: int = Field(
        3, ge=1, le=1000,
        description='default mode: moves of the particles in each round of sampling the posterior')
    least_support: float = Field(
        default_factory=lambda: learned_contour().least_support, ge=-5, le=5,
        description='default mode: mean evidence along the weakest fifth of the contour, less a '
        'nat for each pixel out of view, estimated by the share of vertices in view [nat / px]; '
        'the object is lost below it. At the default the threshold is that of the evidence in '
        'use, and several views may need more (docs/concepts/lost.md)')
    faithful_particles: int = Field(100, ge=2, le=100_000, description='faithful mode: particles')
    faithful_iterations: int = Field(
        500, ge=1, le=100_000, description='faithful mode: iterations at most')
    faithful_threshold: float = Field(
        0.01, gt=0, le=10, description='faithful mode: the search ends when the mean weight, that '
        'is the mean likelihood, passes this')
    faithful_sigma_translation: float = Field(
        0.005, gt=0, le=1, description='faithful mode: standard deviation of the '
        'perturbation along x, y, z [m]')
    faithful_sigma_rotation: float = Field(
        0.05, gt=0, le=3, description='faithful mode: standard deviation of the '
        'perturbation about x, y, z [rad]')

    @property
    def chosen_support(self) -> float | None:
        """`least_support` where it was chosen; None: that of the evidence in use."""
        return self.least_support if 'least_support' in self.model_fields_set else None

    @property
    def interface(self) -> Interface | None:
        """The surface of the liquid, if there is one."""
        if self.interface_index == 1:
            return None
        normals = np.reshape(self.interface_normal, (-1, 3))
        return Interface(np.reshape(self.interface_point, (-1, 3)),
                         normals / np.linalg.norm(normals, axis=1)[:, None],
                         self.interface_index)

    @model_validator(mode='after')
    def _directed(self) -> 'PmclSettings':
        counts = len(self.interface_point), len(self.interface_normal)
        if counts[0] != counts[1] or counts[0] % 3 or not counts[0]:
            raise ValueError('interface_point and interface_normal have three numbers of each '
                             f'plane: not {counts[0]} and {counts[1]}')
        if self.interface_index > 1 and not {
                'interface_point', 'interface_normal'} & self.model_fields_set:
            raise ValueError(f'interface_index {self.interface_index} is of a liquid: say where '
                             'it ends by interface_point and interface_normal')
        if not np.any(np.reshape(self.interface_normal, (-1, 3)), axis=1).all():
            raise ValueError('interface_normal has no direction')
        return self

    @property
    def region_in_view(self) -> bool:
        """Whether the region of interest follows from what the cameras see."""
        return any(self.roi_depths) or any(self.roi_table)

    @property
    def is_oriented(self) -> bool:
        """Whether not all orientations of the object are possible."""
        return self.roi_tilt[0] > 0 or self.roi_tilt[1] < math.pi

    @model_validator(mode='after')
    def _oriented(self) -> 'PmclSettings':
        least, most = self.roi_tilt
        if not least <= most:
            raise ValueError(f'roi_tilt is a least and a largest angle [rad]: not {least} and '
                             f'{most}')
        if self.is_oriented and not (any(self.roi_up) or any(self.roi_table)):
            raise ValueError(f'roi_tilt {self.roi_tilt} is an angle to no direction: set roi_up')
        if any(self.roi_up) and not self.is_oriented:
            raise ValueError(f'roi_up {self.roi_up} alone allows any orientation: set roi_tilt, '
                             'as [0, 0.5] for what stands')
        return self

    @model_validator(mode='after')
    def _in_view(self) -> 'PmclSettings':
        near, far = self.roi_depths
        if any(self.roi_depths) and not 0.05 <= near < far:
            raise ValueError(f'roi_depths are a near and a far depth, 0.05 m at least: not {near} '
                             f'and {far} m')
        if any(self.roi_table) and not any(self.roi_table[3:]):
            raise ValueError(f'roi_table {self.roi_table} has no normal: three numbers of a point '
                             'of the table, three of the direction up from it')
        return self
