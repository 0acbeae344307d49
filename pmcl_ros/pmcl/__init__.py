"""DepthLikelihoodVolume -> PoseEstimate: particles, motion, renderer, scores, the filter, the estimate."""
