"""Files that a command writes: none that is there already is overwritten unasked."""

from collections.abc import Iterable
from pathlib import Path

from pmcl_ros.runtime.errors import OutputError


def refuse_existing(paths: Iterable[Path], force: bool = False) -> None:
    """Raise OutputError, which names the first of `paths` that is there, unless `force`."""
    for path in () if force else paths:
        if path.exists() or path.is_symlink():
            raise OutputError(f'{path} is there already: give another name, or --force to '
                              'overwrite it')
