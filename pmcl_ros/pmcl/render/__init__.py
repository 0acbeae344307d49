"""Poses -> z-buffers, contours and the scores fused with them, on the processor or a GPU."""
