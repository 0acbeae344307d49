"""LightField -> EdgeVolume: contour evidence from refocused edges."""
