import json
from pathlib import Path

import pytest
import yaml

from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.calibration.lytro.lattice import Lattice
from pmcl_ros.runtime.errors import SettingsError

SHIPPED = Path(__file__).parents[4] / 'config' / 'cameras' / 'demo.yaml'
CAMERA = {'width': 30, 'height': 20, 'fx': 100 / 3, 'fy': 34.5, 'cx': 14.5, 'cy': 9.25,
          'focus_distance': 0.55, 'baseline_step': 1e-3, 'more': 'is left out'}
LATTICE = {'pitch_px': 9.95, 'row_step_px': 8.6, 'rotation': 2.1e-3, 'centre_px': [150.1, 99.9],
           'more': 'is left out'}


@pytest.fixture
def truths(tmp_path):
    """Paths of a capture's and the white image's truth.json."""
    capture, white = tmp_path / 'capture.json', tmp_path / 'white.json'
    capture.write_text(json.dumps({'camera': CAMERA}))
    white.write_text(json.dumps({'lattice': LATTICE}))
    return capture, white


def test_a_calibration_survives_its_file(truths, tmp_path):
    calibration = Calibration.from_truth(*truths, serial='A1')
    assert calibration.pinhole == Pinhole(30, 20, 100 / 3, 34.5, 14.5, 9.25)
    assert (calibration.baseline, calibration.focus_distance) == (1e-3, 0.55)
    assert calibration.lattice == Lattice(pitch_px=9.95, row_step_px=8.6, rotation=2.1e-3,
                                          centre_px=(150.1, 99.9))
    assert calibration.serial == 'A1'
    calibration.save(tmp_path / 'camera.yaml', 'of a test')
    assert Calibration.load(tmp_path / 'camera.yaml') == calibration


@pytest.mark.parametrize(('which', 'text', 'reason'), [
    (0, '{}', "capture.json.*KeyError.'camera'"),
    (1, '{}', "capture.json.*KeyError.'lattice'"),
    (0, json.dumps({'camera': {**CAMERA, 'fy': 0}}),
     r'capture.json.*fy: .* greater than 1 px \(got 0\)'),
    (1, '{', 'white.json is not valid JSON: Expecting'),
    (1, '[' * 100_000, 'white.json is not valid JSON: maximum recursion'),
    (1, '[]', 'white.json holds list, expected a mapping'),
    (0, json.dumps({'camera': {'fx': 1}}), "capture.json.*KeyError.'width'"),
])
def test_a_broken_truth_is_named(truths, which, text, reason):
    truths[which].write_text(text)
    with pytest.raises(SettingsError, match=reason):
        Calibration.from_truth(*truths)


def test_a_missing_truth_is_named(truths):
    truths[1].unlink()
    with pytest.raises(SettingsError, match=r'cannot read .*white.json: No such file'):
        Calibration.from_truth(*truths)


def test_the_shipped_calibration():
    calibration = Calibration.load(SHIPPED)
    assert calibration.pinhole.width == calibration.pinhole.height == 328
    assert calibration.lattice.pitch_px == pytest.approx(9.946, abs=1e-3)
    assert calibration.serial == 'A000000001'


@pytest.mark.parametrize(('change', 'reason'), [
    ({'focal': 1}, 'focal: there is no such key'),
    ({'fx': None}, 'fx: Input should be a valid number .got None'),
    ({'fx': 0}, 'fx: .*greater than 1 px .got 0'),
    ({'baseline': 0}, 'baseline: .*greater than 0 m .got 0'),
    ({'baseline': 0.74}, 'baseline: .*less than 0.1 m .got 0.74'),  # millimetres
    ({'focus_distance': -1}, 'focus_distance: .*greater than 0 m .got -1'),
    ({'width': 3280}, 'width: .*less than or equal to 2000 px .got 3280'),
    ({'cx': float('nan')}, 'cx: .*finite number .got nan'),
    ({'lattice': {}}, 'lattice.pitch_px: Field required; lattice.row_step_px: Field required'),
    ({'lattice': {**LATTICE, 'rotation': 90}}, 'lattice.rotation: .*less than 0.5 rad .got 90'),
    ({'lattice': {**LATTICE, 'centre_px': [1]}}, r'lattice.centre_px: number 2 is missing'),
])
def test_what_is_wrong_in_a_file_is_named(tmp_path, change, reason):
    path = tmp_path / 'camera.yaml'
    path.write_text(yaml.safe_dump({**yaml.safe_load(SHIPPED.read_text()), **change}))
    with pytest.raises(SettingsError, match=f'camera.yaml: .*{reason}'):
        Calibration.load(path)
