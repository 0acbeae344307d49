"""An object that edges are unsure of is claimed by pmcl_node, unless the contour map denies it."""

from dataclasses import replace

import numpy as np
import pytest
from contour_maps import map_seen
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import ACTIVATE, CONFIGURE, Process
from pmcl_scenes import COARSE, cup, depth_of, edges_seen, model_of, pose_of
from scipy.spatial.transform import Rotation
from std_msgs.msg import Float32MultiArray

from pmcl_ros.dlv.volume import depth_labels
from pmcl_ros.geometry.header import Header
from pmcl_ros.messages.pose import pose_from
from pmcl_ros.messages.volume import edges_to_message, map_to_message
from pmcl_ros.nodes.runtime.base import BIG, SMALL

NEAR, FAR = 0.3, 0.5
PLACE = [0.035, 0.0, 0.4]


@pytest.fixture
def claimed(context):
    """Edges of a cup without those of its lowest part, and a map of all of it."""
    model = model_of(cup(), [0, 0, 1])
    depth = depth_of(context, model, pose_of(Rotation.from_euler('xyz', [1.3, -0.4, 0.0]), PLACE),
                     COARSE, 4)
    edges = edges_seen(depth, COARSE, depth_labels(NEAR, FAR, 8), 0.2 * model.radius, strength=6.0)
    edges.tensor[4 * COARSE.height // 5:] = 0
    return edges, map_seen(depth > 0, COARSE, NEAR, FAR)


def test_an_unsure_claim_is_published_with_its_support_and_withdrawn_by_the_map(
        tmp_path, user, claimed):
    cup().export(tmp_path / 'cup.obj')
    edges, seen = claimed
    parameters = {'object': str(tmp_path / 'cup.obj'), 'roi_center': [0.0, 0.0, 0.4],
                  'roi_size': [0.1, 0.04, 0.04], 'proposals': 4, 'particles': 32, 'moves': 1,
                  'renderer': 'numba', 'least_support': -5.0}
    with Process(tmp_path, 'pmcl_ros.nodes.pmcl_node', params=parameters) as process:
        assert all(user.change('pmcl_node', CONFIGURE, ACTIVATE)), process.log
        poses = user.listen(PoseStamped, 'pose', SMALL)
        states = user.listen(DiagnosticArray, '/diagnostics', SMALL)
        of_edges = user.publisher(Float32MultiArray, 'dlv/edges', BIG)

        def answer(stamp):
            """Level and values of the search of a capture."""
            of_edges.publish(edges_to_message(replace(edges, header=Header(stamp))))

            def told():
                if states:
                    status, = states[-1].status
                    values = {each.key: each.value for each in status.values}
                    return values.get('capture') == str(stamp) and (status.level, values)
                return None
            return user.wait(told, f'the search of {stamp}')

        level, alone = answer(1)
        assert level == DiagnosticStatus.OK
        assert -5 <= float(alone['support']) < 0
        assert 'evidence of' not in alone

        of_map = user.publisher(Float32MultiArray, 'dlv/contour_map', BIG)
        of_map.publish(map_to_message(replace(seen, header=Header(2))))
        user.delivered(of_map)
        level, agreed = answer(2)
        assert level == DiagnosticStatus.OK
        assert float(agreed['support']) < 0
        assert 'evidence of' not in agreed
        assert 'edges are unsure' not in process.log  # the map has come, and shows it

        nothing = replace(seen, header=Header(3), tensor=np.zeros_like(seen.tensor))
        nothing.tensor[..., 0] = -4
        of_map.publish(map_to_message(nothing))
        user.delivered(of_map)
        level, denied = answer(3)
        assert level == DiagnosticStatus.WARN
        assert denied['evidence of'] == 'contour map'
        user.wait(lambda: 'capture 3: edges are unsure of the object; the contour map does not '
                          'find it' in process.log, 'the log')
        assert 'lost: no cup in capture 3' in process.log
        user.wait(lambda: len(poses) == 2, 'the poses')
    for stamp, (header, pose) in enumerate(map(pose_from, poses), 1):
        assert header.stamp_ns == stamp
        assert np.linalg.norm(pose[:3, 3] - PLACE) < 0.02
