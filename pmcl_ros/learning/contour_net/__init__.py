"""Trains and calibrates the network of the contour map from labelled pictures."""
