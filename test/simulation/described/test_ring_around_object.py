"""A printed ring around the object of a simulated scene: it is where truth says."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from pmcl_ros.cli import main
from pmcl_ros.evaluation.captures import find_captures
from pmcl_ros.geometry.se3 import inverse
from pmcl_ros.lightfield.calibration.charuco_ring import CharucoRing
from pmcl_ros.lightfield.posed_view import PosedViews
from pmcl_ros.runtime.errors import SimulationError
from pmcl_ros.simulation.camera_plan import in_room
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.described.ring_sheet import RingSheet
from pmcl_ros.simulation.described.surroundings import (
    WITH_RING,
    DescribedSettings,
    Surroundings,
    described_scene,
)
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera

pytestmark = pytest.mark.skipif(not hasattr(getattr(cv2, 'aruco', None), 'CharucoDetector'),
                                reason='OpenCV before 4.7')
OBJECT = Path(__file__).parents[3] / 'config' / 'objects' / 'tumbler.yaml'
CAMERA = {'width': 560, 'height': 420, 'fx': 660.0, 'cx': 279.5, 'cy': 209.5, 'noise': 0.002}
RING = '--ring', '8x11', '--square', '0.024'


@pytest.mark.parametrize(('columns', 'rows'), [(8, 11), (11, 8), (5, 6)])
def test_corners_are_printed_where_the_ring_has_them(columns: int, rows: int) -> None:
    ring = CharucoRing(columns, rows, 0.024)
    sheet = RingSheet.from_ring(ring)
    texel = max(sheet.size) / len(sheet.grey)
    page = cv2.GaussianBlur(np.fft.fftshift(sheet.grey)[::-1], (0, 0), 1)  # as by a lens
    seen = ring.seen(np.rint(255 * page).astype(np.uint8))
    x, y = ring.points[:, :2].T / texel
    middle = len(page) // 2
    np.testing.assert_allclose(seen, np.stack([middle + x, len(page) - 1 - middle - y], axis=1),
                               atol=0.05)


@pytest.mark.parametrize('surroundings', WITH_RING)
@pytest.mark.parametrize('attitude', ['upright', 'lying'])
def test_the_object_stands_in_the_middle_and_nothing_else_on_it(
        surroundings: Surroundings, attitude: str) -> None:
    ring, item = RingSheet.from_ring(CharucoRing(8, 11, 0.024)), load_object(OBJECT)
    camera, around = OrdinaryCamera.make(CAMERA), []
    settings = DescribedSettings.make({'attitude': attitude, 'empty': 0})
    for seed in range(4):
        rng = np.random.default_rng(seed)
        scene = described_scene(rng, item, surroundings, camera.sensor(rng), settings, ring)
        room = in_room(scene, np.eye(4)[None])[0]
        pose = room @ scene.targets[0].pose
        vertices = item.vertices @ pose[:3, :3].T + pose[:3, 3]
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        assert 0 < low[2] < 3e-4
        if attitude == 'upright':  # it is shorter than the middle is wide then
            assert (abs(np.stack([low, high])[:, :2]) < np.array(ring.region[3:5]) / 2).all()
            around.append(pose[:3, 3])
        np.testing.assert_allclose((room @ scene.sheets[-1].pose), np.eye(4), atol=1e-12)
        for solid in scene.solids[scene.owners.count(0):]:
            at = (room @ solid.pose)[:2, 3]
            assert (abs(at) > np.array(ring.size) / 2).any()
        aside = room[:3, 3] - (low + high) / 2
        assert 24 < np.rad2deg(np.arcsin(aside[2] / np.linalg.norm(aside))) < 51
    if around:
        assert np.ptp(around, axis=0)[1] > 0.02


def test_it_tells_the_poses_of_the_cameras_of_path_traced_pictures(tmp_path: Path) -> None:
    camera, out = tmp_path / 'camera.yaml', tmp_path / 'out'
    camera.write_text(yaml.safe_dump(CAMERA))
    made = CliRunner().invoke(main, [
        'simulate', str(OBJECT), '--camera', str(camera), '--cameras', 'arc:2:40', '--samples',
        '8', '--surroundings', 'table', '--attitude', 'upright', '--region', '0.4:0.45',
        '--count', '1', '--seed', '3', *RING, '-o', str(out)])
    assert made.exit_code == 0, made.output
    capture, = find_captures(out)
    found = CliRunner().invoke(main, ['board-poses', str(capture.source), '--camera', str(camera),
                                      *RING, '--force'])
    assert found.exit_code == 0, found.output
    roi = ' '.join(f'{each:g}' for each in (*capture.truth.roi_center, *capture.truth.roi_size))
    assert f'--roi {roi} ' in found.output
    views = capture.read(None)
    assert isinstance(views, PosedViews)
    true = json.loads((capture.folder / 'truth.json').read_text())['cameras_to_reference']
    for view, exact in zip(views.views, true, strict=True):
        # As far as eight paths a pixel tell: where the ring is seen, and how it is turned
        off = inverse(view.camera_to_reference) @ exact
        np.testing.assert_allclose(off[:3, :3], np.eye(3), atol=2e-3)  # 0.6e-3 is stated
        origin = inverse(view.camera_to_reference)[:3, 3] - inverse(np.array(exact))[:3, 3]
        assert np.linalg.norm(origin[:2]) < 1e-4
        assert abs(origin[2]) < 2e-4


@pytest.mark.parametrize(('name', 'attitude', 'square', 'told'), [
    ('tumbler', 'upright', 0.024, None),
    ('tumbler', 'lying', 0.024, r'tumbler is 1[12]\d mm across where it lies'),
    ('tumbler', 'lying', 0.032, None), ('bottle', 'upright', 0.024, None),
    ('bottle', 'any', 0.024, r'96 x 168 mm, .* is 27\d mm .*: choose --attitude upright \(8\d mm'),
    ('bottle', 'upright', 0.02, r'80 x 140 mm, .* is 8\d mm across: choose a ring')])
def test_an_object_that_reaches_over_the_ring_is_refused(
        name: str, attitude: str, square: float, told: str | None) -> None:
    """What passes is where it is looked for, and off the markers, however it is drawn."""
    ring, item = RingSheet.from_ring(CharucoRing(8, 11, square)), load_object(
        OBJECT.with_stem(name))
    if told is not None:
        with pytest.raises(SimulationError, match=told):
            ring.check_holds(item, attitude)
        return
    ring.check_holds(item, attitude)
    camera, settings = OrdinaryCamera.make(CAMERA), DescribedSettings.make(
        {'attitude': attitude, 'empty': 0})
    for seed in range(8):
        rng = np.random.default_rng(seed)
        scene = described_scene(rng, item, 'table', camera.sensor(rng), settings, ring)
        pose = in_room(scene, np.eye(4)[None])[0] @ scene.targets[0].pose
        region = np.array(ring.region)
        assert (abs(pose[:3, 3] - region[:3]) < region[3:] / 2).all()
        vertices = item.vertices @ pose[:3, :3].T + pose[:3, 3]
        assert (abs(vertices[:, :2]) < region[3:5] / 2).all()


@pytest.mark.parametrize(('options', 'line'), [
    (('--ring', '8x11', '--cameras', 'arc:3:50'), '--ring and --square go together'),
    (RING, '--ring 8x11 --square 0.024: it tells the poses of several pictures; add --cameras'),
    ((*RING, '--cameras', 'arc:3:50', '--surroundings', 'tank'), 'tank: a ring lies on a table'),
    ((*RING, '--cameras', 'arc:3:50', '--region', '0.4:0.5:0.2'), 'leave the side out'),
    ((*RING, '--cameras', 'arc:3:50', '--attitude', 'lying'), 'choose --attitude upright'),
    (('--ring', '8', '--square', '0.024', '--cameras', 'arc:3:50'), "ring '8' is not like 8x11")])
def test_what_does_not_go_with_it_is_refused(tmp_path: Path, options: tuple[str, ...], line: str
                                             ) -> None:
    (tmp_path / 'camera.yaml').write_text(yaml.safe_dump(CAMERA))
    refused = CliRunner().invoke(main, ['simulate', str(OBJECT), '--camera',
                                        str(tmp_path / 'camera.yaml'), *options, '-o',
                                        str(tmp_path / 'out')])
    assert refused.exit_code in (1, 2)
    assert line in ' '.join(refused.output.split())
    assert not (tmp_path / 'out').exists()
