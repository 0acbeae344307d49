"""The paper's section IV: what a depth likelihood means for rays that come from several surfaces.

It says nothing about pixels: `reference` and `cost` compute likelihoods from views.
"""
