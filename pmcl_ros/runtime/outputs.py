"""Files that a command writes: none that is there already is overwritten unasked."""

import json
import os
import shutil
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from pmcl_ros.runtime.binary_file import sha256
from pmcl_ros.runtime.errors import OutputError
from pmcl_ros.runtime.text_file import read_json

_NOTE = '.pmcl_results.json'


def refuse_existing(paths: Iterable[Path], force: bool = False,
                    remedy: str = 'give another name, or --force to overwrite it') -> None:
    """Raise OutputError, which names the first of `paths` that is there, unless `force`.

    remedy: the end of its line.
    """
    for path in () if force else paths:
        if _is_there(path):
            raise OutputError(f'{path} is there already: {remedy}')


@contextmanager
def writing(path: Path | str) -> Iterator[None]:
    """Raises OutputError, which names the file, for an OSError of the code that writes it.

    A full disk names none.
    """
    try:
        yield
    except FileExistsError as error:  # of mkdir: a file is where the folder would be
        raise OutputError(f'cannot write {path}: {error.filename} is no folder') from None
    except OSError as error:
        raise OutputError(f'cannot write {path}: {error.strerror or error}') from None


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Where to write a file: beside it, to take its name once all is written. Its folder is made.

    What fails, as the disk is full, leaves nothing new, and what was there as it was. A device or
    a pipe is written itself, as is what has a name in /dev, such as /dev/stdout, wherever that
    goes, and a file in a folder that may not be changed. Raises as `writing`.
    """
    given = Path(path)
    whole = Path(os.path.realpath(path))  # a link stays one
    part = whole.with_name(f'{whole.name}.{os.getpid()}.part')
    with writing(path):
        given.parent.mkdir(parents=True, exist_ok=True)
        if given.exists() and not (given.is_file() and os.access(whole.parent, os.W_OK)
                                   and given.parts[:2] != ('/', 'dev')):
            yield given  # by its own name: a pipe may have no other
            return
        if whole.exists():
            whole.open('ab').close()  # raises for one that may not be written
        try:
            yield part
            if whole.exists():
                shutil.copymode(whole, part)
            part.replace(whole)
        except BaseException:
            with suppress(OSError):
                part.unlink()
            raise


def write_file(path: Path | str, content: str | bytes) -> None:
    r"""Write a file of text, in UTF-8, or of bytes; its folder is made.

    What UTF-8 has not, as in the names of files of another encoding, is written as `\udcff`.
    Raises OutputError, which names it, where that is impossible, as the disk is full; what was
    there then is as it was.
    """
    with replacing(path) as part:
        part.write_bytes(content.encode(errors='backslashreplace')
                         if isinstance(content, str) else content)


class Results:
    """What a command writes into a folder. It overwrites what it wrote in earlier runs only.

    A hidden file of the folder, `.pmcl_results.json`, has the SHA-256 of each result by command
    and name. One that has changed since is somebody's own. While a command runs it has null in
    place of them, so that a run that was killed can be repeated.
    """

    def __init__(self, folder: Path, command: str, force: bool = False) -> None:
        self.folder, self._command, self._force = folder, command, force
        # Of the names given: which file was there, and when it was written, if it is another's.
        self._before: dict[str, tuple[str, int] | None] = {}
        self._is_new = not folder.exists()

    def __enter__(self) -> 'Results':
        return self

    def path(self, name: str) -> Path:
        """Where to write a result; its folder is made.

        name: below the folder. Raises OutputError where a file is there that no earlier run
        wrote, unless `force`; FileError where `.pmcl_results.json` is damaged.
        """
        path = self.folder / name
        if name in self._before or (path.exists() and not (path.is_file() or path.is_dir())):
            return path  # a device keeps nothing
        own = self._own()
        is_own = not _is_there(path) or (name in own and own[name] in (None, _digest(path)))
        if not (is_own or self._force):
            raise OutputError(f'{path} is there already, and it is not what an earlier run wrote: '
                              'give another folder, or --force to overwrite it')
        with writing(path):
            path.parent.mkdir(parents=True, exist_ok=True)
        self._before[name] = None if is_own else _written(path)
        self._note(own | {name: None})
        return path

    def reserve(self, *names: str) -> None:
        """As `path` of each, before work that takes long."""
        for name in names:
            self.path(name)

    def remove_others(self) -> None:
        """Remove what earlier runs wrote, nobody changed, and this one has not named."""
        self._remove(self._own().keys() - self._before.keys())

    def remove_earlier(self) -> None:
        """Remove all that earlier runs wrote and nobody changed, before this one writes."""
        self._remove({name for name in self._own() if self._before.get(name) is None})

    def _remove(self, names: Collection[str]) -> None:
        own, here = self._own(), self.folder.resolve()
        for name in names:
            path = self.folder / name
            if not path.resolve().is_relative_to(here):
                raise OutputError(f'{self.folder / _NOTE} is damaged: it names {name}, which is '
                                  'not in its folder: delete it')
            if path.is_file() and own[name] in (None, _digest(path)):
                path.unlink()
                if path.parent != self.folder and not any(path.parent.iterdir()):
                    path.parent.rmdir()

    def __exit__(self, *_: object) -> None:
        """Note what was written; a folder that was made for nothing goes."""
        if self._before:
            now = {name: _digest(self.folder / name) for name in self._before}
            others = {name: each for name, each in self._own().items()
                      if name not in now and (self.folder / name).exists()}
            self._note(others | {name: each for name, each in now.items() if each
                                 and _written(self.folder / name) != self._before[name]})
            if self._is_new and not any(self.folder.iterdir()):
                self.folder.rmdir()

    def _own(self) -> dict[str, Any]:
        note = self.folder / _NOTE
        own = read_json(note).get(self._command, {}) if note.exists() else {}
        if not isinstance(own, dict):
            raise OutputError(f'{note} is damaged: delete it')
        return own

    def _note(self, own: dict[str, Any]) -> None:
        note = self.folder / _NOTE
        noted = {**(read_json(note) if note.exists() else {}), self._command: own}
        if any(noted.values()):
            write_file(note, json.dumps(noted, indent=1) + '\n')
        else:
            note.unlink(missing_ok=True)


def _is_there(path: Path) -> bool:
    return path.exists() or path.is_symlink()


def _written(path: Path) -> tuple[str, int]:
    """SHA-256 of a file, and when it was written [ns]."""
    return _digest(path), path.stat().st_mtime_ns if path.is_file() else 0


def _digest(path: Path) -> str:
    """SHA-256; '' where there is no file."""
    return sha256(path) if path.is_file() else ''
