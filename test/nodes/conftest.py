"""The user that talks to nodes, and captures at every stage of the chain."""

import gc
import json

import numpy as np
import pytest

pytest.importorskip('rclpy')

import rclpy
from harness import ROOT, User
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image
from std_msgs.msg import String
from synthetic_camera import SIDE, SyntheticCamera, waves

from pmcl_ros.camera.files import read_raw_frame, write_raw_frame
from pmcl_ros.dlv.build import build_volume
from pmcl_ros.dlv.settings import DlvSettings
from pmcl_ros.evidence.build_map import build_map
from pmcl_ros.evidence.edges import build_edges
from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.lightfield.calibration.lytro.calibration import Calibration
from pmcl_ros.lightfield.decode import Decoder
from pmcl_ros.lightfield.light_field import LightField, ViewGrid, nominal_positions
from pmcl_ros.messages import bags
from pmcl_ros.messages.raw_frame import metadata_from, raw_frame_from
from pmcl_ros.nodes.pmcl_node import PmclNode
from pmcl_ros.nodes.runtime.shared_memory import VARIABLE


def _talk_as_processes_do():
    """Let participants of this process talk by sockets and shared memory, as if of several.

    Between the user and nodes in the tests' own process Fast DDS 2.14 would call each other's
    readers and writers. While they find each other two threads may so wait for each other's
    locks, for ever: a node is never found, or a participant never ends.
    """
    with pytest.MonkeyPatch.context() as patch:
        # Read once, by the first participant; not for the processes that tests start.
        patch.setenv(VARIABLE, str(ROOT / 'test' / 'support' / 'fastdds.xml'))
        context = Context()
        rclpy.init(context=context)
        Node('first', context=context).destroy_node()
        rclpy.shutdown(context=context)


_talk_as_processes_do()


@pytest.fixture
def user():
    user = User()
    yield user
    user.close()
    # A participant of a node in this process ends once nothing refers to it. Until then it holds
    # the ports of those that were here, which the next ones take over, with their dead listeners:
    # to a process that a test starts such a port is broken, and nobody hears it.
    gc.collect()


@pytest.fixture(scope='session')
def truth():
    """A function name -> what is true of the capture in bags/NAME."""
    return lambda name: json.loads((ROOT / 'bags' / name / 'truth.json').read_text())


@pytest.fixture(scope='session')
def parameters(truth, tmp_path_factory, camera_text):
    """Parameters with which each node can be configured: a small camera, the wine glass."""
    folder = tmp_path_factory.mktemp('camera')
    camera = SyntheticCamera(camera_text(SIDE, SIDE))
    for name, frame in (('white', camera.white()), ('picture', camera.picture(waves))):
        write_raw_frame(folder / f'{name}.RAW', frame)
    camera.calibration.save(folder / 'calibration.yaml')
    region = truth('wine_glass')['roi']
    return {
        'lytro_driver': {'source': 'files', 'path': f'{folder}/picture.RAW'},
        'subaperture_node': {'calibration': f'{folder}/calibration.yaml',
                             'white': f'{folder}/white.RAW'},
        'dlv_node': {'labels': 16, 'edge_labels': 8},
        'pmcl_node': {'object': f'{ROOT}/models/wine_glass.obj',
                      'roi_center': region['center'], 'roi_size': region['size']},
    }


@pytest.fixture
def make_pmcl_node(parameters):
    """A function changes -> a pmcl_node with these parameters."""
    context = Context()
    rclpy.init(context=context)
    nodes = []

    def make(**changes):
        nodes.append(PmclNode(context=context, parameter_overrides=[
            Parameter(name, value=value)
            for name, value in (parameters['pmcl_node'] | changes).items()]))
        return nodes[-1]

    yield make
    for each in nodes:
        each.close()
    rclpy.shutdown(context=context)


@pytest.fixture(scope='session')
def bag_parameters(parameters):
    """Parameters of each node for the captures in bags/."""
    cameras = ROOT / 'config' / 'cameras'
    return parameters | {'subaperture_node': {'calibration': f'{cameras}/demo.yaml',
                                              'white': f'{cameras}/demo_white.RAW.xz'}}


@pytest.fixture(scope='session')
def light_field():
    """What the core, without ROS, decodes from bags/wine_glass."""
    text, image = bags.read(ROOT / 'bags' / 'wine_glass')
    frame = raw_frame_from(deserialize_message(image.cdr, Image),
                           metadata_from(deserialize_message(text.cdr, String)))
    cameras = ROOT / 'config' / 'cameras'
    decoder = Decoder(Calibration.load(cameras / 'demo.yaml'),
                      read_raw_frame(cameras / 'demo_white.RAW.xz'))
    return decoder.decode(frame)


@pytest.fixture(scope='session')
def small_light_field():
    """Noise seen by nine views: what a node can be done with at once."""
    pinhole = Pinhole(48, 40, 140.0, 140.0, 23.5, 19.5)
    grid = ViewGrid(pinhole, 0.00074, nominal_positions(3, 3), np.ones((3, 3), np.float32))
    views = np.random.default_rng(5).random((3, 3, 40, 48, 3), np.float32)
    return LightField(Header(1_700_000_000_000_000_001), views, grid)


@pytest.fixture(scope='session')
def small_volume(small_light_field):
    """Its volume."""
    return build_volume(small_light_field, DlvSettings(labels=16, views=3))


@pytest.fixture(scope='session')
def small_edges(small_light_field):
    """Its edge volume."""
    return build_edges(small_light_field, DlvSettings(edge_labels=8, views=3))


@pytest.fixture(scope='session')
def small_map(small_light_field):
    """Its contour map."""
    return build_map(small_light_field, DlvSettings(views=3))
