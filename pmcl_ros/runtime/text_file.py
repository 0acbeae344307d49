"""Text, JSON and YAML files that anybody may have written: bounded before they are read.

A YAML alias costs a byte or two and stands for as much as was anchored, as often as it is written:
nodes are counted as they are when all aliases and merge keys are followed.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from pmcl_ros.runtime.binary_file import read_bytes
from pmcl_ros.runtime.errors import FileError

MOST_BYTES = 2 ** 24  # of any text that is parsed as a whole
_MOST_YAML = 2 ** 22  # bytes
_MOST_NODES, _DEEPEST = 100_000, 64  # of YAML: values, and levels of nesting
_LONGEST_NUMBER = 400  # characters; a float's largest value has 309 digits
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)  # ten times as fast, where there is one


def read_text(path: Path | str, most: int = MOST_BYTES) -> str:
    """The UTF-8 text of a file, without a byte order mark.

    FileError where it has more than `most` bytes, or is no text.
    """
    data = read_bytes(Path(path), most)
    try:
        return data.decode('utf-8').removeprefix('\ufeff')
    except UnicodeDecodeError as error:
        raise FileError(f'{path} is no text in UTF-8: byte {error.start} is '
                        f'0x{data[error.start]:02x}') from None


def read_json(path: Path | str) -> dict[str, Any]:
    """The JSON object of a file; FileError where there is none."""
    return _mapping(path, parse_json(read_text(path), str(path)))


def parse_json(text: str, source: str) -> Any:
    """The value of a JSON text; FileError, which names `source`, where it is none."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:  # ValueError: also of 5,000 digits
        raise FileError(f'{source} is not valid JSON: {error}') from None


def read_yaml_file(path: Path | str) -> dict[str, Any]:
    """The mapping of a YAML file; FileError where there is none."""
    return _mapping(path, parse_yaml(read_text(path, _MOST_YAML), str(path)))


def parse_yaml(text: str, source: str) -> Any:
    """The value of a YAML text; FileError, which names `source`, where it is none, or too large.

    At most 100,000 nodes in 64 levels, aliases followed; no key twice in a mapping.
    """
    try:
        _check_nodes(text, source)
        loader = _LOADER(text)
        root = loader.get_single_node()
        _check_keys(root)
        return None if root is None else loader.construct_document(root)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f' in line {mark.line + 1}, column {mark.column + 1}' if mark else ''
        what = ', '.join(each for each in (error.context, error.problem) if each)
        raise FileError(f'{source} is not valid YAML{where}: {what}') from None
    # Constructors have errors of their own for 2026-99-99, 1:1:1:... and [[]: 1].
    except (yaml.YAMLError, ValueError, TypeError, LookupError, ArithmeticError, AttributeError,
            RecursionError) as error:
        raise FileError(f'{source} is not valid YAML: {error}') from None


def _check_nodes(text: str, source: str) -> None:
    """FileError for too many nodes, levels or digits."""
    sizes: dict[str | None, int] = {}  # of what is anchored
    open_nodes: list[tuple[str | None, int]] = []  # anchor, and nodes before it
    nodes = 0
    for event in yaml.parse(text, Loader=_LOADER):
        if isinstance(event, yaml.AliasEvent):
            nodes += sizes.get(event.anchor, 0)  # 0: the loader says that it is undefined
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_nodes.pop()
            if anchor is not None:
                sizes[anchor] = nodes - before
        elif isinstance(event, yaml.NodeEvent):
            nodes += 1
            if isinstance(event, yaml.CollectionStartEvent):
                open_nodes.append((event.anchor, nodes - 1))
            elif event.anchor is not None:
                sizes[event.anchor] = 1
            if isinstance(event, yaml.ScalarEvent) and event.implicit[0] and (
                    len(event.value) > _LONGEST_NUMBER and event.value[:1] in '+-.0123456789'):
                raise FileError(f'{source} has a number of {len(event.value)} characters in '
                                f'{_place(event)}; put quotes around text')
        if nodes > _MOST_NODES or len(open_nodes) > _DEEPEST:
            raise FileError(
                f'{source} has more than {_MOST_NODES} values or {_DEEPEST} levels at '
                f'{_place(event)} (aliases followed): expected a file of settings')


def _check_keys(root: yaml.Node | None) -> None:
    """MarkedYAMLError for a key that a mapping has twice: its last value would be taken."""
    todo, known = [root], set[int]()
    while todo:
        node = todo.pop()
        if not isinstance(node, yaml.CollectionNode) or id(node) in known:
            continue
        known.add(id(node))  # aliases are the same node, or one around it
        if not isinstance(node, yaml.MappingNode):
            todo += node.value
            continue
        keys: set[tuple[str, str]] = set()
        for key, value in node.value:
            todo += key, value
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in keys:
                    raise yaml.MarkedYAMLError(problem=f'{key.value!r} is there more than once',
                                               problem_mark=key.start_mark)
                keys.add((key.tag, key.value))


def _place(event: yaml.Event) -> str:
    return f'line {event.start_mark.line + 1}' if event.start_mark else 'its beginning'


def _mapping(path: Path | str, values: Any) -> dict[str, Any]:
    if not isinstance(values, Mapping):
        raise FileError(
            f'{path} holds {type(values).__name__}, expected a mapping of names to values')
    return dict(values)
