"""Pictures and poses of an ordinary camera on an arm -> LightField (a grid) or PosedViews."""
