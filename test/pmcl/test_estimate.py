import json
from dataclasses import replace

import numpy as np
import pytest
from pmcl_scenes import pose_of
from scipy.spatial.transform import Rotation

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import local, retract, transform
from pmcl_ros.pmcl.estimate import PoseEstimate, PoseMode
from pmcl_ros.pmcl.multi_view.camera_errors import CameraScale


def make(lost=False):
    pose = pose_of(Rotation.from_euler('z', 90, degrees=True), [0.1, -0.02, 0.5])
    covariance = np.diag([1e-6, 4e-6, 9e-6, 0.01, 0.01, 0.01])
    return PoseEstimate(Header(3), pose, covariance, pose[None], np.zeros(1), 123.4, lost,
                        'default', (PoseMode(pose, 0.75, 12.0),))


def test_the_dictionary_is_what_the_command_line_promises():
    said = json.loads(json.dumps(make(lost=True).as_dict()))
    assert set(said) == {'position', 'orientation_xyzw', 'covariance', 'score', 'lost', 'modes'}
    assert said['position'] == [0.1, -0.02, 0.5]
    x, y, z, w = said['orientation_xyzw']
    np.testing.assert_allclose(np.array([x, y, z, w]) * np.sign(w), [0, 0, 0.5 ** 0.5, 0.5 ** 0.5],
                               atol=1e-12)
    assert said['covariance'] == make().covariance.ravel().tolist()
    assert said['score'] == 123.4
    assert said['lost'] is True
    assert said['modes'] == [{'position': [0.1, -0.02, 0.5], 'weight': 0.75, 'score': 12.0,
                              'orientation_xyzw': said['orientation_xyzw']}]
    assert replace(make(), hidden=(1, 3)).as_dict()['hidden_views'] == [1, 3]
    assert replace(make(), degrees_of_freedom=4.0).as_dict()['degrees_of_freedom'] == 4
    scale = CameraScale(0.02, 0.005)
    told = replace(make(), camera_scale=scale).as_dict()
    assert told['camera_scale'] == {'error': 0.02, 'sigma': 0.005}
    assert replace(make(), camera_scale=scale).diagnostics()['camera scale error [%]'] == 2
    assert replace(make(lost=True), camera_scale=scale).as_dict() == make(lost=True).as_dict()
    judged = {'support': 0.5, 'least_support': 0.36, 'evidence': 1.2, 'least_evidence': 1.03,
              'least_weight': 0.95}
    assert judged.items() <= replace(make(), **judged).as_dict().items()
    unlike = replace(make(), **judged | {'support': -np.inf}).as_dict()
    assert 'Infinity' not in json.dumps(unlike)
    assert judged.keys() - unlike.keys() == {'support'}


@pytest.mark.parametrize(('numbers', 'word', 'why'), [
    ({}, 'found', ''),
    ({'lost': True}, 'lost; best hypothesis', ''),
    ({'lost': True, 'least_weight': 0.95}, 'lost; best hypothesis',
     '; lost as other poses are as likely: this one has 75 % of the posterior; has it a '
     'symmetry to declare?'),
    ({'lost': True, 'least_weight': 0.95, 'support': 0.2, 'least_support': 2.45},
     'lost; best hypothesis',  # more support is needed as the weight is low
     '; lost as other poses are as likely: this one has 75 % of the posterior; has it a '
     'symmetry to declare?'),
    ({'lost': True, 'support': 0.2, 'least_support': 0.36}, 'lost; best hypothesis',
     '; lost as the weakest part of its contour has 0.20 nat/px of evidence, 0.36 are needed'),
    ({'lost': True, 'evidence': 0.9, 'least_evidence': 1.03}, 'lost; best hypothesis',
     '; lost as its contour has 0.90 nat/px of evidence, 1.03 are needed'),
    ({'lost': True, 'support': -np.inf}, 'lost; best hypothesis',
     '; nothing in view looks like it'),
])
def test_a_line_for_people(numbers, word, why):
    line = replace(make(), **numbers).describe()
    assert line.startswith(f'{word} at (0.1000, -0.0200, 0.5000) m, ')
    assert line.endswith(f'score 123, standard deviation (1.0, 2.0, 3.0) mm{why}')
    assert replace(make(), **numbers).as_dict().get('why_lost', '') == why.removeprefix('; ')


def test_it_is_the_same_in_another_frame_and_moves_as_a_whole():
    camera = transform((1, 2, 3), (0.3, -1, 0.4))
    root = 0.3 * np.random.default_rng(0).normal(size=(6, 6))
    given = replace(make(), covariance=root @ root.T, particles=retract(make().pose, root))
    found = given.in_frame(camera)
    np.testing.assert_allclose(found.pose, camera @ given.pose)
    np.testing.assert_allclose(found.modes[0].pose, camera @ given.modes[0].pose)
    np.testing.assert_allclose(found.particles, [camera @ each for each in given.particles])
    there = local(camera @ retract(given.pose, np.eye(6)), found.pose)  # (6, 6) of each axis
    np.testing.assert_allclose(found.covariance, there.T @ given.covariance @ there)
    moved = given.moved(root[0])
    for one, other in ((moved.pose, given.pose), (moved.particles[3], given.particles[3])):
        np.testing.assert_allclose(local(one[None], other)[0], root[0], atol=1e-12)
