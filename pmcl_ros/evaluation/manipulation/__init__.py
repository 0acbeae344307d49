"""Series of trials of the simulated robot through the real nodes: findings, a page."""
