"""A cup that moves, is hidden, and comes back, in edge volumes that show nothing else."""

from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import CAMERA, cup, depth_of, edges_seen, model_of, pose_of, volume_with
from scipy.spatial.transform import Rotation

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.errors import SettingsError
from pmcl_ros.evaluation.errors import pose_error
from pmcl_ros.header import Header
from pmcl_ros.pmcl.localizer import Localizer
from pmcl_ros.pmcl.sampler import Gaussian
from pmcl_ros.pmcl.tracker import PREDICTED, Tracker
from pmcl_ros.pmcl.tracking_settings import TrackingSettings

DEPTHS = depth_labels(0.3, 0.7, 12)
CUP = model_of(cup(), [0, 0, 1])
PERIOD = 10 ** 8
STEP = np.array([0.012, -0.004, 0.003])  # m from frame to frame
TURN = Rotation.from_rotvec([0.03, -0.02, 0.01])
START = pose_of(Rotation.from_rotvec([1.9, 0.3, 0.2]), np.array([-0.04, 0.015, 0.38]))


def settings(tracking, **values):
    return TrackingSettings(tracking=tracking, roi_center=(0, 0, 0.4), roi_size=(0.12, 0.1, 0.1),
                            renderer='numba', proposals=8, particles=32, moves=1, **values)


def truth_of(number):
    pose = START.copy()
    pose[:3, 3] += number * STEP
    pose[:3, :3] = (Rotation.from_rotvec(number * TURN.as_rotvec())
                    * Rotation.from_matrix(START[:3, :3])).as_matrix()
    return pose


def volume(context, pose, number, hidden=False, strength=2.0):
    depth = depth_of(context, CUP, pose, CAMERA, 2)
    edges = edges_seen(depth, CAMERA, DEPTHS, 0.2 * CUP.radius, zoom=2, strength=strength)
    tensor = (0.0 if hidden else 1.0) * edges.tensor + np.array([0.05, 0.05, 0], np.float32)
    return volume_with(replace(edges, header=Header(number * PERIOD),
                               tensor=tensor.astype(np.float32)))


@pytest.fixture(scope='module')
def frames(_session_context):
    """Seven frames, the fourth and fifth of which show nothing; their poses."""
    _session_context.use()
    poses = [truth_of(number) for number in range(7)]
    return [(volume(_session_context, pose, number, number in (3, 4)), pose)
            for number, pose in enumerate(poses)]


@pytest.fixture(scope='module')
def tracks(frames):
    """What is made of all frames by two models."""
    return {model: tracked(frames, settings(model))
            for model in ('constant_pose', 'constant_velocity')}


def tracked(frames, of, seed=0, cameras=None):
    with Localizer(CUP, of) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(seed)
        cameras = cameras or [None] * len(frames)
        return [tracker.track(each, rng, camera=camera)
                for (each, _), camera in zip(frames, cameras, strict=True)]


def errors(estimates, frames):
    return [pose_error(each.pose, pose, CUP.axis)
            for each, (_, pose) in zip(estimates, frames, strict=True)]


@pytest.mark.parametrize('model', ['constant_pose', 'constant_velocity'])
def test_an_object_is_followed_lost_predicted_and_found_again(frames, tracks, model):
    estimates = tracks[model]
    modes = [each.mode for each in estimates]
    assert modes[:5] == ['default', 'followed', 'followed', PREDICTED, PREDICTED]
    assert [each.lost for each in estimates] == [False] * 3 + [True] * 2 + [False] * 2
    assert modes[6] == 'followed'
    assert not any(each.incomplete for each in estimates)  # it is there, or nothing is
    for number, error in enumerate(errors(estimates, frames)):
        if number not in (3, 4):
            assert error.translation < 0.005
            assert error.rotation < np.deg2rad(4)
    # The covariance grows while nothing is seen, in every direction that the symmetry leaves.
    third, fourth, fifth = (np.linalg.eigvalsh(each.covariance[:3, :3]) for each in estimates[2:5])
    assert (fourth > third).all()
    assert (fifth > fourth).all()
    for each in estimates:
        assert np.exp(each.log_weights).sum() == pytest.approx(1)
        assert np.linalg.eigvalsh(each.covariance).min() > -1e-12


def test_what_moved_on_is_predicted_to_move_on(frames, tracks):
    found = {model: errors(estimates, frames) for model, estimates in tracks.items()}
    step = np.linalg.norm(STEP)
    assert found['constant_velocity'][4].translation < step  # two steps ahead
    assert found['constant_pose'][4].translation > step


def test_the_same_seed_gives_the_identical_track(frames, tracks):
    first = tracks['constant_velocity'][:4]
    again = tracked(frames[:4], settings('constant_velocity'))
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.particles, other.particles)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    other = tracked(frames[:2], settings('constant_velocity'), 4)
    assert (other[1].pose != first[1].pose).any()


def test_the_camera_s_own_motion_is_known(context):
    # 6 cm to the side between two frames: far more than the model leaves open.
    first, second = np.eye(4), pose_of(Rotation.identity(), np.array([-0.06, 0, 0]))
    poses = [np.linalg.inv(camera) @ START for camera in (first, second)]
    both = [(volume(context, pose, number), pose) for number, pose in enumerate(poses)]
    of = settings('camera', track_sigma_translation=0.002, track_sigma_rotation=0.02)
    estimates = tracked(both, of, cameras=[first, second])
    assert [each.mode for each in estimates] == ['default', 'followed']
    assert errors(estimates, both)[1].translation < 0.005
    unknown = tracked(both, of)
    assert [each.mode for each in unknown] == ['default', 'default']


def test_what_was_seen_well_and_hardly_is_any_more_is_not_believed(context):
    pose, of = truth_of(0), settings('constant_pose')
    with Localizer(CUP, of) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(0)
        for number in range(11):
            estimate = tracker.track(volume(context, pose, number), rng)
            for name in ('support', 'evidence'):  # three times 0.5 nat / px below is too little
                less = {name: getattr(estimate, name) - 1.8}
                assert tracker._believed(replace(estimate, **less)) == (number < 9)
                less = {name: getattr(estimate, name) - 1.2}
                assert tracker._believed(replace(estimate, **less))


def test_what_has_less_evidence_than_usual_is_looked_for_elsewhere(context):
    other = START.copy()
    other[:3, 3] += 0.09, -0.03, 0.04
    frames = [(volume(context, START, number, strength=3.0), START) for number in range(12)]
    weaker = volume(context, START, 12, strength=2.0)
    there = volume(context, other, 12, strength=3.0)
    both = replace(weaker, edges=replace(weaker.edges, tensor=np.maximum(
        weaker.edges.tensor, there.edges.tensor)))
    for check, truth in ((10_000, other), (0, START)):  # long before it is due; never
        found = tracked([*frames, (both, truth)], settings('constant_pose', track_check=check))
        assert [each.mode for each in found[1:-1]] == ['followed'] * 11
        assert found[-1].mode == ('default' if check else 'followed')
        assert pose_error(found[-1].pose, truth, CUP.axis).translation < 0.005


@pytest.mark.parametrize(('check', 'strength', 'moves_to_the_other'), [
    (3, 2.0, True), (0, 2.0, False), (3, 0.7, False)])
def test_what_has_far_more_evidence_elsewhere_is_followed_instead(
        context, check, strength, moves_to_the_other):
    other = START.copy()
    other[:3, 3] += 0.09, -0.03, 0.04
    alone = [volume(context, START, number, strength=1.5) for number in range(2)]
    second = [volume(context, other, number, strength=strength) for number in range(2, 8)]
    both = [replace(each, edges=replace(each.edges, tensor=np.maximum(
        each.edges.tensor, alone[0].edges.tensor))) for each in second]
    frames = [(each, START) for each in (*alone, *both)]
    estimates = tracked(frames, settings('constant_pose', track_check=check))
    # The fourth is the third that is followed; then it goes on from where the object is.
    there = [pose_error(each.pose, other, CUP.axis).translation < 0.005 for each in estimates]
    assert there == [False] * 3 + [moves_to_the_other] * 5
    followed = ['default'] + ['followed'] * 7
    if moves_to_the_other:
        followed[3] = 'default'
    assert [each.mode for each in estimates] == followed
    for each in estimates[:3] if moves_to_the_other else estimates:
        assert pose_error(each.pose, START, CUP.axis).translation < 0.005
    assert not any(each.lost for each in estimates)


def test_a_track_ends_when_the_prediction_says_no_more_than_the_region(context, frames):
    (first, pose), empty = frames[0], frames[3][0]
    late = replace(empty, header=Header(400 * PERIOD),
                   edges=replace(empty.edges, header=Header(400 * PERIOD)))
    estimates = tracked([(first, pose), (late, pose)], settings('constant_pose'))
    assert [each.mode for each in estimates] == ['default', 'default']
    assert estimates[1].lost


def test_an_old_capture_is_searched_by_itself(frames):
    of = settings('constant_velocity')
    with Localizer(CUP, of) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(0)
        modes = [tracker.track(frames[number][0], rng).mode for number in (1, 1, 0, 1)]
        assert modes == ['default', 'default', 'default', 'followed']
        tracker.reset()
        assert tracker.track(frames[2][0], rng).mode == 'default'


def test_without_tracking_it_is_the_single_shot(frames):
    of = settings('none')
    with Localizer(CUP, of) as localizer:
        rng = np.random.default_rng(0)
        alone = [localizer.localize(each, rng) for each, _ in frames[:2]]
    for one, other in zip(alone, tracked(frames[:2], of), strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)


def test_the_prior_is_a_part_of_the_posterior(frames):
    seen, pose = frames[0]
    off = pose.copy()
    off[2, 3] += 0.006  # along the line of sight, where a contour says least
    results = []
    for sigma in (0.03, 0.0005):
        spread = np.diag(np.repeat([sigma ** 2, 0.05 ** 2], 3))
        with Localizer(CUP, settings('constant_pose')) as localizer:
            results.append(localizer.follow(seen, Gaussian.of(off, spread, CUP.axis),
                                            np.random.default_rng(0), 64, 256))
    loose, tight = (pose_error(each.pose, pose, CUP.axis).ray for each in results)
    assert abs(loose) < 0.003
    assert tight > max(loose, 0) + 0.001


def test_a_prior_that_is_out_of_view_finds_nothing(frames):
    away = pose_of(Rotation.identity(), np.array([3.0, 0, 0.4]))
    spread = np.diag(np.repeat([1e-4, 1e-3], 3))
    with Localizer(CUP, settings('constant_pose')) as localizer:
        estimate = localizer.follow(frames[0][0], Gaussian.of(away, spread, CUP.axis),
                                    np.random.default_rng(0), 64, 256)
    assert estimate.lost
    assert len(estimate.particles) == 64


def test_the_paper_s_filter_tracks_nothing():
    with pytest.raises(SettingsError, match='needs mode default, it is faithful'):
        TrackingSettings.make({'tracking': 'constant_pose', 'mode': 'faithful'})


@pytest.mark.parametrize('check', [2, 0])  # searched in vain before, or only then
def test_what_often_shows_in_part_is_known_by_its_own_past(context, check):
    # A card before it moves to and fro, at last so far that a single shot does not believe it.
    whole = volume(context, START, 0)
    columns = np.flatnonzero(depth_of(context, CUP, START, CAMERA, 1).any(axis=0))

    def covered(part, number):
        tensor = whole.edges.tensor.copy()
        tensor[:, :round(columns[0] + part * np.ptp(columns))] = 0.05, 0.05, 0
        header = Header(number * PERIOD)
        return volume_with(replace(whole.edges, header=header, tensor=tensor)), START

    parts = [0, 0.03, 0.05] * 4 + [0.25] * 3
    of = settings('constant_pose', track_check=check)
    slid = [covered(part, number) for number, part in enumerate(parts)]
    estimates = tracked(slid, of)
    assert not any(each.lost for each in estimates)
    assert all(each.incomplete for each in estimates[-3:])
    assert all(each.translation < 0.02 for each in errors(estimates, slid))
    with Localizer(CUP, of) as localizer:
        alone = localizer.localize(slid[-1][0], np.random.default_rng(0))
    assert alone.lost
    assert alone.incomplete
    # All at once it is not: it is usually seen whole.
    sudden = tracked([*(covered(0, number) for number in range(12)), slid[12]], of)
    assert [each.lost for each in sudden] == [False] * 12 + [True]


def test_an_incomplete_contour_is_believed_for_a_while_where_it_is_followed(context):
    with Localizer(CUP, of := settings('constant_pose', track_check=2)) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(0)
        for number in range(12):
            estimate = tracker.track(volume(context, START, number), rng)
    partly = replace(estimate, lost=True, incomplete=True)
    confirmed, tracker._followed = tracker._confirmed, 30
    assert confirmed > 0
    assert tracker._believed(partly)
    assert not tracker._believed(replace(partly, mode='default'))
    assert not tracker._believed(replace(partly, support=partly.support - 0.7))
    for name, value in (('_followed', 31), ('_confirmed', 0), ('_seen', False)):
        before = getattr(tracker, name)
        setattr(tracker, name, value)
        assert not tracker._believed(partly)
        setattr(tracker, name, before)
    # What is seen of it in part does not become usual.
    tracker._usual.remember = lambda _: pytest.fail('it was remembered')
    tracker._looked = lambda *_: replace(partly, lost=False)
    tracker.track(volume(context, START, 12), rng)


@pytest.mark.parametrize('elsewhere', [False, True])
def test_what_is_found_again_where_it_was_foreseen_need_not_be_confirmed(context, elsewhere):
    there = START.copy()
    there[:3, 3] += (0.09, -0.03, 0.04) if elsewhere else (0.005, 0.005, 0)
    of = settings('constant_pose', track_check=2, track_sigma_translation=0.005)
    with Localizer(CUP, of) as localizer:
        tracker, rng = Tracker(localizer, CUP, of), np.random.default_rng(0)
        for number in range(12):
            tracker.track(volume(context, START, number), rng)
        confirmed = tracker._confirmed
        assert confirmed > 0
        assert tracker.track(volume(context, START, 12, hidden=True), rng).lost
        again = tracker.track(volume(context, there, 13), rng)
    assert not again.lost
    assert pose_error(again.pose, there, CUP.axis).translation < 0.005
    assert tracker._confirmed == (0 if elsewhere else confirmed)
    tracker.reset()
    assert tracker._confirmed == 0
