"""PoseEstimate -> grasps: how a gripper with two fingers can take the object."""
