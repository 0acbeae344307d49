"""Base of every stage's settings: frozen, validated, described once.

A field's name, default, range, unit and description are read from here by the ROS parameter
declarations, the YAML check, the command line's help and docs/reference.md.
"""

import json
import re
import reprlib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_origin

import yaml
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from pmcl_ros.runtime.errors import FileError, OutputError, SettingsError, told_as
from pmcl_ros.runtime.outputs import write_file
from pmcl_ros.runtime.text_file import read_yaml_file

T = TypeVar('T', bound='Settings')

_NAMED = 5  # fields that one line names
_FEW_KEYS = 20  # of a group, which one line lists
_UNIT = re.compile(r'\[([^\[\]:]+)\]')  # in a description; an address's [:PORT] is none
_LIMITS = 'greater_than', 'greater_than_equal', 'less_than', 'less_than_equal'


def _odd(value: int) -> int:
    if value % 2 == 0:
        raise ValueError('must be odd, to have a centre')
    return value


Odd = Annotated[int, AfterValidator(_odd)]  # side of a square of views, or of a window


class _Short(reprlib.Repr):
    """Values are shown in messages, however large they are."""

    def repr_int(self, x: int, level: int) -> str:
        """Python refuses to write thousands of digits."""
        return f'{x.bit_length()} bits' if x.bit_length() > 1000 else super().repr_int(x, level)


_SHORT = _Short()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 200


def explain(error: ValidationError, model: type[BaseModel] | None = None) -> str:
    """What is wrong with which fields, with their values, in one line.

    model: whose fields they are, to suggest one in place of a name that is misspelt.
    """
    alike: dict[tuple[object, ...], list[ErrorDetails]] = {}  # of several items of a list
    for each in error.errors(include_url=False):
        place = tuple('*' if isinstance(part, int) else part for part in each['loc'])
        alike.setdefault((place, each['type'], each['msg']), []).append(each)
    groups = list(alike.values())
    lines = [_line(first, model) + (f' and {len(others)} more like it' if others else '')
             for first, *others in groups[:_NAMED]]
    more = sum(map(len, groups[_NAMED:]))
    lines += [f'and {more} more'] if more else []
    lines += filter(None, dict.fromkeys(_known(first, model) for first, *_ in groups[:_NAMED]))
    return '; '.join(lines)


def _model_at(model: Any, place: Sequence[object]) -> type[BaseModel] | None:
    """The model that a place in another one is of; None where that is not certain."""
    kinds = [each for each in (model, *get_args(model))
             if get_origin(each) is None and isinstance(each, type)
             and issubclass(each, BaseModel)]
    if not place:
        return kinds[0] if len(kinds) == 1 else None
    if len(kinds) == 1 and place[0] in kinds[0].model_fields:
        return _model_at(kinds[0].model_fields[str(place[0])].annotation, place[1:])
    inner = get_args(model)
    return _model_at(inner[-1 if get_origin(model) is dict else 0], place[1:]) if inner else None


def _keys(error: ErrorDetails, model: type[BaseModel] | None) -> Sequence[str]:
    """The keys that there are in place of an unknown one; of other errors none."""
    owner = error['type'] == 'extra_forbidden' and model and _model_at(model, error['loc'][:-1])
    return list(owner.model_fields) if owner else []


def _alike(error: ErrorDetails, keys: Sequence[str]) -> list[str]:
    return get_close_matches(str(error['loc'][-1])[:80], keys, 1) if keys else []


def _known(error: ErrorDetails, model: type[BaseModel] | None) -> str:
    """The keys that there are, where an unknown one is like none of them and they are few."""
    keys = _keys(error, model)
    return (f'the keys are {", ".join(keys)}'
            if 0 < len(keys) <= _FEW_KEYS and not _alike(error, keys) else '')


def units_of(field: FieldInfo) -> list[str]:
    """Those that the description of a field names, as `[m]`."""
    return [*dict.fromkeys(_UNIT.findall(field.description or ''))]


def _unit(error: ErrorDetails, model: type[BaseModel] | None) -> str:
    """That of a limit which a value is beyond, after a space; '' where the field has not one."""
    names = [*error['loc']]
    while names and isinstance(names[-1], int):
        names.pop()
    owner = _model_at(model, names[:-1]) if names and error['type'] in _LIMITS else None
    field = None if owner is None else owner.model_fields.get(str(names[-1]))
    units = [] if field is None else units_of(field)
    return f' {units[0]}' if len(units) == 1 and units[0] != '1' else ''


def _line(error: ErrorDetails, model: type[BaseModel] | None) -> str:
    message = error['msg'].removeprefix('Value error, ') + _unit(error, model)
    if error['type'] == 'extra_forbidden':
        message = 'there is no such key' + ''.join(
            f'; did you mean {each}?' for each in _alike(error, _keys(error, model)))
    if error['type'] == 'missing' and isinstance(error['loc'][-1], int):
        return (f'{".".join(map(str, error["loc"][:-1]))}: number {error["loc"][-1] + 1} is '
                f'missing (got {_SHORT.repr(error["input"])})')
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
            raise SettingsError(f'{source}: {explain(error, cls)}') from None

    @classmethod
    def load(cls: type[T], path: Path | str) -> T:
        """Read a YAML file of exactly these fields."""
        return cls.make(read_yaml(path), str(path))

    def save(self, path: Path | str, comment: str = '', given_only: bool = False) -> None:
        """Write the YAML file that `load` reads, `comment` lines first.

        given_only: without the fields that were not given, which have their defaults. Raises
        OutputError when the file cannot be written, and for the name of a file that is no UTF-8:
        nobody could read it again.
        """
        lines = ''.join(f'# {line}\n' for line in comment.splitlines())
        values = self.model_dump(mode='json', exclude_unset=given_only)
        try:
            json.dumps(values, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            name = error.object[:error.end].rpartition('"')[2]
            raise OutputError(f'cannot write {path}: the name {name!r}... is no UTF-8, as YAML '
                              'has to be: rename that file') from None
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
        write_file(path, lines + text)


def read_yaml(path: Path | str) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises SettingsError when the file is missing, is not YAML or holds no mapping.
    """
    with told_as(SettingsError, FileError):
        return read_yaml_file(path)


def suggest(name: str, kind: type[Settings]) -> str:
    """The end of a sentence about a name that is no field of `kind`."""
    close = get_close_matches(name, kind.model_fields, 1)
    known = ', '.join(kind.model_fields)
    return f'; did you mean {close[0]!r}?' if close else f' (known: {known})'
