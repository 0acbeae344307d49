"""Rows of samples between the pixels of a plane."""

from pmcl_ros.dlv.sampling import TAPS
from pmcl_ros.runtime.kernels import compiled


@compiled()
def sample_row(view, x, y, taps, stride, between, out, count):  # type: ignore[no-untyped-def]
    """`count` samples of a row, `stride` apart, from the pixels around (x, y) on: down, across."""
    source = stride * (count - 1) + TAPS
    above, upper = view[y - 1, x - 1:x - 1 + source], view[y, x - 1:x - 1 + source]
    lower, below = view[y + 1, x - 1:x - 1 + source], view[y + 2, x - 1:x - 1 + source]
    # Weights of differences: what is the same everywhere is then read exactly.
    a, c, d = taps[1, 0], taps[1, 2], taps[1, 3]
    for i in range(source):
        u = upper[i]
        between[i] = u + (a * (above[i] - u) + c * (lower[i] - u) + d * (below[i] - u))
    a, c, d = taps[0, 0], taps[0, 2], taps[0, 3]
    if stride == 1:
        for i in range(count):
            u = between[i + 1]
            out[i] = u + (a * (between[i] - u) + c * (between[i + 2] - u)
                          + d * (between[i + 3] - u))
    else:
        for i in range(count):
            k = stride * i
            u = between[k + 1]
            out[i] = u + (a * (between[k] - u) + c * (between[k + 2] - u)
                          + d * (between[k + 3] - u))
