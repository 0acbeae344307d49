"""Unusable pictures: each fault is told of the picture that has it, and of no other one."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from textured_planes import MIDDLE, around, views_of_planes

from pmcl_ros.lightfield.posed_view import GAMMA
from pmcl_ros.lightfield.unusable_pictures import unusable_pictures

RNG = np.random.default_rng(0)


VIEWS = tuple(views_of_planes(around([-20, 0, 20])))


def told(views):
    height, width = views[0].picture.shape[:2]
    part = width // 4, height // 4, width // 2, height // 2
    return unusable_pictures(views, dict.fromkeys(range(len(views)), part), MIDDLE)


def with_picture(number, picture, views=VIEWS):
    made = list(views)
    made[number] = replace(views[number], picture=np.clip(picture, 0, 1).astype(np.float32))
    return tuple(made)


def exposed(view, factor):
    """Its picture in `factor` times the light."""
    return (factor * view.linear()).clip(0, 1) ** (1 / GAMMA)


def moved(view, direction, length=9):
    """Its picture by a camera that moved along x, or y, during the exposure."""
    kernel = np.full((1, length) if direction == 'x' else (length, 1), 1 / length)
    return cv2.filter2D(view.linear(), -1, kernel).clip(0, 1) ** (1 / GAMMA)


def noisy(picture, sigma=0.004):
    return picture + RNG.normal(0, sigma, picture.shape)


@pytest.mark.parametrize('count', [1, 2, 3])
def test_nothing_is_told_of_good_pictures(count):
    assert not told(VIEWS[:count])


@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize(('factor', 'share', 'fault'), [
    (1000, r'\d\d', 'white: expose it less'), (1e-4, '99', 'below 1 % of white: expose it more')])
def test_a_white_or_black_picture_is_told(number, factor, share, fault):
    line, = told(with_picture(number, exposed(VIEWS[number], factor)))
    assert re.fullmatch(f'{share} % of the pixels of view {number} that can show the object are '
                        f'{fault}', line)


def test_a_single_picture_is_told_too():
    line, = told(with_picture(0, exposed(VIEWS[0], 1000), VIEWS[:1]))
    assert re.fullmatch(r'\d\d % of the pixels of the picture that can show the object are white: '
                        'expose it less', line)


@pytest.mark.parametrize('factor', [0.15, 0.5, 2])
def test_a_picture_in_other_light_is_as_good(factor):
    assert not told(with_picture(1, exposed(VIEWS[1], factor)))


@pytest.mark.parametrize('number', range(3))
@pytest.mark.parametrize('direction', ['x', 'y'])
def test_a_picture_that_is_blurred_in_one_direction_is_told(number, direction):
    line, = told(with_picture(number, noisy(moved(VIEWS[number], direction))))
    assert line.startswith(f'view {number} is blurred: ')


def test_a_picture_that_is_out_of_focus_is_told_by_its_name():
    views = with_picture(1, noisy(cv2.GaussianBlur(VIEWS[1].picture, (0, 0), 2.5)))
    named = (views[0], replace(views[1], name='left/001.png'), views[2])
    line, = told(named)
    assert line.startswith('view 1 (left/001.png) is blurred: ')


def test_which_of_two_pictures_is_blurred_is_not_told():
    assert not told(with_picture(1, moved(VIEWS[1], 'x'), VIEWS[:2]))


def test_a_softer_lens_and_a_covered_one_are_not_blurred():
    soft = cv2.GaussianBlur(VIEWS[1].picture, (0, 0), 2.5)
    other = replace(VIEWS[1].pinhole, fx=VIEWS[1].pinhole.fx + 1)
    assert not told((VIEWS[0], replace(VIEWS[1], picture=soft, pinhole=other), VIEWS[2]))
    assert not told(with_picture(1, noisy(np.full_like(soft, 0.4))))


def test_a_nearer_camera_that_sees_less_detail_is_not_blurred():
    cameras = around([-20, 0, 20])
    cameras[1, :3, 3] += 0.4 * (MIDDLE - cameras[1, :3, 3])
    soft = cv2.GaussianBlur(VIEWS[1].picture, (0, 0), 2.5)
    nearer = replace(VIEWS[1], picture=soft, camera_to_reference=cameras[1])
    assert not told((VIEWS[0], nearer, VIEWS[2]))
    assert told(with_picture(1, soft))


def test_a_sharp_gripper_in_the_mask_does_not_hide_the_blur():
    views = []
    for number, each in enumerate(VIEWS):
        picture = moved(each, 'x') if number == 1 else each.picture.copy()
        picture[::2, :picture.shape[1] // 3] = 1
        picture[1::2, :picture.shape[1] // 3] = 0
        picture[:, :picture.shape[1] // 3:2] = 0.5
        mask = np.ones(picture.shape[:2], bool)
        mask[:, :picture.shape[1] // 3 + 8] = False
        views.append(replace(each, picture=picture.astype(np.float32), mask=mask))
    line, = told(tuple(views))
    assert line.startswith('view 1 is blurred: ')


@pytest.mark.parametrize(('one', 'other'), [(0, 1), (1, 2), (0, 2)])
def test_a_repeated_picture_is_told_with_other_noise_and_in_other_light(one, other):
    line, = told(with_picture(other, noisy(exposed(VIEWS[one], 0.7))))
    assert line.startswith(f'view {one} and view {other} show the same, ')


def test_pictures_from_one_place_may_show_the_same():
    views = tuple(views_of_planes(around([-20, 0, 0, 20])))
    assert not told(views)


@pytest.mark.parametrize('contrast', [1, 0], ids=['textured', 'plain'])
def test_a_gripper_at_the_same_place_is_not_the_same_picture(contrast):
    given = views_of_planes(around([-20, 0, 20]), contrast=contrast)
    width = given[0].picture.shape[1] // 3
    textured = RNG.random((given[0].picture.shape[0], width, 3), np.float32)
    views = []
    for each in given:
        picture = each.picture.copy()
        picture[:, :width] = textured
        views.append(replace(each, picture=picture))
    assert not told(tuple(views))
