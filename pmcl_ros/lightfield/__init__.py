"""RawFrame, files or frames of a moved camera -> LightField, PosedView or PosedViews."""
