"""LightField -> EdgeVolume: what pictures show of the contours of surfaces."""
