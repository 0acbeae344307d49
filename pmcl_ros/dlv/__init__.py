"""LightField or PosedViews -> DepthLikelihoodVolume: cost, likelihood, truncation, layers."""
