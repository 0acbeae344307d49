"""A pose in a YAML file: 16 numbers, four rows of four, or a Pose or Transform of ROS."""

from collections.abc import Callable
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field, ValidationError

from pmcl_ros.lightfield.posed_view import check_pose, quaternion_pose
from pmcl_ros.runtime.errors import LightFieldError, told_as
from pmcl_ros.runtime.settings import Settings, explain

_ROWS = 4
_OF_ROS = ('position', 'orientation'), ('translation', 'rotation')  # Pose, Transform


def _in_order(names: str) -> Callable[[Any], Any]:
    """To the list of a mapping of names, as `ros2 topic echo` prints it; others stay."""
    def listed(value: Any) -> Any:
        if not isinstance(value, dict):
            return value
        if set(value) != set(names):
            raise ValueError(f'expected {", ".join(names)}, got {", ".join(map(str, value))}')
        return [value[each] for each in names]
    return listed


Position = Annotated[tuple[float, float, float], BeforeValidator(_in_order('xyz'))]
Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_in_order('xyzw'))]


class _PoseOfRos(Settings):
    """A geometry_msgs/Pose."""

    position: Position = Field(description='[m]')
    orientation: Quaternion = Field(description='quaternion x, y, z, w')

    @property
    def numbers(self) -> list[float]:
        """16, row by row. Raises LightFieldError for no unit quaternion."""
        pose = quaternion_pose(self.position, self.orientation, 'orientation')
        return [float(each) for each in pose.ravel()]


def _numbers_of_ros(value: dict[Any, Any]) -> list[float]:
    """The 16 numbers of a Pose or Transform; ValueError where it is none."""
    keys = next((each for each in _OF_ROS if set(each) == set(value)), None)
    if keys is None:
        raise ValueError('a pose is 16 numbers, or has the keys '
                         f'{" or ".join(map(" and ".join, _OF_ROS))}, and no others; got '
                         f'{", ".join(str(each)[:80] for each in value) or "none"}')
    try:
        return _PoseOfRos.model_validate(
            dict(zip(_OF_ROS[0], map(value.get, keys), strict=True))).numbers
    except ValidationError as error:
        raise ValueError(explain(error, _PoseOfRos)) from None
    except LightFieldError as error:
        raise ValueError(str(error)) from None


def _one_row(value: Any) -> Any:
    """The 16 numbers of four rows of four, or of a mapping."""
    if isinstance(value, dict):
        return _numbers_of_ros(value)
    if isinstance(value, list) and [len(row) for row in value if isinstance(row, list)] == [
            4, 4, 4, 4] and len(value) == _ROWS:
        return [each for row in value for each in row]
    if isinstance(value, list) and (len(value) == 12 or [
            len(row) for row in value if isinstance(row, list)] == [4, 4, 4]):
        raise ValueError('it is 3x4, expected 4x4, row by row: add 0, 0, 0, 1')
    return value


def _sixteen(values: tuple[float, ...]) -> tuple[float, ...]:
    """Of numbers that are right each: pydantic's lengths do not count wrong ones."""
    if len(values) != _ROWS ** 2:
        raise ValueError(f'a pose has 16 numbers, 4x4, not {len(values)}')
    return values


def _rigid(values: tuple[float, ...]) -> tuple[float, ...]:
    with told_as(ValueError, LightFieldError):
        check_pose(np.reshape(values, (_ROWS, _ROWS)), 'it')
    return values


Matrix = Annotated[tuple[float, ...], BeforeValidator(_one_row), AfterValidator(_sixteen)]
Rigid = Annotated[Matrix, AfterValidator(_rigid)]  # of a rotation and a shift
