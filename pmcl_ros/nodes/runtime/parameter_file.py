"""Checks ROS parameter files: node names and parameter names must exist."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from re import escape, fullmatch
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from pmcl_ros.nodes.graph import ALL, NodeEntry
from pmcl_ros.runtime.errors import SettingsError
from pmcl_ros.runtime.settings import read_yaml, suggest

_VALUES = 'ros__parameters'
_WILD = ('*', '**')
# Parameters, or their first part, that ROS gives every node.
_EVERY = ('qos_overrides', 'use_sim_time', 'start_type_description_service')


def check_parameter_file(path: Path | str, node: str = '') -> list[str]:
    """The names of nodes in a file that are none of this package's: a file may serve others too.

    SettingsError for a name that is one of ours but for a slip, for a parameter given to a node
    that does not have it, and for a file that holds no parameters: ROS would start every node
    with its defaults, without a word. What is given to all nodes each judges for itself.
    node: judge the parameters of this one alone.
    """
    known, others, found = {each.name: each for each in ALL}, [], False
    for section, values in _sections(path, read_yaml(path), ''):
        found = True
        name = section.rpartition('/')[2]
        if name in known and node in ('', name):
            _check_names(path, section, known[name], values)
        if name in (*known, *_WILD):
            continue
        if close := get_close_matches(name, known, 1):
            raise SettingsError(f'{path} has parameters for {section!r}, but there is no node '
                                f'{name!r}; did you mean {close[0]!r}?')
        others.append(section)
    if not found:
        raise SettingsError(f'{path} has no parameters: expected NODE: {{{_VALUES}: {{NAME: '
                            f'VALUE}}}} with a NODE of {", ".join(known)}')
    return others


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """The files that a command line names."""
    return [file for before, file in pairwise(arguments) if before == '--params-file']


def given_to_all(arguments: Sequence[str]) -> set[str]:
    """Names of the parameters that the files of a command line give to nodes of any name."""
    return {name for file in parameter_files(arguments)
            for section, values in _sections(file, read_yaml(file), '')
            if section.rpartition('/')[2] in _WILD for name in values}


def given_elsewhere(arguments: Sequence[str], node: str) -> list[tuple[str, str]]:
    """Files of a command line, with a section each, that are for a node of this name elsewhere.

    node: its full name. ROS gives `pmcl_node` to the node in no namespace alone, without a word.
    Of a file that has parameters for the node itself none: it may serve several robots.
    """
    found = []
    for file in parameter_files(arguments):
        sections = [section for section, _ in _sections(file, read_yaml(file), '')]
        own = [each for each in sections if each.rpartition('/')[2] == node.rpartition('/')[2]]
        if own and not any(_means(each, node) for each in sections):
            found.append((file, own[0]))
    return found


def _means(section: str, node: str) -> bool:
    """Whether a section is for a node of this full name; `**` are any parts, `*` is one."""
    parts = {'**': '(/[^/]+)*', '*': '/[^/]+'}
    return fullmatch(''.join(parts.get(each, '/' + escape(each)) for each in section.split('/')),
                     node) is not None


@contextmanager
def parameter_file(values: Mapping[str, Mapping[str, Any]]) -> Iterator[list[str]]:
    """Arguments for ROS that give each node its own values, without None and ''.

    values: by name of the node, in whatever namespace: `-p node:name:=value` holds in none.
    They go over what files before them say.
    """
    # ROS orders sections by where their names come first: no file has one of this name.
    given = {node: {name: value for name, value in each.items() if value not in (None, '')}
             for node, each in values.items()}
    sections = {f'/**/**/{node}': {_VALUES: each} for node, each in given.items() if each}
    if not sections:
        yield []
        return
    with TemporaryDirectory() as folder:
        path = Path(folder) / 'parameters.yaml'
        path.write_text(yaml.safe_dump(sections))
        yield ['--ros-args', '--params-file', str(path), '--']


def owners_of(name: str) -> list[str]:
    """The nodes that have a parameter of this name."""
    return [each.name for each in ALL if name in each.load().settings_class.model_fields]


def _check_names(path: Path | str, section: str, node: NodeEntry, values: dict[str, Any]) -> None:
    kind = node.load().settings_class
    for name, value in values.items():
        if isinstance(value, list) and {int, float} == {type(each) for each in value}:
            raise SettingsError(f'{path} gives {section!r} {name}: {value}: ROS wants numbers of '
                                'one kind, each with a point, as 0.0')
        if name in kind.model_fields or str(name).partition('.')[0] in _EVERY:
            continue
        owners = owners_of(name)
        hint = f'; {" and ".join(owners)} has it' if owners else suggest(str(name), kind)
        raise SettingsError(f'{path} gives {section!r} an unknown parameter {name!r}{hint}')


def _sections(path: Path | str, values: dict[str, Any], above: str
              ) -> Iterator[tuple[str, dict[str, Any]]]:
    """The full names, namespaces may be nested, under which there are values; and these."""
    for key, inside in values.items():
        if key == _VALUES:
            if not isinstance(inside, dict | None):
                raise SettingsError(f'{path} gives {above!r} {_VALUES}: {inside}: expected a '
                                    'mapping {NAME: VALUE}')
            yield above, inside or {}
        elif isinstance(inside, dict):
            yield from _sections(path, inside, f'{above}/{str(key).strip("/")}'.lstrip('/'))
