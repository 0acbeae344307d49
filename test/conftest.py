"""What the tests share: a ROS domain for each worker, and the JSON of a made-up camera."""

import json
import os

import pytest

# Before any rclpy.init, and inherited by every process a test starts. Fields are checked, as a
# message that only passes unchecked is not one that another build of ROS takes.
_WORKER = os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw')
os.environ['ROS_DOMAIN_ID'] = str(50 + int(_WORKER) % 50)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
os.environ.setdefault('ROS_PYTHON_CHECK_FIELDS', '1')


@pytest.fixture(scope='session')
def camera_text():
    """A function (width, height) -> the JSON that an F01 writes beside a picture of that size."""
    def text(width=3280, height=3280):
        levels = {'r': 168, 'gr': 168, 'gb': 168, 'b': 168}
        image = {
            'width': width, 'height': height,
            'rawDetails': {
                'pixelFormat': {'black': levels, 'white': dict.fromkeys(levels, 4095)},
                'mosaic': {'tile': 'r,gr:gb,b', 'upperLeftPixel': 'b'},
            },
            'color': {'ccmRgbToSrgbArray': [1, 0, 0, 0, 1, 0, 0, 0, 1], 'gamma': 0.41666,
                      'whiteBalanceGain': dict.fromkeys(levels, 1.0)},
        }
        return json.dumps({'image': image})
    return text
