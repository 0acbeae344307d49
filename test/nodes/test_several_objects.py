"""pmcl_node looks for several objects: a pose topic of each, and one list for late comers too."""

from dataclasses import replace

import numpy as np
import pytest
import rclpy
import trimesh
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from harness import ACTIVATE, CONFIGURE, Process
from pmcl_scenes import CAMERA, cup, edges_seen, pose_of
from rclpy.context import Context
from rclpy.lifecycle import TransitionCallbackReturn as Result
from rclpy.parameter import Parameter
from scipy.spatial.transform import Rotation
from std_msgs.msg import Float32MultiArray
from visualization_msgs.msg import MarkerArray

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.messages.volume import edges_to_message
from pmcl_ros.nodes.pmcl_node import PmclNode
from pmcl_ros.nodes.runtime.base import BIG, LATCHED, SMALL
from pmcl_ros.pmcl.object_model import ObjectModel
from pmcl_ros.pmcl.render.numba_renderer import NumbaRenderer
from pmcl_ros.pmcl.render.scene import Scene, Window

NODE = 'pmcl_node'
REGION = {'roi_center': [0.0, 0.0, 0.42], 'roi_size': [0.14, 0.14, 0.12], 'renderer': 'numba',
          'proposals': 24, 'particles': 64, 'moves': 2}
LEFT, RIGHT = (pose_of(Rotation.from_euler('x', 1.4), place)
               for place in ([-0.04, 0, 0.42], [0.035, 0.01, 0.4]))


@pytest.fixture(scope='module')
def files(tmp_path_factory):
    """A cup in millimetres with an object YAML, and another mesh, which is not in the volume."""
    folder = tmp_path_factory.mktemp('objects')
    mesh = cup()
    mesh.apply_scale(1000)
    mesh.export(folder / 'mesh.stl')
    described = folder / 'tea cup.yaml'
    described.write_text(yaml.safe_dump({'mesh': 'mesh.stl', 'scale': 0.001}))
    trimesh.creation.box((0.03, 0.05, 0.11)).export(folder / 'carton.stl')
    return described, folder / 'carton.stl'


@pytest.fixture(scope='module')
def seen(files):
    """The edge volume of two cups."""
    model, depths = ObjectModel.load(files[0]), depth_labels(0.3, 0.6, 16)
    window = Window(0, 0, (CAMERA.width, CAMERA.height))
    tensor = np.array([0.05, 0.05, 0], np.float32)
    for pose in (LEFT, RIGHT):
        depth = NumbaRenderer().depths(Scene(model, CAMERA, window, 0.2, 0.8), pose[None])[0]
        edges = edges_seen(depth, CAMERA, depths, 0.2 * model.radius, zoom=1, strength=3.0)
        tensor = tensor + edges.tensor
    header = Header(1_700_000_000_000_000_003)
    return replace(edges, header=header, tensor=tensor.astype(np.float32))


def test_each_object_has_its_topics_and_a_late_subscriber_gets_the_list(
        tmp_path, user, files, seen):
    cup_file, carton = map(str, files)
    names = ['tea_cup', 'carton', 'tea_cup_2']
    with Process(tmp_path, f'pmcl_ros.nodes.{NODE}',
                 params=REGION | {'objects': [cup_file, carton, cup_file]}) as process:
        assert all(user.change(NODE, CONFIGURE, ACTIVATE)), process.log
        poses = {name: user.listen(PoseStamped, f'objects/{name}/pose', SMALL) for name in names}
        spreads = [user.listen(PoseWithCovarianceStamped, f'objects/{name}/pose_with_covariance',
                               SMALL) for name in names]
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        assert '/pose' not in user.publishers_of(NODE)
        publisher = user.publisher(Float32MultiArray, 'dlv/edges', BIG)
        publisher.publish(edges_to_message(seen))
        user.wait(lambda: poses['tea_cup_2'] and spreads[2], 'poses')
        late = user.listen(MarkerArray, 'objects', LATCHED)
        user.wait(lambda: late, 'the list')
        assert 'lost: carton' in user.wait(lambda: 'lost' in process.log and process.log,
                                           'the log')
        told = user.wait(lambda: [each.status[0] for each in states if any(
            value.key == 'search' for value in each.status[0].values)], 'the report')[0]
    assert told.level == DiagnosticStatus.WARN
    values = {each.key: each.value for each in told.values}
    assert (values['capture'], values['search']) == (str(seen.header.stamp_ns), '1')
    assert values['carton'] == 'lost'
    assert values['tea_cup'].startswith('score')
    assert poses['carton'] == []
    for name, truth in (('tea_cup', LEFT), ('tea_cup_2', RIGHT)):
        header, pose = pose_from(poses[name][0])
        assert header == seen.header
        assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 0.01
    told = late[0].markers
    assert [(each.ns, each.id, each.text) for each in told] == [
        ('tea_cup', 0, 'found'), ('carton', 1, 'lost'), ('tea_cup_2', 2, 'found')]
    assert told[0].pose == poses['tea_cup'][0].pose
    assert told[0].mesh_resource == (files[0].parent / 'mesh.stl').as_uri()
    assert told[0].scale.x == 0.001
    assert told[1].color.a < told[0].color.a


@pytest.fixture
def refused(capfd):
    """A function parameters -> what the node says when it cannot be configured with them."""
    context = Context()
    rclpy.init(context=context)

    def refused(**params):
        node = PmclNode(context=context, parameter_overrides=[
            Parameter(name, value=value) for name, value in (REGION | params).items()])
        assert node.trigger_configure() == Result.FAILURE
        node.close()
        return capfd.readouterr().err

    yield refused
    rclpy.shutdown(context=context)


def test_objects_that_cannot_be_looked_for_are_refused(refused, files, tmp_path):
    cup_file, carton = map(str, files)
    other = tmp_path / 'carton.stl'
    other.write_bytes(files[1].read_bytes())
    empty = tmp_path / 'empty.obj'
    empty.write_text('v 0 0 0\n')
    for params, words in (
            ({'objects': [cup_file, '/no/such.stl']}, "parameter 'objects': there is no /no/such"),
            ({'objects': [carton, str(other)]}, "would all be called 'carton'"),
            ({'objects': [cup_file, str(empty)]}, 'empty'),
            ({'objects': [cup_file], 'tracking': 'constant_pose'}, 'need tracking none'),
            ({'objects': [cup_file], 'mode': 'faithful'}, 'mode default'),
            ({'objects': [cup_file], 'evidence': 'map'}, 'need evidence edges, it is map'),
            ({'object': cup_file, 'tracking': 'camera', 'evidence': 'map'},
             'tracking camera needs evidence edges'),
            ({'objects': [cup_file], 'object_frame': 'cup'}, 'object_frame')):
        log = refused(**params)
        assert words in log, log
        assert 'Traceback' not in log
