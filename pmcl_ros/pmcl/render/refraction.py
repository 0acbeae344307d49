"""Where what is below a flat surface of water seems to be: the kernel."""

import math

from pmcl_ros.runtime.kernels import compiled

_SNELL = 4  # steps of Newton's method for where a ray meets the water


@compiled(inner=True)
def raised(x, y, z, water):  # type: ignore[no-untyped-def]
    """How far below the interface a point seems to be raised [m], as of `Interface.apparent`."""
    height, index = float(water[3]), float(water[4])
    along = float(water[0]) * x + float(water[1]) * y + float(water[2]) * z
    depth = -height - along
    if depth <= 0:
        return 0.0
    across = math.sqrt(max(float(x) * x + float(y) * y + float(z) * z - along * along, 0.0))
    if across < 1e-6 * height:
        return depth - depth / index
    meets = across * height / (height + depth / index)
    for _ in range(_SNELL):
        rest = across - meets
        above, under = math.sqrt(meets * meets + height * height), math.sqrt(
            rest * rest + depth * depth)
        off = meets / above - index * rest / under
        slope = height * height / above ** 3 + index * depth * depth / under ** 3
        meets -= off / slope
    return depth - height * (across - meets) / meets
