"""PoseEstimate: `pose`, `pose_with_covariance`, `particles`, /tf."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import pose_of
from pmcl_ros.messages.header import header_from, header_to_message
from pmcl_ros.messages.types import (
    Point,
    Pose,
    PoseArray,
    PoseStamped,
    PoseWithCovariance,
    PoseWithCovarianceStamped,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from pmcl_ros.pmcl.estimate import PoseEstimate
from pmcl_ros.runtime.errors import MessageError

_ROUNDED = 1e-9  # of the largest covariance: by which a variance of 0 may seem negative


class PoseMessages(NamedTuple):
    """`pose`, `pose_with_covariance` and `particles`."""

    pose: PoseStamped
    with_covariance: PoseWithCovarianceStamped
    particles: PoseArray


def estimate_to_messages(estimate: PoseEstimate) -> PoseMessages:
    """The pose, the pose with its covariance, the particles: object to camera, metres."""
    header = header_to_message(estimate.header)
    pose, *particles = poses_to_messages(np.concatenate([estimate.pose[None], estimate.particles]))
    spread = PoseWithCovariance(pose=pose, covariance=estimate.covariance.astype(float).ravel())
    return PoseMessages(PoseStamped(header=header, pose=pose),
                        PoseWithCovarianceStamped(header=header, pose=spread),
                        PoseArray(header=header, poses=particles))


def estimate_to_transform(estimate: PoseEstimate, child: str) -> TransformStamped:
    """The pose as a transform for /tf: the frame `child` of the object in the camera's frame."""
    return pose_to_transform(estimate.header, estimate.pose, child)


def pose_to_transform(header: Header, pose: NDArray[np.float64], child: str) -> TransformStamped:
    """For /tf, of the pose (4, 4) of a frame `child` in the header's frame [m]."""
    message = pose_to_message(pose)
    p = message.position
    return TransformStamped(
        header=header_to_message(header), child_frame_id=child, transform=Transform(
            translation=Vector3(x=p.x, y=p.y, z=p.z), rotation=message.orientation))


def transform_from(message: TransformStamped) -> tuple[Header, str, NDArray[np.float64]]:
    """Header, child frame, and its pose (4, 4) in the header's frame."""
    transform = message.transform
    pose = SimpleNamespace(position=transform.translation, orientation=transform.rotation)
    return header_from(message.header), message.child_frame_id, poses_from([pose], 'tf')[0]


def pose_from(message: PoseStamped) -> tuple[Header, NDArray[np.float64]]:
    """Header and pose (4, 4)."""
    return header_from(message.header), poses_from([message.pose], 'pose')[0]


def pose_with_covariance_from(message: PoseWithCovarianceStamped,
                              ) -> tuple[Header, NDArray[np.float64], NDArray[np.float64]]:
    """Header, pose (4, 4) and covariance (6, 6): x, y, z, then rotations about the fixed axes."""
    covariance = np.reshape(message.pose.covariance, (6, 6))
    if not np.isfinite(covariance).all() or not np.allclose(covariance, covariance.T):
        raise MessageError('pose_with_covariance: the covariance is not finite and symmetric')
    if (least := np.linalg.eigvalsh(covariance)[0]) < -_ROUNDED * np.abs(covariance).max():
        raise MessageError('pose_with_covariance: the covariance has a variance of '
                           f'{least:.3g} along one direction: none is negative')
    pose = poses_from([message.pose.pose], 'pose_with_covariance')[0]
    return header_from(message.header), pose, covariance


def pose_to_message(pose: NDArray[np.float64]) -> Pose:
    """Of a pose (4, 4) [m]."""
    return poses_to_messages(pose[None])[0]


def poses_to_messages(matrices: NDArray[np.float64]) -> list[Pose]:
    """Of poses (n, 4, 4)."""
    quaternions = Rotation.from_matrix(matrices[:, :3, :3]).as_quat(canonical=True)  # x, y, z, w
    return [Pose(position=Point(x=x, y=y, z=z), orientation=Quaternion(x=a, y=b, z=c, w=w))
            for (x, y, z), (a, b, c, w)
            in zip(matrices[:, :3, 3].tolist(), quaternions.tolist(), strict=True)]


def _told(values: NDArray[np.float64]) -> str:
    return f'({", ".join(f"{each:.4g}" for each in values)})'


def poses_from(poses: Sequence[Pose], topic: str) -> NDArray[np.float64]:
    """(n, 4, 4), checked; topic: to name in what is wrong."""
    rows = np.array([(p.position.x, p.position.y, p.position.z, p.orientation.x, p.orientation.y,
                      p.orientation.z, p.orientation.w) for p in poses]).reshape(-1, 7)
    if not (finite := np.isfinite(rows).all(axis=1)).all():
        raise MessageError(f'{topic}: a pose is not finite: {_told(rows[~finite][0])}')
    lengths = np.linalg.norm(rows[:, 3:], axis=1)
    if (wrong := abs(lengths - 1) > 1e-3).any():
        raise MessageError(f'{topic}: the quaternion {_told(rows[wrong][0, 3:])} has length '
                           f'{lengths[wrong][0]:.4g}, not 1')
    if len(rows) == 0:  # which Rotation takes from SciPy 1.15 on only
        return np.zeros((0, 4, 4))
    return pose_of(Rotation.from_quat(rows[:, 3:]), rows[:, :3])
