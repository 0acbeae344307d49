"""What is installed of what the package needs; imports nothing that may be missing."""

import re
import shlex
import sys
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version

# What a distribution may bring without pip's knowing: the package, and its module.
_UNKNOWN_TO_PIP = {'opencv-python-headless': 'cv2'}


def lacking() -> list[str]:
    """The requirements that are not installed, or too old, as NAME>=VERSION.

    Raises PackageNotFoundError where the package itself is not installed.
    """
    wanted = [each for each in requires('pmcl_ros') or () if 'extra' not in each]
    return [each for each in wanted if not installed(each)]


def installed(requirement: str) -> bool:
    """Whether a package is installed as a requirement NAME>=VERSION asks."""
    found = _version(requirement)
    least = requirement.replace('==', '>=').partition('>=')[2]
    return found is not None and _numbers(found) >= _numbers(least)


def described(requirements: list[str]) -> str:
    """Requirements, each with the version that is installed in its place."""
    found = [(each, _version(each)) for each in requirements]
    return ', '.join(each if there is None else f'{each} (here is {there})'
                     for each, there in found)


def install_command(requirements: list[str]) -> str:
    """The shell command that installs them, for this interpreter.

    The system's Python takes no packages of pip (PEP 668): then for a virtual environment that
    sees the system's.
    """
    packages = ' '.join(shlex.quote(each) for each in requirements)
    if sys.prefix != sys.base_prefix:
        return f'{shlex.quote(sys.executable)} -m pip install {packages}'
    return (f'{shlex.quote(sys.executable)} -m venv --system-site-packages .venv && '
            f'. .venv/bin/activate && python -m pip install {packages}')


def _version(requirement: str) -> str | None:
    name = re.split(r'[^\w.-]', requirement)[0]
    try:
        return version(name)
    except PackageNotFoundError:
        pass
    try:
        return str(import_module(_UNKNOWN_TO_PIP[name]).__version__)
    except (KeyError, ImportError, AttributeError):  # the last: it is for another numpy
        return None


def _numbers(text: str) -> list[int]:
    return [int(each) for each in re.findall(r'\d+', text)[:3]]
