"""The chain on real captures: each node on its own from a bag of its input, and all together."""

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from harness import ACTIVATE, CONFIGURE, ROOT, Process
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray
from visualization_msgs.msg import MarkerArray

from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.drawing.pictures import layers_picture, overlay
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.messages import bags
from pmcl_ros.messages.camera_info import pinhole_from
from pmcl_ros.messages.header import header_from
from pmcl_ros.messages.image import depth_from, picture_from
from pmcl_ros.messages.light_field import light_field_from, light_field_to_messages
from pmcl_ros.messages.pose import pose_from, pose_with_covariance_from
from pmcl_ros.messages.volume import (
    edges_from,
    map_from,
    map_to_message,
    volume_from,
    volume_to_message,
)
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.pmcl.object_model import ObjectModel

COARSE = DlvSettings(labels=40, edge_labels=12, stride=2)  # soon built, and enough for a pose
WINE_GLASS = ROOT / 'bags' / 'wine_glass'


def stamp_of(bag):
    return next(bags.read(bag)).time_ns


@pytest.fixture(scope='module')
def volume(light_field):
    return build_volume(light_field, COARSE)


@pytest.fixture
def bag(tmp_path):
    """A function {topic: message} -> a new bag of them, in that order."""
    def bag(messages):
        folder = tmp_path / 'bag'
        bags.record(folder, [
            bags.Recorded(topic, f'{type(message).__module__.split(".")[0]}/msg/'
                          f'{type(message).__name__}', time, serialize_message(message))
            for time, (topic, message) in enumerate(messages.items())], compress=False)
        return folder
    return bag


def play(tmp_path, bag):
    """The real player, as a process that ends by itself."""
    return Process(tmp_path, 'pmcl_ros.nodes.replay', bag)


def error_of(pose, truth):
    """Distance [m] and angle between the axes of symmetry [degrees]."""
    expected = np.array(truth['object_to_camera'])
    angle = np.degrees(np.arccos(np.clip(pose[:3, 2] @ expected[:3, 2], -1, 1)))
    return np.linalg.norm(pose[:3, 3] - expected[:3, 3]), angle


def test_subaperture_node_decodes_a_bag_as_the_core_does(tmp_path, user, bag_parameters,
                                                         light_field):
    name = 'subaperture_node'
    with Process(tmp_path, f'pmcl_ros.nodes.{name}', params=bag_parameters[name]):
        assert all(user.change(name, CONFIGURE, ACTIVATE))
        parts = [user.listen(CameraInfo, 'views/camera_info', SMALL),
                 user.listen(Image, 'views/pupil', SMALL), user.listen(Image, 'views', BIG)]
        pictures = user.listen(Image, 'center/image', SMALL)
        infos = user.listen(CameraInfo, 'center/camera_info', SMALL)
        with play(tmp_path, WINE_GLASS):
            user.wait(lambda: all((*parts, pictures, infos)), 'a light field')
        found = light_field_from(*(messages[0] for messages in parts))
    assert found.header == light_field.header
    assert found.header.stamp_ns == stamp_of(WINE_GLASS)
    assert found.grid.shape == (9, 9)
    assert found.grid.pinhole == light_field.grid.pinhole == pinhole_from(infos[0])
    assert found.grid.baseline == light_field.grid.baseline
    np.testing.assert_array_equal(found.grid.positions, light_field.grid.positions)
    np.testing.assert_array_equal(found.grid.weights, light_field.grid.weights)
    np.testing.assert_array_equal(found.views, light_field.views)
    np.testing.assert_array_equal(picture_from(pictures[0]), light_field.picture())


def test_dlv_node_builds_from_a_bag_as_the_core_does(tmp_path, user, light_field, volume, bag):
    info, pupil, views = light_field_to_messages(light_field)
    recorded = bag({'/views/camera_info': info, '/views/pupil': pupil, '/views': views})
    values = COARSE.model_dump(exclude_defaults=True)
    with Process(tmp_path, 'pmcl_ros.nodes.dlv_node', params=values):
        assert all(user.change('dlv_node', CONFIGURE, ACTIVATE))
        volumes = user.listen(Float32MultiArray, 'dlv', BIG)
        edges = user.listen(Float32MultiArray, 'dlv/edges', BIG)
        maps = user.listen(Float32MultiArray, 'dlv/contour_map', BIG)
        depths = user.listen(Image, 'dlv/depth', SMALL)
        layers = user.listen(Image, 'dlv/layers', SMALL)
        with play(tmp_path, recorded):
            user.wait(lambda: volumes and edges and maps and depths and layers, 'a volume')
        found, seen = volume_from(volumes[0]), edges_from(edges[0])
        read = map_from(maps[0])
    assert found.header == volume.header
    assert found.pinhole == volume.pinhole
    np.testing.assert_array_equal(found.depths, volume.depths)
    expected = build_edges(light_field, COARSE)
    assert (seen.header, seen.pinhole) == (expected.header, expected.pinhole)
    np.testing.assert_array_equal(seen.depths, expected.depths)
    np.testing.assert_array_equal(seen.tensor, expected.tensor)
    odds = build_map(light_field, COARSE)
    assert (read.header, read.pinhole) == (odds.header, odds.pinhole)
    np.testing.assert_array_equal(read.tensor, odds.tensor)
    np.testing.assert_array_equal(read.inside, odds.inside)
    np.testing.assert_array_equal(found.likelihood, volume.likelihood)
    np.testing.assert_allclose(depth_from(depths[0]), found.depth_map())
    np.testing.assert_array_equal(
        picture_from(layers[0]), layers_picture(found.layers(), COARSE.near, COARSE.far))


def test_pmcl_node_localizes_from_a_bag_of_the_contour_map(tmp_path, user, parameters, truth,
                                                           light_field, bag):
    odds = build_map(light_field, COARSE)
    recorded = bag({'/dlv/contour_map': map_to_message(odds)})
    values = parameters['pmcl_node'] | {'evidence': 'map'}
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node', params=values):
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE))
        poses = user.listen(PoseStamped, 'pose', SMALL)
        with play(tmp_path, recorded):
            user.wait(lambda: poses, 'a pose')
        header, pose = pose_from(poses[0])
    assert header == odds.header
    distance, angle = error_of(pose, truth('wine_glass'))
    assert distance < 0.02
    assert angle < 10


def test_pmcl_node_localizes_from_a_bag_of_the_volume_alone(tmp_path, user, parameters, truth,
                                                            volume, bag):
    recorded = bag({'/dlv': volume_to_message(volume)})
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node', params=parameters['pmcl_node']) as node:
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE))
        poses = user.listen(PoseStamped, 'pose', SMALL)
        with play(tmp_path, recorded):
            user.wait(lambda: poses, 'a pose')
        assert 'localizes from dlv alone' in node.log
        header, pose = pose_from(poses[0])
    assert header == volume.header
    distance, _ = error_of(pose, truth('wine_glass'))
    assert distance < 0.02


def test_the_whole_chain_finds_the_object_in_a_bag(tmp_path, user, bag_parameters, truth):
    name = 'shaker'
    region = truth(name)['roi']
    values = bag_parameters | {'dlv_node': {}, 'pmcl_node': {
        'object': f'{ROOT}/models/{name}.obj', 'roi_center': region['center'],
        'roi_size': region['size']}}
    file = tmp_path / 'parameters.yaml'
    file.write_text(yaml.safe_dump(
        {node: {'ros__parameters': each} for node, each in values.items() if each}))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', file,
                 '--without', 'lytro_driver') as chain:
        poses = user.listen(PoseStamped, 'pose', SMALL)
        pictures = user.listen(Image, 'center/image', SMALL)
        infos = user.listen(CameraInfo, 'center/camera_info', SMALL)
        overlays = user.listen(Image, 'overlay', SMALL)
        markers = user.listen(MarkerArray, 'markers', SMALL)
        spreads = user.listen(PoseWithCovarianceStamped, 'pose_with_covariance', SMALL)
        particles = user.listen(PoseArray, 'particles', SMALL)
        with play(tmp_path, ROOT / 'bags' / name):
            user.wait(lambda: (poses and spreads and particles and overlays and markers
                               and len(markers[-1].markers) == 2)
                      or not chain.alive(), 'a pose, and what is drawn of it')
        assert chain.alive(), chain.log
        assert 'localizes from dlv alone' not in chain.log
        header, pose = pose_from(poses[0])
    assert header.stamp_ns == stamp_of(ROOT / 'bags' / name)
    assert header.frame_id == 'lytro_optical_frame'
    distance, angle = error_of(pose, truth(name))
    assert distance < 0.02
    assert angle < 10
    _, again, covariance = pose_with_covariance_from(spreads[0])
    np.testing.assert_array_equal(again, pose)
    assert (np.diag(covariance) > 0).all()
    assert len(particles[0].poses) > 10
    assert header_from(overlays[0].header) == header
    assert len(poses) == len(overlays) == 1

    # What viewers show lies where the pose says, which is near the truth.
    model = ObjectModel.load(ROOT / 'models' / f'{name}.obj')
    expected = overlay(picture_from(pictures[0]), pinhole_from(infos[0]), model, pose)
    differs = (picture_from(overlays[0]) != expected).any(axis=2)
    assert differs.mean() < 1e-4  # a pixel, where the pose's last digit moves it
    box, mesh = markers[-1].markers
    assert header_from(mesh.header) == header_from(box.header) == header
    placed = pose_from(PoseStamped(header=mesh.header, pose=mesh.pose))[1]
    np.testing.assert_allclose(placed, pose, atol=1e-9)
    corners = np.array([[each.x, each.y, each.z] for each in mesh.points])
    np.testing.assert_array_equal(corners, model.vertices[model.faces.ravel()])
    centre, size = box.pose.position, box.scale
    np.testing.assert_allclose([centre.x, centre.y, centre.z], region['center'])
    np.testing.assert_allclose([size.x, size.y, size.z], region['size'])
    assert 'Traceback' not in chain.log
