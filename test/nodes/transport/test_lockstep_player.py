"""What was said of a capture before it is played is no answer to it, however late it comes."""

import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from harness import PATIENCE
from rclpy.node import Node
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image
from visualization_msgs.msg import Marker, MarkerArray

from pmcl_ros.geometry.header import Header
from pmcl_ros.messages import bags
from pmcl_ros.messages.header import header_to_message
from pmcl_ros.nodes.runtime.base import LATCHED
from pmcl_ros.nodes.transport.lockstep_player import LockstepPlayer
from pmcl_ros.runtime.errors import BagError

STAMP = 1_700_000_000_000_000_001


class PatientPlayer(LockstepPlayer):
    """Waits for what was said before as long as a test may take."""

    discovery = PATIENCE


@pytest.fixture
def capture(tmp_path):
    """A capture in a bag: its topic, and its message."""
    image = Image(header=header_to_message(Header(STAMP)))
    bags.record(tmp_path / 'bag', [bags.Recorded('/image_raw', 'sensor_msgs/msg/Image', STAMP,
                                                 serialize_message(image))])
    topic, = bags.topics(tmp_path / 'bag')
    message, = bags.read(tmp_path / 'bag')
    return topic, message


def test_a_replay_begins_when_the_answers_of_the_one_before_have_come(user, capture):
    topic, message = capture
    node = Node('player', context=user.node.context)
    player = PatientPlayer(node, [topic], patience=0.1)
    answers = user.node.create_publisher(MarkerArray, 'objects', LATCHED)
    with ThreadPoolExecutor(1) as pool:
        ready = pool.submit(player.wait_for_answerer, PATIENCE)
        user.wait(answers.get_subscription_count, 'the player')
        time.sleep(1.0)
        answers.publish(MarkerArray(markers=[Marker(header=header_to_message(Header(STAMP)))]))
        ready.result(PATIENCE)
    player.before(message)
    with pytest.raises(BagError, match=f'nothing came on /objects of capture {STAMP} within'):
        player.wait()
    node.destroy_node()
