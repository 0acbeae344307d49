"""Learns the numbers of the contour evidence from generated scenes."""
