"""Base of every stage's settings: frozen, validated, described once.

A field's name, default, range, unit and description are read from here by the ROS parameter
declarations, the YAML check, the command line's help and docs/reference.md.
"""

import reprlib
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from pmcl_ros.runtime.errors import FileError, SettingsError
from pmcl_ros.runtime.text_file import read_yaml_file

T = TypeVar('T', bound='Settings')

_NAMED = 5  # fields that one line names


class _Short(reprlib.Repr):
    """Values are shown in messages, however large they are."""

    def repr_int(self, x: int, level: int) -> str:
        """Python refuses to write thousands of digits."""
        return f'{x.bit_length()} bits' if x.bit_length() > 1000 else super().repr_int(x, level)


_SHORT = _Short()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 200


def explain(error: ValidationError) -> str:
    """What is wrong with which fields, with their values, in one line."""
    alike: dict[tuple[object, ...], list[ErrorDetails]] = {}  # of several items of a list
    for each in error.errors(include_url=False):
        place = tuple('*' if isinstance(part, int) else part for part in each['loc'])
        alike.setdefault((place, each['type'], each['msg']), []).append(each)
    groups = list(alike.values())
    lines = [_line(each[0]) + (f' and {len(each) - 1} more like it' if len(each) > 1 else '')
             for each in groups[:_NAMED]]
    more = sum(map(len, groups[_NAMED:]))
    return '; '.join([*lines, f'and {more} more'] if more else lines)


def _line(error: ErrorDetails) -> str:
    message = {'extra_forbidden': 'there is no such key'}.get(
        error['type'], error['msg'].removeprefix('Value error, '))
    line = ': '.join(['.'.join(str(part)[:80] for part in error['loc']), message])
    if error['type'] in ('missing', 'extra_forbidden') or (
            error['type'] == 'value_error' and isinstance(error['input'], dict)):
        return line.removeprefix(': ')  # the value tells nothing, or would be all the others
    return f'{line.removeprefix(": ")} (got {_SHORT.repr(error["input"])})'


def default_of(field: FieldInfo) -> Any:
    """The default of a field; None where it has none."""
    return None if field.is_required() else field.get_default(call_default_factory=True)


class Settings(BaseModel):
    """A frozen group of parameters; unknown names and impossible values raise SettingsError."""

    model_config = ConfigDict(frozen=True, extra='forbid', allow_inf_nan=False)

    @classmethod
    def make(cls: type[T], values: dict[str, Any], source: str = 'settings') -> T:
        """Validate `values`.

        The error names `source`, the field, the value and what would be right.
        """
        try:
            return cls.model_validate(values)
        except ValidationError as error:
            raise SettingsError(f'{source}: {explain(error)}') from None

    @classmethod
    def load(cls: type[T], path: Path | str) -> T:
        """Read a YAML file of exactly these fields."""
        return cls.make(read_yaml(path), str(path))

    def save(self, path: Path | str, comment: str = '') -> None:
        """Write the YAML file that `load` reads, `comment` lines first.

        Raises SettingsError when the file cannot be written.
        """
        lines = ''.join(f'# {line}\n' for line in comment.splitlines())
        values = self.model_dump(mode='json')
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
        try:
            Path(path).write_text(lines + text, encoding='utf-8')
        except OSError as error:
            raise SettingsError(f'cannot write {path}: {error.strerror or error}') from None


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises SettingsError when the file is missing, is not YAML or holds no mapping.
    """
    try:
        return read_yaml_file(path)
    except FileError as error:
        raise SettingsError(str(error)) from None
