"""One ordinary picture: localised, evaluated and reported as users do it, against known truth."""

import csv
import json

import numpy as np
import pytest
import yaml
from command_line import Runner
from scipy.spatial.transform import Rotation

from pmcl_ros.cli import main
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.pmcl.object_model import ObjectModel

CAMERA = {'width': 640, 'height': 480, 'fx': 600.0, 'cx': 322.0, 'cy': 238.0,
          'distortion': [-0.08, 0.02, 0.0, 0.001]}


def pmcl(*arguments):
    return Runner().invoke(main, [str(each) for each in arguments])


@pytest.fixture(scope='module')
def captures(tmp_path_factory):
    """A glossy stemmed glass, opaque, well in view."""
    folder = tmp_path_factory.mktemp('picture')
    (folder / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
    done = pmcl('scenes', 'render', '--camera', folder / 'camera.yaml', '--views', 1, '--count', 1,
                '--seed', 1, '--kind', 'opaque', '--samples', 8, '-o', folder / 'captures')
    assert done.exit_code == 0, done.output
    return folder / 'captures'


def region(capture):
    truth = Truth.load(capture / 'truth.json')
    return [*truth.roi_center, *truth.roi_size]


def test_the_object_is_found_where_it_is(captures, tmp_path):
    capture = captures / '000001'
    done = pmcl('localize', capture / 'views.yaml', '--object', capture / 'model.obj', '--roi',
                *region(capture), '--json', '--out', tmp_path, '--truth', capture / 'truth.json')
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert not found['lost']
    assert 'off by' in done.stderr
    pose = np.eye(4)
    x, y, z, w = found['orientation_xyzw']
    pose[:3, :3], pose[:3, 3] = Rotation.from_quat([x, y, z, w]).as_matrix(), found['position']
    model = ObjectModel.load(capture / 'model.obj')
    truth = Truth.load(capture / 'truth.json').pose
    error = pose_error(pose, truth, model.symmetry)
    assert error.translation < 0.02
    assert error.rotation < np.deg2rad(10)
    # One view hardly tells the depth, and the covariance says so.
    covariance = np.reshape(found['covariance'], (6, 6))[:3, :3]
    ray = truth[:3, 3] / np.linalg.norm(truth[:3, 3])
    across = np.linalg.svd(ray[None])[2][1:]
    assert np.sqrt(ray @ covariance @ ray) > 3 * np.sqrt(
        np.trace(across @ covariance @ across.T) / 2)
    assert {each.name for each in tmp_path.glob('[!.]*')} == {'centre.png', 'overlay.png'}


def test_it_is_evaluated_as_light_fields_are(captures, tmp_path):
    done = pmcl('evaluate', captures, '--trials', 1, '--processes', 1, '--out', tmp_path)
    assert done.exit_code == 0, done.output
    with (tmp_path / 'results.csv').open() as stream:
        row, = csv.DictReader(stream)
    assert float(row['translation_mm']) < 20
    assert float(row['axis_deg']) < 10
    assert (row['mode'], row['lost'], int(row['width_px'])) == ('default', 'False', 640)


def test_its_report_has_no_sections_of_several_views(captures, tmp_path):
    capture = captures / '000001'
    done = pmcl('report', capture, '-o', tmp_path / 'report.html')
    assert done.exit_code == 0, done.output
    page = (tmp_path / 'report.html').read_text()
    assert 'id="verdict">Found' in page
    assert '640 x 480 px' in page
    assert 'id="evidence"' in page
    for missing in ('id="epipolar"', 'id="volume"', 'all views'):
        assert missing not in page


def test_what_needs_several_views_is_refused_in_one_line(captures):
    capture = captures / '000001'
    done = pmcl('localize', capture, '--object', capture / 'model.obj', '--roi', *region(capture),
                '--mode', 'faithful')
    assert done.exit_code == 1
    assert 'needs a light field' in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1


def test_a_bag_is_not_of_a_picture_without_pose(captures, tmp_path):
    done = pmcl('bag', 'record', captures / '000001', tmp_path / 'bag')
    assert done.exit_code == 1
    assert 'is one picture without the pose of its camera' in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
