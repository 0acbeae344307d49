"""Messages -> values -> messages: thin lifecycle nodes over the core, and what starts them."""

import sys
from importlib.util import find_spec

from pmcl_ros.runtime.errors import MissingRosError

if find_spec('rclpy') is None:
    _error = MissingRosError("ROS 2 is not there (no rclpy): pip install '.[ros]' in the source "
                             'tree, or source the setup.bash of a full ROS 2 Jazzy; pmcl works '
                             'without it')
    if sys.argv[:1] == ['-m']:  # Python looks for the program to run: no caller takes the error
        sys.exit(str(_error))
    raise _error
