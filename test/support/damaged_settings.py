"""Small files that tell commands and nodes what to do, and how each is read."""

from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import rclpy
import trimesh
from damaged_files import Format, at, dump
from painted_boards import picture_of_board
from scipy.spatial.transform import Rotation

from pmcl_ros.camera.gateway.settings import read_token
from pmcl_ros.cli.cameras.hand_eye import calibrated
from pmcl_ros.cli.sources import GivenSource
from pmcl_ros.evidence import learned
from pmcl_ros.evidence.contour_net import ContourNet
from pmcl_ros.geometry.pinhole import Pinhole
from pmcl_ros.geometry.se3 import inverse, transform
from pmcl_ros.grasps.settings import GripperSettings
from pmcl_ros.lightfield.calibration.checkerboard import Checkerboard
from pmcl_ros.lightfield.sweep.plan import SweepPlan
from pmcl_ros.lightfield.sweep.view_plan import ViewPlan
from pmcl_ros.nodes.runtime.parameter_file import check_parameter_file
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.simulation.camera_plan import CameraPlan
from pmcl_ros.simulation.described.object_description import load_object
from pmcl_ros.simulation.labelled_pictures import read_labelled
from pmcl_ros.simulation.ordinary_camera import OrdinaryCamera
from pmcl_ros.simulation.scenes.random_scene import SceneSettings, random_scene

ROOT = Path(__file__).parents[2]
CAMERA = {'width': 12, 'height': 9, 'fx': 20.0, 'fy': 21.0, 'cx': 5.5, 'cy': 4.0}
STILL = np.eye(4).ravel().tolist()
BOARD = Checkerboard(4, 3, 0.02)
LEARNED = {'contour': learned.LearnedContour, 'creases': learned.LearnedProfile,
           'contour_map': learned.LearnedMap, 'views': learned.LearnedViews,
           'contour_map_evidence': learned.LearnedMapEvidence}


# Vessels are made by an extra that the oldest packages go without.
UNREADABLE = () if find_spec('manifold3d') else ('appearance',)


def settings_formats(folder, bag):
    """By name, all in a folder that is theirs. bag: of a robot, to be read as a file tells."""
    poses = {'frame': 'base', 'poses': [STILL, [1.0, 0, 0, 0.1, *STILL[4:]]]}
    plan = SweepPlan.from_grid(1, 3, 0.01, np.eye(4), 'base').model_dump(mode='json')
    cameras = {'poses': [*poses['poses']], 'sigma_mm': 1.0, 'sigma_deg': 0.1, 'common': 0.5,
               'stated': True, 'hidden': 1}
    camera = {**CAMERA, 'distortion': [0.1, 0.01, 0.0, 0.0], 'noise': 0.01, 'blur': 0.5}
    of_ros = {'image_width': 12, 'image_height': 9, 'distortion_model': 'plumb_bob', **{
        name: {'rows': rows, 'cols': len(data) // rows, 'data': data} for name, rows, data in (
            ('camera_matrix', 3, [20.0, 0.0, 5.5, 0.0, 21.0, 4.0, 0.0, 0.0, 1.0]),
            ('distortion_coefficients', 1, [0.1, 0.01, 0.0, 0.0, 0.0]))}}
    collect = {'image_topic': '/wrist/image/compressed', 'pose_topic': '/camera_pose',
               'apart': 0.03, 'near': 0.3, 'sharpness': 0.5, 'mount_position': [0.0, 0, 0.1],
               'mount_rpy': [0.0, 0, 0]}
    gripper = GripperSettings().model_dump(mode='json')
    made = {
        'sweep plan': at(folder, 'plan.yaml', dump(plan), SweepPlan.load),
        'camera plan': at(folder, 'cameras.yaml', dump(cameras), placed),
        'camera': at(folder, 'camera.yaml', dump(camera), drawn),
        'camera of ROS': at(folder, 'ost.yaml', dump(of_ros), drawn),
        'collect': at(bag, 'collect.yaml', dump(collect), lambda path: GivenSource(
            bag, collect=path).open().read()),
        'candidates': at(folder, 'poses.yaml', dump(poses), lambda path: ViewPlan.load(
            path).cameras.tolist()),
        'gripper': at(folder, 'gripper.yaml', dump(gripper), GripperSettings.load),
        'token': at(folder, 'token.txt', b'0123456789abcdef\n', read_token),
        'parameters': at(folder, 'pmcl.yaml', (ROOT / 'config/pmcl.yaml').read_bytes(),
                         parameters),
        'appearance': appearance(folder / 'object'),
        'labelled picture': labelled(folder / 'labelled'),
        'contour_map.onnx': network(folder / 'contour_map.onnx'),
        'hand-eye': boards(folder / 'boards')}
    for name, kind in LEARNED.items():
        made[f'learned {name}'] = at(folder / 'learned', f'{name}.yaml', learned.learned_file(
            f'{name}.yaml').read_bytes(), kind.load)
    for name, each in made.items():
        if name not in UNREADABLE:
            each.read(each.write(each.data))
    return made


def scene_of(camera):
    return random_scene(np.random.default_rng(3), SceneSettings(kinds=('opaque',), empty=0),
                        sensor=camera.sensor(np.random.default_rng(3)))


SCENE = scene_of(OrdinaryCamera.make(CAMERA))


def placed(path):
    return CameraPlan.parse(str(path)).cameras(SCENE)


def drawn(path):
    """Up to where rays are traced."""
    camera = OrdinaryCamera.load(path)
    return camera.lens, camera.field, camera.sensor(np.random.default_rng(3))


def parameters(path):
    """As a node does: names first, then ROS reads it, and says in its words what is wrong."""
    found = check_parameter_file(path)
    context = rclpy.Context()
    try:
        rclpy.init(args=['--ros-args', '--params-file', str(path)], context=context)
    except RuntimeError as error:
        raise SettingsError(str(error)) from None
    context.shutdown()
    return found


def network(path):
    """The shipped one with a damaged head."""
    whole = learned.learned_file('contour_map.onnx').read_bytes()

    def write(damaged):
        path.write_bytes(damaged + whole[1000:])
        return path
    return Format(whole[:1000], write,
                  lambda path: ContourNet(path, learned.learned_map()).learned, exact=True)


def appearance(folder):
    """A glass with water in it."""
    folder.mkdir(parents=True)
    trimesh.creation.cylinder(0.03, 0.1).export(folder / 'glass.stl')
    values = {'mesh': 'glass.stl', 'scale': 1.0, 'appearance': {
        'material': 'glass', 'wall': 0.003, 'floor': -0.04, 'mouth': {'z': 0.05, 'open': True},
        'liquid': {'level': 0.02}}}
    return at(folder, 'glass.yaml', dump(values), load_object)


def labelled(folder):
    folder.mkdir(parents=True)
    path = folder / '000001.npz'
    np.savez(path, picture=np.zeros((9, 12, 3), np.uint8), direction=np.zeros((9, 12), np.int8),
             inside=np.zeros((9, 12), bool))
    return at(folder, path.name, path.read_bytes(), lambda path: [
        each.tolist() for each in vars(read_labelled(path)).values()], exact=True)


def boards(folder):
    """Pictures of a small board by a camera on an arm, which turns about two axes."""
    folder.mkdir(parents=True)
    pinhole = Pinhole(96, 72, 90.0, 90.0, 47.5, 35.5)
    middle, placed_at = BOARD.points.mean(axis=0), transform([0.5, 0.2, 0.1], [0.1, 0.2, 0.3])
    views = []
    for number in range(8):
        pose = np.eye(4)
        turn = np.array([25 * np.cos(0.8 * number), 25 * np.sin(0.8 * number), 10])
        pose[:3, :3] = Rotation.from_euler('xyz', turn, degrees=True).as_matrix()
        pose[:3, 3] = [0, 0, 0.15] - pose[:3, :3] @ middle
        cv2.imwrite(str(folder / f'{number}.png'), picture_of_board(BOARD, pose, pinhole))
        views.append({'file': f'{number}.png', 'camera': 'c', 'sigma_mm': 1.0, 'sigma_deg': 0.5,
                      'mount_to_base': (placed_at @ inverse(pose)).ravel().tolist()})
    camera = {name: getattr(pinhole, name) for name in ('width', 'height', 'fx', 'cx', 'cy')}
    return at(folder, 'views.yaml', dump({'cameras': {'c': camera}, 'views': views}),
              lambda path: calibrated(path, BOARD, False))
