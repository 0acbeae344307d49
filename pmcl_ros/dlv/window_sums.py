"""Sums over the window R_x: across a row of costs, then down the last rows."""

from pmcl_ros.runtime.kernels import compiled


@compiled(inner=True)
def sum_across(single, first, reach, sums):  # type: ignore[no-untyped-def]
    """Sum `reach` neighbours of each row, from column `first` on."""
    for label in range(len(sums)):
        row, out = single[label, first:], sums[label]
        for x in range(len(out)):
            out[x] = row[x]
        for k in range(1, reach):
            for x in range(len(out)):
                out[x] += row[x + k]


@compiled(inner=True)
def sum_down(across, oldest, sums):  # type: ignore[no-untyped-def]
    """Sum the rows of a window, from the oldest on, whatever place of the ring it is in."""
    reach = len(across)
    for label in range(len(sums)):
        out = sums[label]
        out[:] = 0
        for k in range(reach):
            row = across[(oldest + k) % reach, label]
            for x in range(len(out)):
                out[x] += row[x]
