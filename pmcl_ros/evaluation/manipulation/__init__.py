"""A simulated robot takes objects from water through the real nodes: trials, a report."""
