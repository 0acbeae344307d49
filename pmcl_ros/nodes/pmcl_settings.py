"""Parameters of pmcl_node."""

from typing import Literal

from pydantic import Field, model_validator

from pmcl_ros.pmcl.tracking.settings import TrackingSettings


class PmclNodeSettings(TrackingSettings):
    """Settings of the search, the tracking and the frames on /tf."""

    source: Literal['light_field', 'posed_views'] = Field(
        'light_field', description='what is searched: light_field, the evidence of dlv_node, in '
        "the camera's frame; posed_views, pictures and camera poses (posed_views), in their "
        'frame. The region of interest is in that frame')
    next_view_cap: float = Field(
        90.0, gt=0, le=360, description='posed views: angle of the cap of cameras about the '
        'object that ~/next_view chooses from [deg]')
    next_view_candidates: int = Field(40, ge=1, le=10_000, description='posed views: number of '
                                      'these cameras')
    next_view_plan: str = Field('', description='posed views: path of a plan, YAML, whose `poses` '
                                '~/next_view chooses from (camera to the frame of the views, 16 '
                                'numbers each), as those that the arm reaches; empty: the cap')
    broadcast_tf: bool = Field(
        False, description="publish the frame of the object on /tf, as a child of the camera's, "
        'for each pose; a listener that comes later gets the last one; needs tf2_msgs (full '
        'ROS)')
    object_frame: str = Field('', description="frame of the object on /tf; empty: the object's "
                              'name')
    detections: Literal['auto', 'always', 'never'] = Field(
        'auto', description='publish detections (vision_msgs/Detection3DArray); auto: where '
        'vision_msgs is installed')
    collision_object: Literal['auto', 'always', 'never'] = Field(
        'auto', description="publish collision_object (moveit_msgs/CollisionObject), for MoveIt's "
        'planning scene; auto: where moveit_msgs is installed')
    objects: tuple[str, ...] = Field(
        ('',), description='paths of several objects that are looked for together, instead of '
        'object; a path that is there twice means two copies. Each object has its own frame, and '
        'the topics objects/NAME/pose and objects/NAME/pose_with_covariance')

    @property
    def several(self) -> tuple[str, ...]:
        """Paths of the objects of a joint search; empty: `object` is the only one."""
        return tuple(each for each in self.objects if each)

    @property
    def searches_again(self) -> bool:
        """Whether a light field is searched by its contour map too where edges are not enough.

        Not while it is tracked: captures come fast, and what was found before says more.
        """
        return (self.evidence == 'auto' and self.mode == 'default' and self.tracking == 'none'
                and not self.several)

    @model_validator(mode='after')
    def _some_exclude_others(self) -> 'PmclNodeSettings':
        if self.several and (self.tracking != 'none' or self.mode != 'default'):
            raise ValueError(f'objects need tracking none and mode default, they are '
                             f'{self.tracking} and {self.mode}')
        if self.several and self.object_frame:
            raise ValueError(f'objects have frames of their own names: object_frame '
                             f'{self.object_frame!r} must be empty')
        if self.several and self.region_in_view:
            raise ValueError('objects need the box roi_center, roi_size: roi_depths and roi_table '
                             'are for one object')
        if self.source == 'light_field' and self.evidence == 'map' and self.tracking != 'none':
            raise ValueError(f'tracking {self.tracking} needs evidence edges in light fields, it '
                             f'is {self.evidence}')
        if self.source == 'posed_views' and self.mode != 'default':
            raise ValueError(f'source posed_views needs mode default, it is {self.mode}')
        if self.source == 'posed_views' and self.tracking == 'camera':
            raise ValueError('tracking camera is for light fields: posed views have poses of '
                             'their cameras; set it to constant_pose')
        return self
