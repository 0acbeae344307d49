"""DepthLikelihoodVolume -> PoseEstimate: renderer, scores, particles, the search, the estimate."""
