"""pmcl.launch.py with its shipped parameters finds the glass in the shipped bag.

By launch_testing, on a full ROS 2 Jazzy where colcon has built this package. Elsewhere
test_launch.py checks this file, and runs its test with pmcl_bringup in place of the launch file.
"""

import unittest

import pytest
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from geometry_msgs.msg import PoseStamped
from harness import PATIENCE, User
from shipped_bag import BAG, check_pose

from pmcl_ros.nodes.runtime.base import SMALL

for _needed in ('launch_testing', 'launch_ros'):
    pytest.importorskip(_needed, reason=f'{_needed} is part of a full ROS 2, not on PyPI: '
                        f'apt-get install ros-jazzy-{_needed.replace("_", "-")}')


@pytest.mark.launch_test
def generate_test_description():
    """The nodes, and the bag in place of the camera."""
    from launch.actions import IncludeLaunchDescription
    from launch.launch_description_sources import PythonLaunchDescriptionSource
    from launch.substitutions import PathJoinSubstitution
    from launch_ros.actions import Node
    from launch_ros.substitutions import FindPackageShare
    from launch_testing.actions import ReadyToTest

    from launch import LaunchDescription
    try:
        get_package_share_directory('pmcl_ros')
    except PackageNotFoundError:
        raise unittest.SkipTest('pmcl_ros is not built: colcon build --packages-select pmcl_ros '
                                '&& . install/setup.bash') from None
    file = PathJoinSubstitution([FindPackageShare('pmcl_ros'), 'launch', 'pmcl.launch.py'])
    return LaunchDescription([
        IncludeLaunchDescription(PythonLaunchDescriptionSource([file]),
                                 launch_arguments=[('without', 'lytro_driver')]),
        Node(package='pmcl_ros', executable='pmcl_replay', output='screen',
             arguments=[str(BAG), '--timeout', str(PATIENCE)]),
        ReadyToTest(),
    ])


class TestLaunchedPose(unittest.TestCase):
    """While the nodes run."""

    def test_the_pose_is_the_true_one(self):
        user = User()
        try:
            poses = user.listen(PoseStamped, 'pose', SMALL)
            user.wait(lambda: poses, 'the pose')
        finally:
            user.close()
        check_pose(poses[0])
