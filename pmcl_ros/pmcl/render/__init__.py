"""Z-buffers of poses and the scores fused with them, on the processor or a GPU."""
