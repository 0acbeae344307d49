"""Programs that find no packages but those that a user installs for them."""

import inspect
import os
import re
import sysconfig
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path

from packaging.requirements import Requirement

ROOT = Path(__file__).parents[2]
HIDING = """
import sys

class WithoutSome:
    def __init__(self, finder):
        self._finder = finder

    def __getattr__(self, name):
        return getattr(self._finder, name)

    def find_spec(self, name, *arguments):
        hidden = name.partition('.')[0] in {hidden!r}
        return None if hidden else self._finder.find_spec(name, *arguments)

sys.meta_path[:] = map(WithoutSome, sys.meta_path)
"""


def environment(folder, *files):
    """The environment of programs that have what requirement files name, and what that needs.

    folder: where the module is written that hides all else that is installed beside this Python.
    """
    lines = [line for each in files for line in (ROOT / each).read_text().splitlines()]
    needed = set().union(*(_with_its_own(each) for each in lines
                           if each and not each.startswith('#')))
    # Not what comes by PYTHONPATH, as a full ROS 2.
    here = [sysconfig.get_path(each) for each in ('purelib', 'platlib')]
    modules = {each: _modules(each) for each in distributions(path=here)}
    there = {'pmcl_ros'}.union(*(names for each, names in modules.items()
                                 if _normalized(each.name) in needed))
    folder.mkdir()
    (folder / 'sitecustomize.py').write_text(
        HIDING.format(hidden=set().union(*modules.values()) - there))
    return os.environ | {'PYTHONPATH': os.pathsep.join(
        filter(None, [str(folder), os.environ.get('PYTHONPATH')]))}


def _modules(package):
    """The names of its modules at the top, compiled ones among them."""
    # importlib.metadata.packages_distributions of Python 3.11 leaves those out.
    names = {each.parts[0] if len(each.parts) > 1 else inspect.getmodulename(each.name)
             for each in package.files or []}
    return {each for each in names if each and each.isidentifier()}


@cache
def _with_its_own(requirement):
    """The names of a package and of all that it needs here."""
    found, queue = set(), [Requirement(requirement)]
    while queue:
        each = queue.pop()
        for extra in {'', *each.extras}:
            if (_normalized(each.name), extra) in found:
                continue
            found.add((_normalized(each.name), extra))
            try:
                needs = map(Requirement, distribution(each.name).requires or [])
            except PackageNotFoundError:  # as those of ROS where a full ROS 2 is
                continue
            queue += [need for need in needs
                      if need.marker is None or need.marker.evaluate({'extra': extra})]
    return {name for name, _ in found}


def _normalized(name):
    return re.sub(r'[-_.]+', '-', name).lower()
