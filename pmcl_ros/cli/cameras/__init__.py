"""Commands of cameras: calibration, hand-eye, pictures, containers, sweeps."""
