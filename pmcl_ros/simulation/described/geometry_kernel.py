"""The library that cuts and offsets solids and outlines."""

from functools import cache
from types import ModuleType

from pmcl_ros.runtime.errors import SimulationError


@cache
def manifold() -> ModuleType:
    """The module manifold3d. Raises SimulationError where it is not installed."""
    try:
        import manifold3d
    except ImportError:
        raise SimulationError("described objects need manifold3d: pip install "
                              "'pmcl_ros[simulate]' (or [manipulate], for a simulated arm)"
                              ) from None
    return manifold3d
