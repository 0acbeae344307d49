"""Imports modules without looking for garbage among what stays as long as the process does."""

import gc
import sys
from importlib import import_module
from types import ModuleType


def imported(name: str) -> ModuleType:
    """The module, for what a process is started for: all there is then is no garbage to Python.

    While hundreds of modules come, and again when the process ends, Python would look through all
    of their objects: that took two fifths of the start of a node. Later collections are shorter.
    """
    if name in sys.modules:
        return sys.modules[name]
    enabled = gc.isenabled()
    gc.disable()
    try:
        module = import_module(name)
    finally:
        if enabled:
            gc.enable()
    gc.freeze()
    return module
