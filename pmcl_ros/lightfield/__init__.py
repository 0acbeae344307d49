"""RawFrame -> LightField: lattice, calibration, view synthesis, the geometry of views."""
