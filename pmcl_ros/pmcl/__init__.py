"""Evidence or DepthLikelihoodVolume, object -> PoseEstimate: search, posterior, tracking."""
