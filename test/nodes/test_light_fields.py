"""Light fields that no Lytro took: dlv_node takes any grid, a bag of one is localised in."""

import cv2
import numpy as np
import pytest
import yaml
from command_line import pmcl
from geometry_msgs.msg import PoseStamped
from harness import ACTIVATE, CONFIGURE, ROOT, Process
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.messages import bags
from pmcl_ros.messages.light_field import light_field_from, light_field_to_messages
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.messages.volume import edges_from, volume_from
from pmcl_ros.nodes.runtime.base import BIG, SMALL

GRIDS = {(17, 17): (24, 20), (1, 5): (40, 30), (4, 6): (33, 21)}


def light_field_of(shape, size, stamp):
    """Noise in a grid of (rows, columns) views of (width, height) px."""
    pinhole = Pinhole(*size, 100.0, 90.0, size[0] / 2, size[1] / 2)
    grid = ViewGrid(pinhole, 0.0005, nominal_positions(*shape), np.ones(shape, np.float32))
    random = np.random.default_rng(stamp)
    return LightField(Header(stamp), random.random((*shape, *size[::-1], 3), np.float32), grid)


def test_dlv_node_takes_views_of_any_number_and_size(tmp_path, user):
    settings = {'labels': 12, 'edge_labels': 6, 'views': 17}
    with Process(tmp_path, 'pmcl_ros.nodes.dlv_node', params=settings) as node:
        assert all(user.change('dlv_node', CONFIGURE, ACTIVATE))
        volumes = user.listen(Float32MultiArray, 'dlv', BIG)
        edges = user.listen(Float32MultiArray, 'dlv/edges', BIG)
        publishers = [user.publisher(CameraInfo, 'views/camera_info', SMALL),
                      user.publisher(Image, 'views/pupil', SMALL),
                      user.publisher(Image, 'views', BIG)]
        for stamp, (shape, size) in enumerate(GRIDS.items(), 1):
            sent = light_field_of(shape, size, stamp)
            messages = light_field_to_messages(sent)
            for publisher, message in zip(publishers, messages, strict=True):
                publisher.publish(message)
            user.wait(lambda count=stamp: len(volumes) == len(edges) == count, f'{shape} views')
            found, seen = volume_from(volumes[-1]), edges_from(edges[-1])
            read = light_field_from(*messages)
            expected = build_volume(read, DlvSettings(**settings))
            assert found.header == expected.header
            np.testing.assert_allclose(found.likelihood, expected.likelihood, atol=1e-4)
            np.testing.assert_allclose(
                seen.tensor, build_edges(read, DlvSettings(**settings)).tensor, rtol=1e-3,
                atol=1e-3)
        assert '[ERROR]' not in node.log


@pytest.fixture(scope='module')
def folder(tmp_path_factory, light_field):
    """5x7 of the views of bags/wine_glass as pictures, with a light_field.yaml."""
    folder = tmp_path_factory.mktemp('views')
    for row, column in np.ndindex(5, 7):
        encoded = np.clip(light_field.views[row + 2, column + 1], 0, 1) ** (1 / 2.2)
        path = folder / f'{row}_{column}.png'
        assert cv2.imwrite(str(path), np.rint(65535 * encoded[..., ::-1]).astype(np.uint16))
    pinhole = light_field.grid.pinhole
    (folder / 'light_field.yaml').write_text(yaml.safe_dump({
        'files': '{row}_{column}.png', 'baseline': light_field.grid.baseline, 'gamma': 2.2,
        'fx': pinhole.fx, 'fy': pinhole.fy, 'cx': pinhole.cx, 'cy': pinhole.cy}))
    return folder


def test_a_bag_of_a_folder_of_pictures_is_localised_in(tmp_path, user, truth, folder):
    bag = tmp_path / 'bag'
    pmcl('bag', 'record', folder, bag)
    assert [(each.name, each.messages) for each in bags.topics(bag)] == [
        ('/center/camera_info', 1), ('/center/image', 1), ('/views/camera_info', 1),
        ('/views/pupil', 1), ('/views', 1)]
    region = truth('wine_glass')['roi']
    file = tmp_path / 'parameters.yaml'
    file.write_text(yaml.safe_dump({
        'dlv_node': {'ros__parameters': {'views': 5, 'labels': 50}},
        'pmcl_node': {'ros__parameters': {
            'object': f'{ROOT}/models/wine_glass.obj', 'roi_center': region['center'],
            'roi_size': region['size']}}}))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', file, '--without',
                 'lytro_driver', '--without', 'subaperture_node') as chain:
        poses = user.listen(PoseStamped, 'pose', SMALL)
        overlays = user.listen(Image, 'overlay', SMALL)
        with Process(tmp_path, 'pmcl_ros.nodes.replay', bag):
            user.wait(lambda: (poses and overlays) or not chain.alive(), 'a pose')
        assert chain.alive(), chain.log
    header, pose = pose_from(poses[0])
    assert header.stamp_ns == next(bags.read(bag)).time_ns
    expected = np.array(truth('wine_glass')['object_to_camera'])
    assert np.linalg.norm(pose[:3, 3] - expected[:3, 3]) < 0.02
    assert abs(pose[:3, 2] @ expected[:3, 2]) > np.cos(np.radians(10))
