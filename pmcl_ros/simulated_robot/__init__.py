"""A simulated robot as a ROS node, with a camera at its wrist; what happened in a trial."""
