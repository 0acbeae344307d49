"""Calibration of cameras and of their poses, from pictures of boards."""
