"""The frame of a symmetric object goes on from capture to capture, as the object does."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.se3 import retract, rotation_angle
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.prior.region import Box
from pmcl_ros.pmcl.tracking.continuity import Continuity

AXIS = np.array([0, 0, 1.0])
WIDE = Box((0, 0, 0.5), (1, 1, 1))
UPSIDE_DOWN = pose_of(Rotation.from_rotvec([np.pi, 0, 0]), [0, 0, 0.1])  # about z = 0.05 m
GLASS = Symmetry(AXIS)
ROD = Symmetry(AXIS, np.stack([np.eye(4), UPSIDE_DOWN]))
CARTON = Symmetry(None, np.stack([np.eye(4), UPSIDE_DOWN]))


def estimate_at(pose, symmetry, rng=None, lost=False, frame_id='camera', sigma=0.02):
    """What a search of one capture publishes: its own choice of what looks alike."""
    pose = symmetry.canonical(symmetry.equivalents(pose))
    rng = rng or np.random.default_rng(0)
    spread = np.diag([1e-6, 2e-6, 3e-6, *3 * [sigma ** 2]])
    particles = retract(pose, rng.multivariate_normal(np.zeros(6), spread, 4000))
    return PoseEstimate(Header(1, frame_id), pose, symmetry.covariance(particles, pose), particles,
                        np.full(4000, -np.log(4000)), 1.0, lost, 'default',
                        (PoseMode(pose, 1.0, 1.0),))


def turns(poses):
    """(n - 1,) [rad] from each pose to the next."""
    return [rotation_angle(one[None], other)[0]
            for one, other in zip(poses[1:], poses[:-1], strict=True)]


@pytest.mark.parametrize('symmetry', [GLASS, ROD], ids=['glass', 'rod'])
def test_noise_does_not_turn_a_glass_that_is_seen_along_its_axis(symmetry):
    rng = np.random.default_rng(2)
    truth = pose_of(Rotation.from_rotvec([0.01, 0, 0]), [0, 0, 0.5])
    captures = [estimate_at(each, symmetry, rng) for each in
                retract(truth, rng.normal(0, 0.02, (20, 6)) * [0, 0, 0, 1, 1, 1])]
    assert max(turns([each.pose for each in captures])) > 1.5  # the searches' own choices
    continuity = Continuity(symmetry, WIDE)
    found = [continuity.follow(each) for each in captures]
    assert found[0] is captures[0]
    for each, before in zip(found, captures, strict=True):
        off, was = (pose_error(one.pose, truth, symmetry) for one in (each, before))
        assert (off.rotation, off.translation) == pytest.approx(
            (was.rotation, was.translation), abs=1e-7)
        np.testing.assert_allclose(each.modes[0].pose, each.pose, atol=1e-9)
    # A turn is that of the axis alone.
    for turn, one, other in zip(turns([each.pose for each in found]), found[1:], found[:-1],
                                strict=True):
        assert turn == pytest.approx(
            symmetry.rotation_distance(one.pose[None], other.pose)[0], abs=1e-6)


def test_an_object_that_turns_over_is_followed_through_the_border_of_the_choice():
    poses = [pose_of(Rotation.from_rotvec([angle, 0.1, 0]), [0, 0, 0.5])
             for angle in np.linspace(-4, 0, 41)]
    captures = [estimate_at(each, CARTON) for each in poses]
    assert max(turns([each.pose for each in captures])) > 1
    continuity = Continuity(CARTON, WIDE)
    found = [continuity.follow(each) for each in captures]
    assert max(turns([each.pose for each in found])) < 0.11
    for each, before in zip(found, captures, strict=True):
        # Where the origin is another one, the covariance is of that one.
        np.testing.assert_allclose(each.covariance, CARTON.covariance(each.particles, each.pose),
                                   atol=2e-6)
        near = retract(before.pose, np.array([[1e-3, 0, 0, 0.01, 0, 0]]))[0]
        levels = [CARTON.credible_level(near, one.pose, one.covariance) for one in (each, before)]
        assert levels[0] == pytest.approx(levels[1], abs=1e-3)
    assert max(abs(each.covariance - before.covariance).max()
               for each, before in zip(found, captures, strict=True)) > 1e-5


def test_a_camera_that_goes_around_does_not_turn_the_object_in_the_fixed_frame():
    world = pose_of(Rotation.from_rotvec([np.pi / 2 + 0.3, 0, 0]), [0, 0, 0.5])
    middle = pose_of(Rotation.identity(), [0, 0, 0.5])
    cameras = [middle @ pose_of(Rotation.from_rotvec([0, angle, 0]), [0, 0, 0])
               @ np.linalg.inv(middle) for angle in np.linspace(0, 3, 7)]
    captures = [estimate_at(np.linalg.inv(camera) @ world, GLASS) for camera in cameras]
    continuity = Continuity(GLASS, WIDE)
    fixed = [camera @ continuity.follow(each, camera).pose
             for camera, each in zip(cameras, captures, strict=True)]
    assert max(turns([camera @ each.pose for camera, each
                      in zip(cameras, captures, strict=True)])) > 0.3
    assert max(turns(fixed)) < 1e-6


def test_what_looks_alike_with_its_origin_outside_the_region_is_not_chosen():
    pose = pose_of(Rotation.identity(), [0, 0, 0.5])
    continuity = Continuity(CARTON, Box((0, 0, 0.5), (0.02, 0.02, 0.02)))
    continuity.follow(replace(estimate_at(pose, CARTON), pose=pose @ UPSIDE_DOWN))
    there = replace(estimate_at(pose, CARTON), pose=pose)
    np.testing.assert_array_equal(continuity.follow(there).pose, pose)
    # In a region that holds both the last choice goes on.
    continuity = Continuity(CARTON, WIDE)
    continuity.follow(replace(there, pose=pose @ UPSIDE_DOWN))
    np.testing.assert_allclose(continuity.follow(there).pose, pose @ UPSIDE_DOWN, atol=1e-12)
    # So it does in one that holds neither, which the object has left.
    continuity = Continuity(CARTON, Box((1, 0, 0.5), (0.02, 0.02, 0.02)))
    continuity.follow(replace(there, pose=pose @ UPSIDE_DOWN))
    np.testing.assert_allclose(continuity.follow(there).pose, pose @ UPSIDE_DOWN, atol=1e-12)


@pytest.mark.parametrize('known', [(True, False), (False, True)], ids=['then', 'now'])
def test_a_camera_that_is_known_of_one_capture_alone_is_of_no_account(known):
    camera = pose_of(Rotation.from_rotvec([0, 2, 0]), [0.3, 0, 0.2])
    pose = pose_of(Rotation.identity(), [0, 0, 0.5])
    first = replace(estimate_at(pose, CARTON), pose=pose @ UPSIDE_DOWN)
    second = replace(estimate_at(pose, CARTON), pose=pose)
    continuity = Continuity(CARTON, WIDE)
    continuity.follow(first, camera if known[0] else None)
    found = continuity.follow(second, camera if known[1] else None)
    np.testing.assert_allclose(found.pose, first.pose, atol=1e-12)


def test_the_choice_is_free_again_after_a_reset_and_in_another_frame_but_not_after_a_loss():
    def seen(angle, **changes):
        return estimate_at(pose_of(Rotation.from_rotvec([np.pi / 2, 0, 0])
                                   * Rotation.from_rotvec([0, 0, 0.3]),
                                   [0.3 * np.sin(angle), 0, 0.5]), GLASS, **changes)

    first, second = seen(-1), seen(1)
    assert rotation_angle(first.pose[None], second.pose)[0] > 0.5
    continuity = Continuity(GLASS, WIDE)
    continuity.follow(first)
    lost = continuity.follow(seen(0, lost=True))
    assert rotation_angle(lost.pose[None], first.pose)[0] < 1e-6
    assert rotation_angle(continuity.follow(second).pose[None], first.pose)[0] < 1e-6
    other = seen(1, frame_id='base')
    assert continuity.follow(other) is other
    continuity.reset()
    assert continuity.follow(second) is second
    # Nearest to what was found, whatever a lost one between them is like.
    continuity = Continuity(CARTON, WIDE)
    found, _, again = (continuity.follow(estimate_at(
        pose_of(Rotation.from_rotvec([angle, 0, 0]), [0, 0, 0.5]), CARTON, lost=angle == 1)).pose
        for angle in (0, 1, 2))
    assert rotation_angle(again[None], found)[0] == pytest.approx(np.pi - 2)


def test_without_a_symmetry_the_estimate_stays_as_it_is():
    continuity = Continuity(Symmetry(), WIDE)
    for angle in (0, 2, -1):
        each = estimate_at(pose_of(Rotation.from_rotvec([0, angle, 0]), [0, 0, 0.5]), Symmetry())
        assert continuity.follow(each) is each
