"""Ranking: equivalent under symmetry, safest first, and never what cannot be."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.se3 import rotations_about, transform
from pmcl_ros.grasps.grasp import Grasp
from pmcl_ros.grasps.ranking import Ranker
from pmcl_ros.grasps.settings import GraspSettings, GripperSettings
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.runtime.errors import GraspError

FETCH, SETTINGS = GripperSettings(), GraspSettings()
PLACE = (0.72, 0.1, 0.75)
SURE = np.diag([1e-6] * 3 + [1e-4] * 3)


@pytest.fixture(scope='module')
def ranker(vessels, made):
    """A function of an object's name and of settings -> what ranks its grasps, made once."""
    @cache
    def ranker(name='cup', **changes):
        return Ranker(vessels[name], FETCH, made[name], GraspSettings(**changes))
    return ranker


@pytest.mark.parametrize('name', ['cup', 'lying cup'])
@pytest.mark.parametrize('spin', [0.3, 2.0, -1.234])
@pytest.mark.parametrize('away', [False, True], ids=['aside', 'from the shoulder'])
def test_a_spin_about_the_axis_changes_nothing(vessels, ranker, name, spin, away):
    """Nor where it points away from the shoulder, so that no side of the object does."""
    rank = ranker(name, most=1000, support=False).rank
    pose, axis = transform(PLACE, (0.05, -0.1, 0.7)), vessels[name].axis
    if away:
        pose = transform(np.add(SETTINGS.shoulder, [0.7, 0, 0]),
                         (0, 0, 0) if axis[0] else (0, np.pi / 2, 0))
    # not isotropic, and free about the axis, as an estimate tells it
    covariance = np.diag([1e-6, 9e-6, 3e-5, 1e-4, 2e-4, 1e-4])
    world = pose[:3, :3] @ axis
    covariance[3:, 3:] += np.pi ** 2 / 3 * np.outer(world, world)
    one = rank(pose, covariance)
    two = rank(pose @ rotations_about(axis, np.array([spin]))[0], covariance)
    assert len(one.candidates) > 10
    assert one.refused == two.refused
    assert len(one.candidates) == len(two.candidates)
    np.testing.assert_allclose([each.score for each in one.candidates],
                               [each.score for each in two.candidates], atol=1e-8)
    # equals may change places
    kept = [(each.grasp.name, each.pose) for each in two.candidates]
    for each in one.candidates:
        assert any(each.grasp.name == other and np.allclose(each.pose, pose, atol=1e-8)
                   for other, pose in kept)


def test_the_best_approach_points_away_from_the_shoulder(vessels, made):
    sides = [each for each in made['cup'] if each.kind == 'side']
    rank = Ranker(vessels['cup'], FETCH, sides, SETTINGS).rank
    for angle in (-0.8, 0.0, 0.6):
        place = np.array([0.7 * np.cos(angle), 0.7 * np.sin(angle), 0.75])
        best = rank(transform(place), SURE).candidates[0]
        out = place[:2] - SETTINGS.shoulder[:2]
        # the closed form, not only the nearest of 24 turns
        assert best.pose[:2, 0] @ out / np.linalg.norm(out) == pytest.approx(1, abs=1e-9)
        assert best.pose[2, 2] == pytest.approx(1)  # z up


def test_scores_fall_and_what_is_told_is_true(ranker):
    ranking = ranker().rank(transform(PLACE), SURE)
    scores = [each.score for each in ranking.candidates]
    assert (np.diff(scores) < 1e-8).all()
    assert len(ranking.candidates) <= SETTINGS.most
    for each in ranking.candidates:
        assert each.probability >= SETTINGS.least_probability
        assert 0 <= each.comfort <= 1
        before = each.before(0.1)
        np.testing.assert_allclose(each.pose[:3, 3] - before[:3, 3], 0.1 * each.pose[:3, 0])
        # the wrist is within reach, there and before
        for pose in (each.pose, before):
            wrist = (pose @ FETCH.parent_pose)[:3, 3] - SETTINGS.wrist * pose[:3, 0]
            assert np.linalg.norm(wrist - SETTINGS.shoulder) <= SETTINGS.reach
    assert f'best {ranking.candidates[0].grasp.name}' in ranking.describe()
    assert ranking.refused
    for reason, count in ranking.refused.items():
        assert f'{count} {reason}' in ranking.describe()


def test_the_fingers_close_where_the_pose_is_sure(vessels, made):
    # An estimate is least sure along the camera's ray: here along the robot's x. Fingers that
    # close along y do not mind; over the top of the glass they can be turned as they like.
    over = [each for each in made['cup'] if each.kind == 'top']
    unsure = SURE + np.diag([1.2e-4, 0, 0, 0, 0, 0])
    rank = Ranker(vessels['cup'], FETCH, over, GraspSettings(least_probability=0.2)).rank
    best = rank(transform((0.6, 0.0, 0.55)), unsure).candidates[0]
    assert abs(best.pose[1, 1]) > 0.8
    worst = rank(transform((0.6, 0.0, 0.55)), unsure).candidates[-1]
    assert abs(worst.pose[1, 1]) < 0.5
    for each in rank(transform((0.6, 0.0, 0.55)), unsure).candidates:  # z outwards, from above
        assert each.pose[:3, 2] @ (each.pose[:3, 3] - SETTINGS.shoulder) > -1e-9
    assert worst.probability < best.probability - 0.05


def test_a_pose_that_is_too_unsure_gets_no_grasp(ranker):
    rank = ranker().rank
    assert rank(transform(PLACE), SURE).candidates
    none = rank(transform(PLACE), np.diag([4e-4] * 3 + [1e-4] * 3))
    assert not none.candidates
    assert 'not surely clear' in none.describe()
    # tilted, the grasp is as unsure as its lever is long
    tilt = rank(transform(PLACE), np.diag([1e-6] * 3 + [0.3 ** 2] * 2 + [0]))
    heights = {each.grasp.name for each in tilt.candidates}
    assert len(heights) < len({each.grasp.name for each in
                               rank(transform(PLACE), SURE).candidates} | {'none'})


def test_errors_of_the_arm_are_those_of_the_position(ranker):
    of_arm, of_pose = (
        ranker(arm_sigma=sigma, least_probability=0).rank(transform(PLACE), SURE + np.diag(
            [0.004 ** 2 - sigma ** 2] * 3 + [0] * 3)) for sigma in (0.004, 0))
    np.testing.assert_allclose([each.probability for each in of_arm.candidates],
                               [each.probability for each in of_pose.candidates], atol=1e-12)


@pytest.mark.parametrize('limit', ['reach', 'nearest'])
def test_exactly_those_within_reach_on_all_their_way_are_kept(ranker, limit):
    free, distances = {'reach': 9, 'nearest': 0, 'most': 1000, 'support': False}, []
    for each in ranker(**free).rank(transform(PLACE), SURE).candidates:
        on_way = np.stack([each.pose, each.before(SETTINGS.approach)])
        wrist = (on_way @ FETCH.parent_pose)[:, :3, 3] - SETTINGS.wrist * on_way[:, :3, 0]
        distances.append(np.linalg.norm(wrist - SETTINGS.shoulder, axis=1))
    off = np.max(distances, axis=1) if limit == 'reach' else -np.min(distances, axis=1)
    count = 20 + int(np.diff(np.sort(off)[19:60]).argmax())  # some are equal
    bound = abs(float(np.sort(off)[count - 1:count + 1].mean()))
    kept = ranker(**free | {limit: bound}).rank(transform(PLACE), SURE).candidates
    assert len(kept) == count


def test_what_is_out_of_reach_is_refused(ranker, made):
    for place, nearest in (((2.0, 0, 0.7), 0.25), ((0.4, 0, 0.75), 0.75)):
        ranking = ranker(support=False, nearest=nearest).rank(
            transform(place), SURE)
        assert not ranking.candidates
        assert 'out of reach' in ranking.describe()
    # Whatever else speaks against them, each is counted once.
    unsure = ranker(least_probability=1.0).rank(transform((2.0, 0, 0.7)), 1e-2 * np.eye(6))
    assert unsure.refused == {'out of reach': len(made['cup']) * SETTINGS.turns}


@pytest.mark.parametrize('tilt', [0.0, -0.2])
def test_the_gripper_stays_above_what_the_object_stands_on(vessels, ranker, tilt):
    pose = transform(PLACE, (0, tilt, 0))  # tilted, approaches from the side rise
    ground = (vessels['cup'].vertices @ pose[:3, :3].T + pose[:3, 3])[:, 2].min()
    free = ranker('cup', most=1000, support=False).rank(pose, SURE).candidates
    standing = ranker(most=1000).rank(pose, SURE).candidates
    low = {each.grasp.name for each in free} - {each.grasp.name for each in standing}
    assert {'side_13mm', 'side_26mm'} <= low
    heights = [min((FETCH.corners(each.grasp.opening) @ on_way[2, :3]).min() + on_way[2, 3]
                   for on_way in (each.pose, each.before(SETTINGS.approach))) for each in free]
    assert len(standing) == (np.array(heights) >= ground + SETTINGS.support_margin).sum()


def test_upside_down_the_other_end_is_grasped(ranker):
    ranking = ranker(most=1000).rank(
        transform((0.6, 0, 0.7), (np.pi, 0, 0)), SURE)
    names = {each.grasp.name for each in ranking.candidates}
    assert 'over_base' in names
    assert not names & {'over_top', 'rim_top'}
    assert all(each.pose[2, 2] > -1e-6 for each in ranking.candidates)  # the camera stays up


def test_an_object_without_symmetry_is_taken_as_it_lies(vessels, made):
    model = replace(vessels['cup'], axis=None)
    pose = transform(PLACE, (0, 0, np.pi / 2))
    ranking = Ranker(model, FETCH, made['cup'], GraspSettings(least_probability=0.0)).rank(
        pose, SURE)
    for each in ranking.candidates:
        turn = Rotation.from_matrix(each.pose[:3, :3])
        expected = (pose @ each.grasp.pose)[:3, :3]
        assert min(Rotation.from_matrix(expected @ flip).inv().__mul__(turn).magnitude()
                   for flip in (np.eye(3), np.diag([1.0, -1, -1]))) < 1e-9


def test_whichever_of_the_equal_poses_is_told_a_box_is_grasped_alike(tmp_path):
    path = tmp_path / 'box.stl'
    trimesh.creation.box((0.05, 0.06, 0.1)).export(path)
    model = ObjectModel.load(path)
    top = Grasp.from_axes('top', 'top', np.array([0, 0, 0.04]), np.array([0, 0, -1.0]),
                          np.array([1.0, 0, 0]), 0.05, 0.09)
    below = replace(top, name='below', pose=np.diag([1.0, -1, -1, 1]) @ top.pose)  # the same one
    pose = transform((0.6, 0, 0.7))
    assert len(model.discrete) == 4
    for grasps, support, wanted in (([top, below], True, [[0, 0, -1]]),
                                    ([top, below], False, [[0, 0, -1], [0, 0, 1]]),
                                    ([below], False, [[0, 0, -1], [0, 0, 1]])):
        rank = Ranker(model, FETCH, grasps, GraspSettings(support=support)).rank
        for each in model.discrete:
            approaches = [one.pose[:3, 0].round(9).tolist()
                          for one in rank(pose @ each, SURE).candidates]
            assert sorted(approaches) == wanted  # none is told twice


def test_a_grasp_that_touches_is_named(vessels, made):
    narrow = replace(made['cup'][0], name='narrow', opening=0.05)
    with pytest.raises(GraspError, match=r'touches cup.*narrow.*pmcl grasps'):
        Ranker(vessels['cup'], FETCH, [narrow], SETTINGS)
