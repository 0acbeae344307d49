"""Plans of posed views: from where a camera is to look, or could."""

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pmcl_ros.lightfield.pose_entry import Rigid
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import Settings


class ViewPlan(Settings):
    """Poses of a camera's optical frame (x right, y down, z forward), in any directions."""

    frame: str = Field('', description='reference frame of the poses; empty: that of the views')
    poses: list[Rigid] = Field(min_length=1, max_length=10_000, description='camera to the '
                                'reference frame, 4x4 each, row by row [m], or a Pose of ROS')

    @property
    def cameras(self) -> NDArray[np.float64]:
        """(n, 4, 4)."""
        return np.array(self.poses).reshape(-1, 4, 4)

    def cameras_in(self, reference: str, path: str) -> NDArray[np.float64]:
        """The cameras (n, 4, 4); SettingsError where they are in another frame than views.

        reference: frame of the views. path: that the plan was read from.
        """
        if self.frame and self.frame != reference:
            raise SettingsError(f'{path} is in frame {self.frame!r}, the views are in '
                                f'{reference!r}: change one')
        return self.cameras


def check_frame(plan: ViewPlan | SweepPlan, fixed_frame: str, path: str) -> None:
    """SettingsError where the plan that was read from `path` is in another frame."""
    if plan.frame and plan.frame != fixed_frame:
        raise SettingsError(f'{path} is in frame {plan.frame!r}, the poses are in fixed_frame '
                            f'{fixed_frame!r}: change one')
