"""What the shipped layouts of RViz and Foxglove show: pairs of a topic and its type."""

import json

import yaml
from harness import ROOT

VIEW = ROOT / 'config' / 'view'
KINDS = {'MarkerArray': 'visualization_msgs/msg/MarkerArray', 'Image': 'sensor_msgs/msg/Image',
         'PoseArray': 'geometry_msgs/msg/PoseArray',
         'PoseWithCovariance': 'geometry_msgs/msg/PoseWithCovarianceStamped'}


def rviz():
    layout = yaml.safe_load((VIEW / 'pmcl.rviz').read_text())['Visualization Manager']
    return [(each['Topic']['Value'], KINDS[each['Class'].split('/')[1]])
            for each in layout['Displays'] if 'Topic' in each]


def foxglove():
    layout = json.loads((VIEW / 'foxglove.json').read_text())
    panels = layout['configById']
    assert sorted(_leaves(layout['layout'])) == sorted(panels)
    images = [(panel['imageMode']['imageTopic'], KINDS['Image'])
              for name, panel in panels.items() if name.startswith('Image!')]
    kinds = {'/markers': 'MarkerArray', '/grasp_markers': 'MarkerArray',
             '/particles': 'PoseArray',
             '/pose_with_covariance': 'PoseWithCovariance'}
    return [*images, *((topic, KINDS[kinds[topic]]) for topic in panels['3D!object']['topics']),
            (panels['RawMessages!pose']['topicPath'].split('.')[0],
             'geometry_msgs/msg/PoseStamped')]


def _leaves(node):
    if isinstance(node, str):
        return [node]
    return [*_leaves(node['first']), *_leaves(node['second'])]
