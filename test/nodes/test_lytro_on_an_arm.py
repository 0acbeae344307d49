"""A Lytro on an arm: its raw pictures become posed views, through the nodes that decode them."""

import cv2
import numpy as np
import yaml
from geometry_msgs.msg import PoseArray, PoseStamped
from harness import Process
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import CameraInfo, Image

from pmcl_ros.geometry.header import Header
from pmcl_ros.geometry.se3 import inverse, pose_of
from pmcl_ros.messages.header import header_from, header_to_message
from pmcl_ros.messages.pose import pose_to_message
from pmcl_ros.messages.posed_views import posed_views_from
from pmcl_ros.nodes.runtime.base import BIG, SMALL
from pmcl_ros.simulated_robot.wrist_eyes import RawEye
from pmcl_ros.simulation.lytro.calibration_pictures import write_calibration
from pmcl_ros.simulation.lytro.camera import LytroCamera
from pmcl_ros.simulation.lytro.raw_picture import raw_picture
from pmcl_ros.simulation.manipulation.camera_kinds import WIDE_F01
from pmcl_ros.simulation.scenes.environment import Environment
from pmcl_ros.simulation.scenes.rays import fast_along
from pmcl_ros.simulation.scenes.render import seen_from
from pmcl_ros.simulation.scenes.scene import Scene, Sheet

CAMERA = LytroCamera.make(WIDE_F01.model_dump() | {'width': 400, 'height': 400})
SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
SPOT = np.array([0.005, -0.004, 0.45])  # in the base frame, that of the first camera
CAMERAS = (np.eye(4), pose_of(Rotation.from_euler('y', -0.13), np.array([0.06, 0, 0])))


def middle_of_what_is_dark(picture):
    grey = picture.mean(axis=-1)
    v, u = np.nonzero(grey < 0.6 * np.median(grey))
    return u.mean(), v.mean()


def test_its_raw_pictures_become_posed_views(tmp_path, user):
    write_calibration(tmp_path, CAMERA)
    dark = Sheet(pose_of(Rotation.identity(), SPOT), (0.006, 0.006),
                 np.zeros((8, 8, 3), np.float32), 1.0)
    scene = Scene('spot', (), (dark,), Environment(np.ones((8, 16, 3), np.float32)), np.eye(3),
                  CAMERA.sensor(np.random.default_rng(0)), (), ())
    parameters = tmp_path / 'parameters.yaml'
    parameters.write_text(yaml.safe_dump({
        'subaperture_node': {'ros__parameters': {
            'calibration': str(tmp_path / 'calibration.yaml'), 'white': str(tmp_path / 'white')}},
        'sweep_driver': {'ros__parameters': {'poses': 'topic', 'gamma': 2.4, 'patience': 60.0}}}))
    without = [each for node in ('lytro_driver', 'dlv_node', 'pmcl_node')
               for each in ('--without', node)]
    rng = np.random.default_rng(1)
    eye = RawEye(user.node, lambda scene: raw_picture(CAMERA, fast_along(scene), rng, 8))
    with Process(tmp_path, 'pmcl_ros.nodes.bringup', '--params-file', parameters, '--views',
                 'rest', '--lytro', *without) as chain:
        came = [user.listen(kind, topic, qos) for kind, topic, qos in (
            (CameraInfo, 'posed_views/camera_info', SMALL),
            (PoseArray, 'posed_views/poses', SMALL),
            (Image, 'posed_views/sigma', SMALL), (Image, 'posed_views', BIG))]
        poses = user.publisher(PoseStamped, 'camera_pose', 200)
        user.wait(lambda: 'active: ' in chain.log or not chain.alive(), 'the chain')
        assert 'active: sweep_driver, subaperture_node' in chain.log
        user.meet('sweep_driver', 'subaperture_node')
        for number, camera in enumerate(CAMERAS):
            stamp, file = START + number * SECOND, tmp_path / f'{number}.png'
            eye.shoot(seen_from(scene, camera), Header(stamp, 'wrist'), file)
            for step in (-1, 0, 1):
                header = header_to_message(Header(stamp + step * SECOND // 20, 'base_link'))
                poses.publish(PoseStamped(header=header, pose=pose_to_message(camera)))
            user.wait(file.is_file, 'its centre view')
        user.wait(lambda: all(came), 'posed views')
    found = posed_views_from(*(each[-1] for each in came))
    assert header_from(came[-1][-1].header) == Header(START + SECOND, 'base_link')
    assert len(found.views) == 2
    for number, (view, camera) in enumerate(zip(found.views, CAMERAS, strict=True)):
        x, y, z = inverse(camera)[:3, :3] @ SPOT + inverse(camera)[:3, 3]
        of = CAMERA.calibration
        expected = of.fx * x / z + of.cx, of.fy * y / z + of.cy
        np.testing.assert_allclose(view.camera_to_reference, camera, atol=1e-9)
        np.testing.assert_allclose(middle_of_what_is_dark(view.picture), expected, atol=0.4)
        kept = cv2.imread(str(tmp_path / f'{number}.png'))
        np.testing.assert_allclose(middle_of_what_is_dark(kept), expected, atol=0.4)
