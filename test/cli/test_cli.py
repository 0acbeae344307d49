"""The command line on real captures."""

import csv
import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import pmcl, pmcl_process
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.files import list_pictures
from pmcl_ros.camera.packing import pack12
from pmcl_ros.geometry.pose_error import pose_error
from pmcl_ros.geometry.symmetry import Symmetry
from pmcl_ros.geometry.truth import Truth
from pmcl_ros.lightfield.readers.npz import write_npz
from pmcl_ros.lightfield.readers.read import read_light_field
from pmcl_ros.messages.bags import Recorded, read, record
from pmcl_ros.runtime.binary_file import sha256

ROOT = Path(__file__).parents[2]
CAMERA = ['--calibration', str(ROOT / 'config/cameras/demo.yaml'),
          '--white', str(ROOT / 'config/cameras/demo_white.RAW.xz')]
NAMES = ('wine_glass', 'shaker')


@pytest.fixture(scope='module')
def captures(tmp_path_factory):
    """A folder of captures as the camera leaves them on disk, out of the shipped bags."""
    folder = tmp_path_factory.mktemp('captures')
    types = get_typestore(Stores.ROS2_JAZZY)
    for name in NAMES:
        target = folder / name
        target.mkdir()
        messages = {each.topic: types.deserialize_cdr(each.cdr, each.type)
                    for each in read(ROOT / 'bags' / name)}
        counts = messages['/image_raw'].data.view(np.uint16).reshape(3280, 3280)
        (target / 'IMG.RAW').write_bytes(pack12(counts))
        (target / 'IMG.TXT').write_text(messages['/metadata'].data)
        shutil.copy(ROOT / 'bags' / name / 'truth.json', target)
        shutil.copy(ROOT / 'models' / f'{name}.obj', target / 'model.obj')
    white = folder / 'white'
    white.mkdir()
    shutil.copy(ROOT / 'config/cameras/demo_white.RAW.xz', white / 'IMG.RAW.xz')
    shutil.copy(ROOT / 'config/cameras/demo_white.TXT', white / 'IMG.TXT')
    return folder


def test_localize_prints_one_json_object_with_the_pose(captures, tmp_path):
    capture = captures / 'shaker'
    truth = Truth.load(capture / 'truth.json')
    done = pmcl_process('localize', capture / 'IMG.RAW', *CAMERA, '--object',
                        capture / 'model.obj', '--roi', *truth.roi_center, *truth.roi_size,
                        '--seed', 3, '--json', '--out', tmp_path)
    result = json.loads(done.stdout)
    assert set(result) == {'position', 'orientation_xyzw', 'covariance', 'score', 'lost',
                           'support', 'evidence', 'least_support', 'least_evidence',
                           'least_weight', 'modes', 'timings_ms'}
    for name in ('support', 'evidence'):
        assert result[name] >= result[f'least_{name}']
    assert sum(each['weight'] for each in result['modes']) == pytest.approx(1)
    assert set(result['timings_ms']) == {'decode', 'dlv', 'pmcl'}
    assert result['lost'] is False
    assert np.linalg.norm(result['orientation_xyzw']) == pytest.approx(1)
    covariance = np.reshape(result['covariance'], (6, 6))
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(result['orientation_xyzw']).as_matrix()
    pose[:3, 3] = result['position']
    error = pose_error(pose, truth.pose, Symmetry(np.array([0, 0, 1.0])))
    assert error.translation < 0.02
    assert np.rad2deg(error.rotation) < 10
    for picture, size in (('centre', (328, 328)), ('overlay', (984, 984))):
        assert cv2.imread(str(tmp_path / f'{picture}.png')).shape[:2] == size
    assert (tmp_path / 'depth.png').exists()


def test_errors_are_one_line_that_says_what_to_do(captures, tmp_path):
    shutil.copy(captures / 'wine_glass/IMG.TXT', tmp_path)
    cut = tmp_path / 'IMG.RAW'
    cut.write_bytes((captures / 'wine_glass/IMG.RAW').read_bytes()[:-1])
    done = pmcl('decode', cut, *CAMERA, '--out', tmp_path / 'out', status=1)
    assert '16137599 bytes, expected 16137600' in done.stderr
    assert not (tmp_path / 'out').exists()


@pytest.fixture(scope='module')
def decoded(captures, tmp_path_factory):
    """The folder that `pmcl decode` made of a capture, with its object and truth."""
    folder = tmp_path_factory.mktemp('decoded') / 'glass'
    done = pmcl('decode', captures / 'wine_glass/IMG.RAW', *CAMERA[:2], '--white', captures,
                '--out', folder)
    # Chosen among all pictures of the folder, and told.
    assert 'white image: IMG.RAW.xz of camera A000000001' in done.stderr
    assert 'zoom step 600 (picture: 600)' in done.stderr
    for each in ('truth.json', 'model.obj'):
        shutil.copy(captures / 'wine_glass' / each, folder)
    return folder


def test_decode_writes_rectified_views(decoded):
    with np.load(decoded / 'views.npz') as found:
        assert found['views'].shape == (9, 9, 328, 328, 3)
        assert found['views'].dtype == np.float32
        assert float(found['baseline']) == pytest.approx(0.00073975, rel=1e-4)
        assert {'fx', 'fy', 'cx', 'cy', 'weights', 'positions'} <= set(found)
    assert cv2.imread(str(decoded / 'views.png')) is not None


@pytest.fixture(scope='module')
def coarse(decoded, tmp_path_factory):
    """The same capture with pixels of twice the size."""
    folder = tmp_path_factory.mktemp('coarse') / 'coarse'
    folder.mkdir()
    write_npz(folder / 'views.npz', read_light_field(decoded, shrink=2))
    for each in ('truth.json', 'model.obj'):
        shutil.copy(decoded / each, folder)
    return folder


def localize(capture, *more, roi, status=0):
    return pmcl('localize', capture, '--object', capture / 'model.obj', '--roi', *roi, *more,
                status=status)


def test_a_light_field_is_localised_in_without_a_calibration(decoded, tmp_path):
    truth = Truth.load(decoded / 'truth.json')
    done = localize(decoded, '--shrink', 2, '--json', '--out', tmp_path,
                    roi=[*truth.roi_center, *truth.roi_size])
    result = json.loads(done.stdout)
    assert result['lost'] is False
    assert np.linalg.norm(np.subtract(result['position'], truth.pose[:3, 3])) < 0.02
    assert cv2.imread(str(tmp_path / 'centre.png')).shape[:2] == (164, 164)


def test_a_region_where_nothing_is_is_lost_and_no_failure(coarse):
    # Beside and behind the glass: the table's pattern alone.
    done = localize(coarse, '--json', roi=[0.14, 0.02, 0.8, 0.04, 0.04, 0.04])
    assert json.loads(done.stdout)['lost'] is True


def test_negative_numbers_of_a_region_parse_in_every_notation(coarse):
    done = localize(coarse, roi=['-1e-3', '-.002', '-3', '.1', '.1', '.1'], status=1)
    assert 'in front of the camera' in done.stderr


@pytest.mark.parametrize(('arguments', 'status', 'reason'), [
    (['{raw}'], 2, 'is a raw picture: it needs --calibration and --white'),
    (['{folder}'], 1, 'no light_field.yaml, parameters.cfg or views.npz'),
    (['{picture}'], 2, 'write views.yaml beside it'),
    (['{part}'], 2, 'is a file of a bag: give its folder'),
])
def test_a_source_that_cannot_be_read_is_told(captures, arguments, status, reason):
    capture = captures / 'wine_glass'
    names = {'raw': capture / 'IMG.RAW', 'folder': capture, 'picture': capture / 'IMG.png',
             'part': ROOT / 'bags' / 'wine_glass' / 'wine_glass.mcap'}
    (capture / 'IMG.png').write_bytes(b'')
    done = pmcl('localize', *(each.format(**names) for each in arguments), '--object',
                capture / 'model.obj', '--roi', 0, 0, -0.5, 0.1, 0.1, 0.1, status=status)
    assert reason in ' '.join(done.stderr.split())


def test_evaluate_tabulates_trials(captures, coarse, tmp_path):
    """Of a raw picture, and of a light field that needs no calibration."""
    both = tmp_path / 'both'
    for each in (captures / 'wine_glass', captures / 'white', coarse):
        shutil.copytree(each, both / each.name)
    out = tmp_path / 'out'
    done = pmcl('evaluate', both, '--calibration', CAMERA[1], '--trials', 1, '--processes', 1,
                '--out', out)
    with (out / 'results.csv').open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row['capture'], row['mode'], row['seed']) for row in rows] == [
        ('coarse', 'default', '0'), ('wine_glass', 'default', '0')]
    assert all(float(row['translation_mm']) < 20 and row['lost'] == 'False' for row in rows)
    assert (out / 'results.md').read_text() == done.stdout
    for name in ('coarse', 'wine_glass'):
        assert f'| {name} | default | 1 |' in done.stdout
    white, = list_pictures(both / 'white')
    assert json.loads((out / 'settings.json').read_text())['files'][white.name] == sha256(white)


def test_calibration_from_truth_is_the_shipped_one(tmp_path):
    """The shown command made config/cameras/demo.yaml: its numbers are the truth files'."""
    lattice = {'pitch_px': 9.946375398862882, 'row_step_px': 8.613813770991834,
               'rotation': 0.0021, 'centre_px': [1641.81, 1637.76], 'note': 'ignored'}
    (tmp_path / 'white.json').write_text(json.dumps({'lattice': lattice}))
    pmcl('calibration-from-truth', ROOT / 'bags/wine_glass/truth.json', tmp_path / 'white.json',
         '--serial', 'A000000001', '--out', tmp_path / 'made.yaml')
    assert ((tmp_path / 'made.yaml').read_text()
            == (ROOT / 'config/cameras/demo.yaml').read_text())


def test_bag_record_makes_the_shipped_messages(captures, tmp_path):
    pmcl('bag', 'record', captures / 'shaker/IMG.RAW', tmp_path / 'bag')
    made = {each.topic: each for each in read(tmp_path / 'bag')}
    shipped = {each.topic: each for each in read(ROOT / 'bags/shaker')}
    assert made.keys() == shipped.keys()
    assert made['/metadata'].cdr == shipped['/metadata'].cdr
    # All but the stamp, which is the file's time.
    assert made['/image_raw'].cdr[12:] == shipped['/image_raw'].cdr[12:]


def test_bag_extract_gives_the_picture_back(captures, tmp_path):
    pmcl('bag', 'extract', ROOT / 'bags/shaker', tmp_path)
    for name in ('RAW', 'TXT'):
        assert ((tmp_path / f'IMG_0001.{name}').read_bytes()
                == (captures / f'shaker/IMG.{name}').read_bytes())


def test_a_bag_without_pictures_is_told(tmp_path):
    record(tmp_path / 'bag', [Recorded('/a', 'std_msgs/msg/String', 0, b'\0\1\0\0\1\0\0\0\0')])
    done = pmcl('bag', 'extract', tmp_path / 'bag', tmp_path / 'out', status=1)
    assert 'holds no /image_raw' in done.stderr
