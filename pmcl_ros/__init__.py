"""Plenoptic Monte Carlo Object Localization.

RawFrame -> LightField -> DepthLikelihoodVolume -> PoseEstimate.
"""

import logging

__version__ = '0.1.0'

logging.getLogger(__name__).addHandler(logging.NullHandler())
