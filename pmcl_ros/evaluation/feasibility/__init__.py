"""Will it work for this object and this camera? Simulated scenes, localised, on one page."""
