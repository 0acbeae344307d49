"""Frames and cameras: pinhole, rigid transforms, symmetry, poses over time."""
