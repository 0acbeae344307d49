"""LightField -> DepthLikelihoodVolume: cost volume, likelihood, truncation, edges."""
