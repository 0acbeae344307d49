"""The nodes, their topics and their services: for everything that starts, records or lists them.

Imports neither ROS nor the nodes. A test compares the topics with the graph of the running nodes.
"""

from typing import Any, NamedTuple

from pmcl_ros.runtime.imports import imported


class NodeEntry(NamedTuple):
    """One node: its name, which is its executable's too, and where its class is."""

    name: str
    module: str
    class_name: str

    def load(self) -> Any:
        """The node's class."""
        return getattr(imported(self.module), self.class_name)


# In the order of the data: nodes are started from the end, so that no first message is lost, and
# stopped from the beginning.
NODES = (
    NodeEntry('lytro_driver', 'pmcl_ros.nodes.lytro_driver', 'LytroDriver'),
    NodeEntry('subaperture_node', 'pmcl_ros.nodes.subaperture_node', 'SubapertureNode'),
    NodeEntry('dlv_node', 'pmcl_ros.nodes.dlv_node', 'DlvNode'),
    NodeEntry('pmcl_node', 'pmcl_ros.nodes.pmcl_node', 'PmclNode'),
)
# After the chain, where it is wanted: bring-up and launch start it when they get a grasp file.
GRASPS = NodeEntry('grasp_node', 'pmcl_ros.nodes.grasp_node', 'GraspNode')
# In place of lytro_driver and subaperture_node, where a camera is moved instead: when bring-up and
# launch get a plan of its sweep, or when it is to collect posed views.
SWEEP = NodeEntry('sweep_driver', 'pmcl_ros.nodes.sweep_driver', 'SweepDriver')
# Likewise, where several cameras are at rest: when bring-up and launch get `fixed` for views.
FIXED = NodeEntry('fixed_cameras', 'pmcl_ros.nodes.fixed_cameras', 'FixedCameras')
# Beside sweep_driver, where a board tells the poses of its camera: when they get `board`.
BOARD = NodeEntry('board_node', 'pmcl_ros.nodes.board_node', 'BoardNode')
# When sweep_driver takes a posed view; fixed: fixed_cameras takes them.
VIEWS = ('rest', 'service', 'plan', 'fixed')
ALL = (*NODES, GRASPS, SWEEP, FIXED, BOARD)
# Parameters of both where a board tells the poses: of the optical frame, in the board's own.
BY_BOARD: dict[str, dict[str, Any]] = {
    BOARD.name: {'fixed_frame': 'board'},
    SWEEP.name: {'poses': 'topic', 'fixed_frame': 'board', 'mount_position': [0.0] * 3,
                 'mount_rpy': [0.0] * 3, 'common': 0.0}}
# What it listens to where a Lytro is moved: the centre views.
OF_LYTRO = {'image': 'center/image', 'camera_info': 'center/camera_info'}


def chain(moved: bool, lytro: bool = False, fixed: bool = False, board: bool = False
          ) -> tuple[NodeEntry, ...]:
    """The nodes up to a pose, in the order of the data.

    moved: pictures are of a camera that is moved. lytro: which is a Lytro, decoded as ever.
    fixed: pictures are of several cameras at rest. board: a board tells where the camera is.
    """
    decoding, rest = NODES[:2], NODES[2:]
    if fixed:
        return FIXED, *rest
    sweep = (BOARD, SWEEP) if board else (SWEEP,)
    return (*decoding, *sweep, *rest) if lytro else (*sweep, *rest) if moved else NODES


class Quality(NamedTuple):
    """Quality of service, mostly one of the profiles of `base.py`. All are reliable."""

    depth: int
    latched: bool = False

    def describe(self) -> str:
        """In words."""
        return f'reliable, last {self.depth}' + (', latched' if self.latched else '')


BIG, LATCHED, SMALL = Quality(1), Quality(1, latched=True), Quality(10)
MANY = Quality(200)  # arms publish their pose up to 1000 times a second


class TopicEntry(NamedTuple):
    """One topic: its name, relative to the namespace of the nodes, and who has to do with it.

    publishers: nodes, or in words who else. subscribers: nodes. quality: of publishers, and of
    subscribers where `subscribed` is not given. newest: subscribers that keep the last one only.
    """

    name: str
    type: str
    quality: Quality
    publishers: tuple[str, ...]
    subscribers: tuple[str, ...]
    what: str
    subscribed: Quality | None = None
    newest: tuple[str, ...] = ()

    def quality_for(self, subscriber: str) -> Quality:
        """With which a node subscribes."""
        quality = self.subscribed or self.quality
        return quality._replace(depth=1) if subscriber in self.newest else quality


_IMAGE, _INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'
_ARRAY, _STRING = 'std_msgs/msg/Float32MultiArray', 'std_msgs/msg/String'
_POSE, _POSES = 'geometry_msgs/msg/PoseStamped', 'geometry_msgs/msg/PoseArray'
_MARKERS, _SPREAD = ('visualization_msgs/msg/MarkerArray',
                     'geometry_msgs/msg/PoseWithCovarianceStamped')
_DRIVER, _VIEWS, _DLV = 'lytro_driver', 'subaperture_node', 'dlv_node'
_PMCL, _GRASP, _SWEEP, _FIXED = 'pmcl_node', 'grasp_node', 'sweep_driver', 'fixed_cameras'
_BOARD = 'board_node'

_LIGHT_FIELD = (_VIEWS, _SWEEP)
_POSED = (_SWEEP, _FIXED)

# In the order of the data, and of publication within a node.
TOPICS = (
    TopicEntry('metadata', _STRING, LATCHED, (_DRIVER,), (_VIEWS,), "the camera's JSON",
               Quality(10, latched=True)),
    TopicEntry('image_raw', _IMAGE, BIG, (_DRIVER,), (_VIEWS,),
               'raw picture, bayer_bggr16, counts 0..4095'),
    TopicEntry('camera_info', _INFO, SMALL, ('a camera',), (_SWEEP, _BOARD),
               'of an ordinary camera on the arm, or moved otherwise'),
    TopicEntry('image', _IMAGE, SMALL, ('a camera',), (_SWEEP, _BOARD),
               'its pictures; where `compressed` is true, `image/compressed`, CompressedImage; '
               'where `reliable` is false, best effort', newest=(_BOARD,)),
    *(TopicEntry(f'{camera}/{name}', kind, SMALL, ('a camera',), (_FIXED,), what)
      for camera in ('left', 'right') for name, kind, what in (
          ('camera_info', _INFO, 'of one of `cameras`'),
          ('image_raw', _IMAGE, 'its pictures; where `rectified` is true, `image_rect`; where '
           '`compressed` is true, `image_raw/compressed`, CompressedImage; where `reliable` is '
           'false, best effort'))),
    TopicEntry('center/camera_info', _INFO, SMALL, _LIGHT_FIELD, (_PMCL,),
               'pinhole of the centre view'),
    TopicEntry('center/image', _IMAGE, SMALL, _LIGHT_FIELD, (_PMCL,),
               'centre view, rgb8, to look at'),
    TopicEntry('views/camera_info', _INFO, SMALL, _LIGHT_FIELD, (_DLV,),
               'pinhole of every view, and the baseline B between neighbours: P[3] = -fx B'),
    TopicEntry('views/pupil', _IMAGE, SMALL, _LIGHT_FIELD, (_DLV,),
               'a pixel for each view, 32FC3: weight, position x and y [view steps]'),
    TopicEntry('views', _IMAGE, BIG, _LIGHT_FIELD, (_DLV,),
               'mosaic of all views, rgb16, linear, 32768 = sensor white'),
    TopicEntry('posed_views/camera_info', _INFO, SMALL, _POSED, (_DLV, _PMCL),
               'pinhole of every posed view'),
    TopicEntry('posed_views/poses', _POSES, SMALL, _POSED, (_DLV, _PMCL),
               'their cameras in the reference frame [m]'),
    TopicEntry('posed_views/sigma', _IMAGE, SMALL, _POSED, (_DLV, _PMCL),
               'a row for each view, 32FC5: standard deviations of its pose [m], [rad], the share '
               'of their variance that its group shares, the number of its group, the standard '
               'deviation by which the object may have moved since [m]'),
    TopicEntry('posed_views', _IMAGE, BIG, _POSED, (_DLV, _PMCL),
               'the views one below the other, rgb16 (with masks rgba16), gamma encoded, '
               '65535 = white'),
    TopicEntry('dlv', _ARRAY, BIG, (_DLV,), (_PMCL,), 'likelihood, height x width x depth'),
    TopicEntry('dlv/edges', _ARRAY, BIG, (_DLV,), (_PMCL,),
               'edge energy, height x width x depth x tensor'),
    TopicEntry('dlv/contour_map', _ARRAY, BIG, (_DLV,), (_PMCL,),
               'log odds of contours and solids, height x width x depth x log_odds'),
    TopicEntry('dlv/depth', _IMAGE, SMALL, (_DLV,), (),
               'most likely depth, 32FC1 [m], NaN: unknown'),
    TopicEntry('dlv/layers', _IMAGE, SMALL, (_DLV,), (),
               'rgb8: the front surface, and what is behind it'),
    TopicEntry('camera_pose', _POSE, MANY, ('the robot', _BOARD), (_PMCL, _SWEEP),
               'where the camera is, in track_frame (where tracking and track_camera ask for it) '
               'or fixed_frame'),
    TopicEntry('pose', _POSE, SMALL, (_PMCL,), (_GRASP,),
               'the object in the camera frame, or of posed views in theirs [m]'),
    TopicEntry('pose_with_covariance', _SPREAD, SMALL, (_PMCL,), (_GRASP,),
               'the same, with its covariance [m^2, rad^2]'),
    TopicEntry('particles', _POSES, SMALL, (_PMCL,), (), 'the last population'),
    TopicEntry('objects', _MARKERS, LATCHED, (_PMCL,), (),
               'all that is looked for: ns is the name, text found or lost, pose and mesh'),
    TopicEntry('markers', _MARKERS, SMALL, (_PMCL,), (),
               'the mesh at its pose; the region of interest'),
    TopicEntry('overlay', _IMAGE, SMALL, (_PMCL,), (),
               'outline on the centre view, or on all posed views, rgb8'),
    TopicEntry('next_view', _POSE, SMALL, (_PMCL,), (),
               'camera from where one more posed view would make the pose surest'),
    TopicEntry('next_view/candidates', _IMAGE, SMALL, (_PMCL,), (),
               'chart of the cameras that it was chosen from, rgb8'),
    TopicEntry('pose/sigma_by_views', _IMAGE, SMALL, (_PMCL,), (),
               'chart of how sure the pose is with each further posed view, rgb8'),
    TopicEntry('arm_pose', _POSE, MANY, ('the robot',), (_GRASP,),
               'mount_parent in base_frame, where arm is topic'),
    TopicEntry('grasps', _POSES, SMALL, (_GRASP,), (), 'gripper poses in base_frame, best first'),
    TopicEntry('pre_grasps', _POSES, SMALL, (_GRASP,), (), 'where each approach begins'),
    TopicEntry('grasps/details', _ARRAY, SMALL, (_GRASP,), (),
               'of each: score, probability, width [m], opening [m]'),
    TopicEntry('grasp', _POSE, SMALL, (_GRASP,), (), 'the best'),
    TopicEntry('pre_grasp', _POSE, SMALL, (_GRASP,), (), 'where its approach begins'),
    TopicEntry('grasp_markers', _MARKERS, SMALL, (_GRASP,), (), 'grippers at the best grasps'),
    TopicEntry('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', SMALL, ('all nodes',),
               (_GRASP,), 'rates, latency, drops, errors, back end, once a second'),
)
# Published where the packages of their types are installed, which are not on PyPI.
DETECTIONS = TopicEntry(
    'detections', 'vision_msgs/msg/Detection3DArray', SMALL, (_PMCL,), (),
    'what was found: id, class, score, pose with covariance, box; where vision_msgs is installed')
COLLISION_OBJECT = TopicEntry(
    'collision_object', 'moveit_msgs/msg/CollisionObject', SMALL, (_PMCL,), (),
    'the mesh at its pose, added or removed; where moveit_msgs is installed')
OPTIONAL = DETECTIONS, COLLISION_OBJECT
# Of the robot, as tf2 listens to them: nodes do so by tf2_ros, bags by `pmcl_record`.
TRANSFORMS = (
    TopicEntry('/tf', 'tf2_msgs/msg/TFMessage', Quality(100), ('the robot',), (), 'transforms'),
    TopicEntry('/tf_static', 'tf2_msgs/msg/TFMessage', Quality(100, latched=True), ('the robot',),
               (), 'transforms that stay'))

_CENTRE = ('center/camera_info', 'center/image')
# What is recorded together: all that the next node, and a person, wants of a stage.
PRESETS = {
    'raw': ('metadata', 'image_raw'),
    'views': (*_CENTRE, 'views/camera_info', 'views/pupil', 'views'),
    'posed_views': ('posed_views/camera_info', 'posed_views/poses', 'posed_views/sigma',
                    'posed_views'),
    'dlv': (*_CENTRE, 'dlv', 'dlv/edges', 'dlv/contour_map', 'camera_pose'),
    'poses': ('pose', 'pose_with_covariance', 'particles', 'objects', 'markers', 'overlay',
              'grasps', 'pre_grasps', 'grasps/details', '/diagnostics'),
    'all': tuple(each.name for each in TOPICS),
}

# node: its services (std_srvs/srv/Trigger), and what each does
SERVICES = {
    _DRIVER: (('~/capture', 'take a picture; answers when it has been published, or why not'),),
    _SWEEP: (('~/start', 'begin a sweep; one that is not finished is forgotten'),
             ('~/finish', 'publish what there is of it; again: publish it again'),
             ('~/take', 'where collect is service: take the next picture at rest')),
    _PMCL: (('~/localize', 'search the last capture again'),
            ('~/reset', 'forget all that has come; the next search is as the first'),
            ('~/next_view', 'of posed views: say and publish where to look next')),
}
