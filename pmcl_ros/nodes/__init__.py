"""Messages -> values -> messages: thin lifecycle nodes over the core, and what starts them."""

import sys
from importlib.util import find_spec

if find_spec('rclpy') is None:  # all in here are programs: a line says more than a traceback
    sys.exit("ROS 2 is not there (no rclpy): pip install '.[ros]' in the source tree, or source "
             "the setup.bash of a full ROS 2 Jazzy; pmcl works without it")
