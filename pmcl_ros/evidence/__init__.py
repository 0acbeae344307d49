"""LightField, PosedView or PosedViews -> EdgeVolume, ContourMap or ViewsEvidence."""
