"""Compiles kernels ahead, on all cores, with progress: commands, `pmcl warm-up`, the demo."""
