"""Calibration of a first-generation Lytro, from white images and checkerboards."""
