"""Files -> LightField, PosedView or PosedViews: a file for each format; `read` chooses it."""
