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

from pmcl_ros.runtime.errors import SettingsError

T = TypeVar('T', bound='Settings')

# Values are shown in messages, however large they are: YAML aliases can nest without end.
_SHORT = reprlib.Repr()
_SHORT.maxlevel = 3
_SHORT.maxstring = _SHORT.maxother = 200


def explain(error: ValidationError) -> str:
    """What is wrong with which fields, with their values, in one line."""
    return '; '.join(_line(each) for each in error.errors())


def _line(error: ErrorDetails) -> str:
    line = ': '.join(['.'.join(str(part) for part in error['loc']), error['msg']])
    if error['type'] == 'missing':  # the value would be all the others
        return line
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
        values = yaml.safe_load(Path(path).read_text(encoding='utf-8'))
    except OSError as error:
        raise SettingsError(
            f'cannot read {path}: {error.strerror or error}; check the path') from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: a date 2026-99-99
        raise SettingsError(f'{path} is not valid YAML: {error}') from None
    if not isinstance(values, dict):
        raise SettingsError(
            f'{path} holds {type(values).__name__}, expected a mapping of names to values')
    return values
