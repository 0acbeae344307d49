"""Rank the grasps of an object at an estimated pose: reach, clearance, comfort."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pmcl_ros.geometry.se3 import point_covariance, remove_spin, rotations_about
from pmcl_ros.grasps.clearance import Clearance, surface_points
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.settings import GraspSettings, GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import GraspError

_UP = np.array([0, 0, 1.0])
_LEVEL = 0.1  # of a unit vector: a smaller component across the axis gives no direction


@dataclass(frozen=True)
class Candidate:
    """A grasp at one pose of the object, with its rating.

    pose: (4, 4) the grasp frame in the robot's base. probability: that the open fingers clear the
    object. comfort: 1 where the approach points away from the shoulder, 0 where towards it.
    """

    grasp: Grasp
    pose: NDArray[np.float64]
    probability: float
    comfort: float

    @property
    def score(self) -> float:
        """The candidates are sorted by this value."""
        return self.probability * self.comfort

    def before(self, distance: float) -> NDArray[np.float64]:
        """(4, 4) the pose `distance` [m] back along the approach."""
        pose = self.pose.copy()
        pose[:3, 3] -= distance * pose[:3, 0]
        return pose


@dataclass(frozen=True)
class Ranking:
    """The candidates, best first, and the number of refused grasps by reason."""

    candidates: tuple[Candidate, ...]
    refused: dict[str, int]

    def describe(self) -> str:
        """One line for people."""
        why = ', '.join(f'{count} {reason}' for reason, count in self.refused.items())
        if not self.candidates:
            return f'no grasp: {why}'
        best = self.candidates[0]
        return (f'{len(self.candidates)} grasps, best {best.grasp.name}: clear with '
                f'{best.probability:.3f}' + (f'; refused: {why}' if why else ''))


class Ranker:
    """Ranks the grasps of one object for its poses.

    Raises GraspError when a grasp touches the object or leaves nothing between the fingers.
    """

    def __init__(self, model: ObjectModel, gripper: GripperSettings, grasps: Sequence[Grasp],
                 settings: GraspSettings) -> None:
        points = surface_points(model)
        self._model, self._gripper, self._settings = model, gripper, settings
        self._grasps = tuple(grasps)
        self._clearances = [Clearance.from_points(each, points, gripper) for each in grasps]
        poor = [f'{each.name} ({1000 * room.least:.1f} mm)' for each, room
                in zip(self._grasps, self._clearances, strict=True) if room.least <= 0]
        if poor:
            raise GraspError(
                f'the gripper touches {model.name}, or holds nothing, in: {", ".join(poor)}; '
                "mend the grasps, their opening or the gripper's sizes, or make new ones with "
                '`pmcl grasps`')
        self._corners = np.stack([gripper.corners(each.opening).reshape(-1, 3)
                                  for each in self._grasps])

    def rank(self, pose: NDArray[np.float64], covariance: NDArray[np.float64]) -> Ranking:
        """The grasps for a pose of the object, best first.

        pose: (4, 4) object to base. covariance: (6, 6) of it, x, y, z [m^2], then rotations about
        the base's axes [rad^2].

        Rotations about an axis of symmetry are equivalent: each grasp is tried at evenly spaced
        angles, starting where its approach points away from the shoulder (closed form). So the
        result does not depend on the spin of the pose.
        """
        poses = self._turned(pose)  # (grasps, turns, 4, 4)
        probability = self._probability(pose, covariance, poses)
        outwards = poses[..., :3, 3] - self._settings.shoulder
        outwards /= np.maximum(np.linalg.norm(outwards, axis=-1, keepdims=True), 1e-9)
        comfort = (1 + (poses[..., :3, 0] * outwards).sum(axis=-1)) / 2
        reasons = {
            'out of reach': self._unreachable(poses),
            'too near to what the object stands on': self._too_low(pose, poses),
            'not surely clear of the object': probability < self._settings.least_probability}
        good = ~np.any(list(reasons.values()), axis=0)
        refused, counted = {}, np.zeros(good.shape, bool)
        for reason, refuses in reasons.items():
            if (refuses & ~counted).any():
                refused[reason] = int((refuses & ~counted).sum())
            counted |= refuses
        grasp, turn = np.nonzero(good)
        # Rounded, in a stable order: noise must not decide between equal grasps.
        order = np.argsort(-np.round((probability * comfort)[good], 9), kind='stable')
        order = order[_unique(poses[grasp, turn][order])]
        return Ranking(tuple(
            Candidate(self._grasps[g], _upright(poses[g, t], outwards[g, t]),
                      float(probability[g, t]), float(comfort[g, t]))
            for g, t in zip(grasp[order][:self._settings.most], turn[order], strict=False)),
            refused)

    def _turned(self, pose: NDArray[np.float64]) -> NDArray[np.float64]:
        """(grasps, turns, 4, 4) the equivalent grasps in the base frame, by all symmetries."""
        own = np.stack([each.pose for each in self._grasps])
        return np.concatenate([self._turned_about_axis(each, own)
                               for each in pose @ self._model.discrete], axis=1)

    def _turned_about_axis(self, pose: NDArray[np.float64], own: NDArray[np.float64]
                           ) -> NDArray[np.float64]:
        """(grasps, turns, 4, 4) of grasps (grasps, 4, 4) in the object's frame."""
        axis = self._model.axis
        if axis is None:
            return (pose @ own)[:, None]
        outwards = pose[:3, :3].T @ (pose[:3, 3] - self._settings.shoulder)
        steps = 2 * np.pi * np.arange(self._settings.turns) / self._settings.turns
        angles = (_aligning(each, axis, outwards, pose) + steps for each in own)
        return np.stack([pose @ rotations_about(axis, about) @ each
                         for about, each in zip(angles, own, strict=True)])

    def _probability(self, pose: NDArray[np.float64], covariance: NDArray[np.float64],
                     poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(grasps, turns) that the open fingers clear the object."""
        if self._model.axis is not None:
            covariance = remove_spin(covariance, pose[:3, :3] @ self._model.axis)
        turns = poses[..., :3, :3]
        shift = point_covariance(covariance, poses[..., :3, 3] - pose[:3, 3])
        shift = np.swapaxes(turns, -1, -2) @ shift @ turns
        shift = shift + self._settings.arm_sigma ** 2 * np.eye(3)
        return np.stack([room.probability(each) for room, each
                         in zip(self._clearances, shift, strict=True)])

    def _unreachable(self, poses: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(grasps, turns) whose wrist is too near or too far, at the grasp or before the approach.

        A planner must still check the inverse kinematics of the others.
        """
        parent = (poses @ self._gripper.parent_pose)[..., :3, 3]
        wrist = parent - self._settings.wrist * poses[..., :3, 0]
        both = np.stack([wrist, wrist - self._settings.approach * poses[..., :3, 0]])
        distance = np.linalg.norm(both - self._settings.shoulder, axis=-1)
        far = (distance > self._settings.reach) | (distance < self._settings.nearest)
        return far.any(axis=0)

    def _too_low(self, pose: NDArray[np.float64], poses: NDArray[np.float64]
                 ) -> NDArray[np.bool_]:
        """(grasps, turns) with the gripper below the object's lowest point during the approach.

        z of the base frame points up.
        """
        if not self._settings.support:
            return np.zeros(poses.shape[:2], bool)
        ground = (self._model.vertices @ pose[2, :3]).min() + pose[2, 3]
        heights = np.einsum('gtj,gcj->gtc', poses[..., 2, :3], self._corners)
        lowest = heights.min(axis=-1) + poses[..., 2, 3]
        lowest = lowest - np.maximum(self._settings.approach * poses[..., 2, 0], 0)
        return lowest < ground + self._settings.support_margin


def _aligning(grasp: NDArray[np.float64], axis: NDArray[np.float64],
              outwards: NDArray[np.float64], pose: NDArray[np.float64]) -> float:
    """The angle about `axis` [rad] that aligns the approach of a grasp (4, 4) with `outwards`.

    For v = v_along + v_across the rotated v is v_along + cos(t) v_across + sin(t) axis x v_across;
    its product with a direction d is largest at t = atan2(axis x v . d, v_across . d). Where the
    approach is along the axis, the closing direction is aligned normal to `outwards` instead.
    """
    ahead = outwards / max(float(np.linalg.norm(outwards)), 1e-9)
    if np.linalg.norm(np.cross(axis, ahead)) < _LEVEL:  # along the axis: any fixed direction
        ahead = pose[:3, :3].T @ np.eye(3)[int(abs(pose[:3, :3] @ axis).argmin())]
    across = np.cross(axis, np.cross(grasp[:3, 0], axis))
    if np.linalg.norm(across) < _LEVEL:
        across, ahead = np.cross(axis, np.cross(grasp[:3, 1], axis)), np.cross(axis, ahead)
    return float(np.arctan2(np.cross(axis, across) @ ahead, across @ ahead))


def _unique(poses: NDArray[np.float64]) -> NDArray[np.intp]:
    """Numbers of the first of equal poses (n, 4, 4), by symmetries and what a file lists.

    Half a turn about x changes nothing (`_upright`), nor does the sign of y.
    """
    closing = poses[:, :3, 1]
    squares = closing[:, :, None] * closing[:, None]
    keys = np.concatenate([poses[:, :3, 3], poses[:, :3, 0], squares.reshape(-1, 9)], axis=1)
    return np.sort(np.unique(np.round(keys, 6) + 0.0, axis=0, return_index=True)[1])


def _upright(pose: NDArray[np.float64], outwards: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pose (4, 4), or the equivalent one after half a turn about the approach.

    z of the gripper points up, or outwards where the approach is down, which wrists reach best.
    """
    if pose[:3, 2] @ (_UP + outwards) >= -1e-9:
        return pose
    return pose @ np.diag([1.0, -1, -1, 1])
