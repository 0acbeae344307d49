"""Where to look next: what is told of a view against that view, taken."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from command_line import Runner
from pmcl_scenes import COARSE
from test_multi_view import (
    CUP,
    MIDDLE,
    ROI,
    around,
    error,
    found,
    maps_seen,
    settings,
    truth_of,
)

from pmcl_ros.cli import main
from pmcl_ros.geometry.se3 import retract
from pmcl_ros.pmcl.multi_view.next_view import (
    NextView,
    angles_around,
    cap,
    next_views,
    position_sigma,
)
from pmcl_ros.pmcl.multi_view.view_by_view import sigmas_by_views
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera


@pytest.fixture(scope='module')
def seen(_session_context):
    _session_context.use()
    truth, cameras = truth_of(CUP), around([0, 8, 20, 45, 70])
    return truth, cameras, maps_seen(_session_context, CUP, truth, cameras)


def test_the_farther_round_the_surer_and_as_sure_as_it_will_be(seen):
    truth, cameras, evidence = seen
    two = replace(evidence, views=evidence.views[:2])
    pose = found(CUP, two).pose
    away = cameras[4].copy()
    away[:3, :3] = away[:3, :3] @ np.diag([1, -1, -1])  # it looks the other way
    told = next_views(two, CUP, settings(), pose, np.array([*cameras[1:], away]), COARSE)
    by_place = {tuple(each.camera[:3, 3].round(6)): each for each in told[::-1]}
    order = [by_place[tuple(camera[:3, 3].round(6))].sigma for camera in cameras[1:4]]
    assert order == sorted(order, reverse=True)
    assert [each.sigma for each in told] == sorted(each.sigma for each in told)
    behind = next(each for each in told if np.array_equal(each.camera, away))
    assert behind.sigma == behind.now
    assert told[0].sigma < 0.6 * told[0].now
    # With that view the pose is about as sure as was told.
    three = replace(evidence, views=(*two.views, evidence.views[3]))
    taken = found(CUP, three)
    assert error(CUP, taken.pose, truth)[0] < 1
    there = next(each for each in told if np.array_equal(each.camera, cameras[3]))
    after = next_views(three, CUP, settings(), taken.pose, cameras[:1], COARSE)[0].now
    assert after == pytest.approx(there.sigma, rel=0.35)
    assert after == pytest.approx(sigmas_by_views(three, CUP, settings(), taken.pose)[-1],
                                  rel=1e-4)


def test_the_same_view_again_brings_little(seen):
    _, cameras, evidence = seen
    one = replace(evidence, views=evidence.views[:1])
    pose = found(CUP, one).pose
    told = next_views(one, CUP, settings(), pose, np.array(cameras[:4]), COARSE)
    assert np.array_equal(told[-1].camera, cameras[0])
    assert told[-1].sigma > 0.85 * told[-1].now


def test_where_no_view_shows_a_pose_one_that_does_brings_all(seen):
    truth, cameras, evidence = seen
    aside = np.eye(4)
    aside[0, 3] = 0.5
    told = next_views(evidence, CUP, settings(), aside @ truth,
                      np.stack([cameras[1], aside @ cameras[1]]), COARSE)
    np.testing.assert_array_equal(told[0].camera, aside @ cameras[1])
    assert told[0].sigma < 0.1 * told[0].now
    assert told[1].sigma == told[1].now == told[0].now


def test_the_reference_frame_is_of_no_account(seen):
    truth, cameras, evidence = seen
    frame = np.eye(4)  # axes change places: a region stays a region
    frame[:3, :3], frame[:3, 3] = [[0, -1, 0], [0, 0, 1], [-1, 0, 0]], [0.3, -0.2, 0.1]
    told = []
    for by in (np.eye(4), frame):
        two = replace(evidence, views=tuple(
            replace(each, camera_to_reference=by @ each.camera_to_reference)
            for each in evidence.views[1:3]))
        of = settings(by[:3, :3] @ MIDDLE + by[:3, 3], tuple(np.abs(by[:3, :3]) @ ROI))
        told.append(next_views(two, CUP, of, by @ truth, by @ cameras, COARSE))
    for one, other in zip(*told, strict=True):
        np.testing.assert_allclose(other.camera, frame @ one.camera, atol=1e-12)
        assert (other.sigma, other.now) == pytest.approx((one.sigma, one.now), rel=1e-3)


def test_errors_of_camera_poses_limit_what_a_view_brings(seen):
    _, cameras, evidence = seen
    two = replace(evidence, views=evidence.views[:2])
    sigma = 0.003  # m
    by_common = {}
    for common in (0.0, 1.0):
        views = tuple(replace(each, sigma=(sigma, 0.0), group='arm', common=common)
                      for each in two.views)
        uncertain = replace(two, views=views)
        pose = found(CUP, uncertain)
        assert not pose.lost
        told = next_views(uncertain, CUP, settings(), pose.pose, cameras[3:4], COARSE)[0]
        # It is as sure as the estimate's own covariance says.
        assert told.now == pytest.approx(position_sigma(pose.covariance), rel=0.25)
        assert told.now == pytest.approx(
            sigmas_by_views(uncertain, CUP, settings(), pose.pose)[-1], rel=1e-4)
        by_common[common] = told
    exact = next_views(two, CUP, settings(), pose.pose, cameras[3:4], COARSE)[0]
    # What is common to all views moves all that they see: no view takes it away.
    assert by_common[1.0].sigma >= sigma
    for mode in 'now', 'sigma':
        assert getattr(by_common[1.0], mode) == pytest.approx(
            np.hypot(sigma, getattr(exact, mode)), rel=0.1)
    # What is not averages out, and a third view counts as one of three.
    assert exact.sigma < by_common[0.0].sigma < by_common[0.0].now
    assert by_common[0.0].now > exact.now


@pytest.mark.parametrize('draw', [3, 5])
def test_errors_that_are_larger_than_stated_are_no_news_to_it(seen, draw):
    """What is told now is the covariance's, but for what the sample has beside the mode.

    Of the second draw chance let motions that the views hardly see pass for very large errors.
    """
    _, cameras, evidence = seen
    off = np.random.default_rng(draw).normal(size=(5, 6)) * np.repeat([0.0005, 0.0015], 3)
    told = cameras @ retract(np.tile(np.eye(4), (5, 1, 1)), off)
    stated = replace(evidence, views=tuple(
        replace(each, camera_to_reference=camera, sigma=(0.0002, 0.0006), group='arm', common=0.5)
        for each, camera in zip(evidence.views, told, strict=True)))
    estimate = found(CUP, stated)
    now = next_views(stated, CUP, settings(), estimate.pose, cameras[:1], COARSE)[0].now
    assert now == pytest.approx(position_sigma(estimate.covariance), rel=0.1)
    assert 0.0007 < now < 0.002
    assert now == pytest.approx(sigmas_by_views(stated, CUP, settings(), estimate.pose)[-1],
                                rel=1e-4)


def test_a_cap_is_spread_about_the_views_and_looks_at_the_object():
    pose, cameras = truth_of(CUP), around([-10, 10])
    made = cap(pose, cameras, 90, 200)
    away = pose[:3, 3] - made[:, :3, 3]
    distance = np.linalg.norm(away, axis=1)
    np.testing.assert_allclose(distance, distance[0])
    assert distance[0] == pytest.approx(np.linalg.norm(MIDDLE), rel=0.1)
    np.testing.assert_allclose(made[:, :3, 2], away / distance[:, None], atol=1e-12)
    np.testing.assert_allclose(made[:, :3, :3] @ made[:, :3, :3].transpose(0, 2, 1),
                               np.tile(np.eye(3), (200, 1, 1)), atol=1e-12)
    mean = made[:, :3, 2].mean(axis=0)
    angles = np.rad2deg(np.arccos(made[:, :3, 2] @ mean / np.linalg.norm(mean)))
    assert 40 < angles.max() < 50
    around_views = angles_around(pose, cameras, made)
    middle = sum(camera[:3, 3] - pose[:3, 3] for camera in cameras)
    np.testing.assert_allclose(np.linalg.norm(around_views, axis=1), np.rad2deg(np.arccos(
        -made[:, :3, 2] @ middle / np.linalg.norm(middle))), atol=0.5)
    # To the right and up, as the cameras see it, which have y down.
    right, down = (made[:, :3, 3] - made[:, :3, 3].mean(axis=0))[:, :2].T
    assert np.corrcoef(around_views[:, 0], right)[0, 1] > 0.98
    assert np.corrcoef(around_views[:, 1], -down)[0, 1] > 0.98
    # Even on the sphere: half of the area is within 32.0 degrees of the axis.
    half = np.rad2deg(np.arccos((1 + np.cos(np.deg2rad(45))) / 2))
    assert (angles < half).mean() == pytest.approx(0.5, abs=0.03)


def test_the_command_prints_what_was_found(tmp_path):
    camera = {'width': 160, 'height': 120, 'fx': 150.0, 'cx': 80.0, 'cy': 60.0}
    OrdinaryCamera.make(camera)
    (tmp_path / 'camera.yaml').write_text(str(camera))
    runner = Runner()
    made = runner.invoke(main, [
        'scenes', 'render', '--camera', str(tmp_path / 'camera.yaml'), '--cameras', 'arc:2:30',
        '--count', '1', '--seed', '5', '--kind', 'opaque', '--samples', '4', '-o',
        str(tmp_path / 'out')])
    assert made.exit_code == 0, made.output
    folder = tmp_path / 'out' / '000005'
    truth = json.loads((folder / 'truth.json').read_text())
    roi = [str(each) for each in (*truth['roi']['center'], *truth['roi']['size'])]
    command = ['next-view', str(folder), '--object', str(folder / 'model.obj'), '--roi', *roi]
    first = yaml.safe_load((folder / 'views.yaml').read_text())['views'][0]['camera_to_reference']
    (tmp_path / 'candidates.yaml').write_text(yaml.safe_dump({'poses': [first]}))
    result = runner.invoke(main, [*command, '--json'])
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout.splitlines()[-1])  # click 8.1 mixes in stderr
    assert len(told['views']) == 40
    sigmas = [each['sigma'] for each in told['views']]
    assert sigmas == sorted(sigmas)
    assert sigmas[0] < told['sigma_now']
    result = runner.invoke(main, [*command, '--candidates', str(tmp_path / 'candidates.yaml')])
    assert result.exit_code == 0, result.output
    now, only = result.stdout.splitlines()[-2:]
    assert now == f'now: {1e3 * told["sigma_now"]:.2f} mm'
    place = ', '.join(f'{each:.3f}' for each in np.reshape(first, (4, 4))[:3, 3])
    assert f' mm with a view from ({place}) m, looking along (' in only
    (tmp_path / 'map.yaml').write_text(yaml.safe_dump({'frame': 'map', 'poses': [first]}))
    result = runner.invoke(main, [*command, '--candidates', str(tmp_path / 'map.yaml')])
    assert result.exit_code == 1
    assert "map.yaml is in frame 'map', the views are in 'room': change one" in result.output
    # The report says the same.
    page = runner.invoke(main, ['report', str(folder), '-o', str(tmp_path / 'page.html')])
    assert page.exit_code == 0, page.output
    text = (tmp_path / 'page.html').read_text()
    best = NextView(np.reshape(told['views'][0]['camera_to_reference'], (4, 4)), sigmas[0],
                    told['sigma_now'])
    assert (re.search('id="advice">(.*?)<', text).group(1).replace('&#43;', '+')
            == f'{1e3 * best.now:.2f} mm now, {best.describe()} in room.')
    assert 'alt="how sure it is, view by view"' in text
    assert 'alt="what a next view is expected to bring"' in text
    for number in range(2):
        assert f'View {number}, with the outline and the axes at the estimate.' in text
        assert text.count(f'<title>view {number}</title>') == 1
    assert 'View 2, ' not in text
    empty = runner.invoke(main, [*command[:-6], '0', '0', '5', '0.1', '0.1', '0.1'])
    assert empty.exit_code != 0
    assert 'sees the region' in empty.output
