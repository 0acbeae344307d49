"""Sources of RawFrames: files, a Lytro, a simulated camera, a gateway."""
