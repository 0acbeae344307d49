"""`python -m pmcl_ros.nodes.reference`: docs/reference.md, or config/pmcl.yaml, from the code.

`make docs` writes both.
"""

import argparse
import sys
from collections.abc import Iterator, Sequence
from textwrap import fill
from typing import Any, Literal, get_args, get_origin

import yaml
from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo

from pmcl_ros.nodes.graph import (
    ALL,
    BOARD,
    FIXED,
    GRASPS,
    OPTIONAL,
    SERVICES,
    SWEEP,
    TOPICS,
    NodeEntry,
)
from pmcl_ros.nodes.runtime.parameters import is_live, ros_type
from pmcl_ros.runtime.settings import default_of, units_of

_WIDTH = 99  # characters of a line of config/pmcl.yaml
_HARD = '\xa0'  # a space that ends no line

# What of config/pmcl.yaml is not a default: the camera, object and region of bags/wine_glass.
_SHIPPED: dict[str, dict[str, Any]] = {
    'subaperture_node': {
        'calibration': 'package://pmcl_ros/config/cameras/demo.yaml',
        'white': 'package://pmcl_ros/config/cameras/demo_white.RAW.xz'},
    'pmcl_node': {
        'object': 'package://pmcl_ros/models/wine_glass.obj',
        'roi_center': [0.0154, 0.0116, 0.5487], 'roi_size': [0.16, 0.16, 0.16]},
    'grasp_node': {
        'grasps': 'package://pmcl_ros/config/objects/wine_glass.grasps.yaml'},
}

# What starts the nodes that are no part of the chain.
_ASKED_FOR = {GRASPS.name: 'a grasp file (--grasps, grasps:=): docs/howto/grasping.md',
              SWEEP.name: 'a plan (--sweep, sweep:=): docs/howto/sweep.md',
              FIXED.name: 'fixed cameras (--views fixed, views:=fixed): '
                          'docs/howto/fixed_cameras.md',
              BOARD.name: 'a printed board that tells camera poses (--board, board:=true): '
                          'docs/howto/board.md'}

_REFERENCE = """\
# Reference

Written by `make docs` from the code (`python -m pmcl_ros.nodes.reference`); do not edit it.

## Topics
Names are relative to the namespace of the nodes, except those with a slash; all may be remapped.
History, depth and reliability of each end can be overridden by read-only parameters when the node
is started, as `qos_overrides./dlv.publisher.depth: 2` or
`qos_overrides./views.subscription.reliability: best_effort`. Durability cannot be overridden. Best
effort or `keep_all` on a topic with *last 1* (big messages) gives a warning.

Not listed: `/tf`, published by pmcl_node where `broadcast_tf` is true, and read by nodes whose
parameters say so; `objects/NAME/pose` and `objects/NAME/pose_with_covariance` of pmcl_node, in
place of `pose`, `pose_with_covariance` and `particles`, where `objects` are listed
([several objects](howto/several.md)).

| node | direction | topic | type | quality of service | what |
|---|---|---|---|---|---|
"""

_SERVICES = """\

## Services
std_srvs/srv/Trigger; and those of every lifecycle node.

| node | service | what |
|---|---|---|
"""

_PARAMETERS = """\

## Parameters
Read when a node is configured, except those marked *live*: an active node checks and uses them as
soon as they are set. Ranges are those of `ros2 param describe`; the bound of an open range (`>`)
is refused at configure. A node that was started with an unknown parameter cannot be configured.
"""

_YAML = """\
# Parameters of every node, with their defaults; the camera, object and region are those of
# bags/wine_glass. They are read when a node is configured, those marked live at once. A double
# needs its point (1.0, not 1). Written by `make docs`; values may be edited in your own copy.
"""


def reference() -> str:
    """All that docs/reference.md holds."""
    return ''.join([_REFERENCE, *_topics(), _SERVICES, *_services(), _PARAMETERS,
                    *(part for entry in ALL for part in _parameters(entry))])


def parameter_file() -> str:
    """All that config/pmcl.yaml holds."""
    return _YAML + ''.join(_section(entry) for entry in ALL)


def _topics() -> Iterator[str]:
    for node in [entry.name for entry in ALL]:
        for each in (*TOPICS, *OPTIONAL):
            for direction, nodes, quality in (
                    ('out', each.publishers, each.quality),
                    ('in', each.subscribers, each.quality_for(node))):
                if node in nodes:
                    yield _row(node, direction, f'`{each.name}`', each.type, quality.describe(),
                               each.what)
    yield from (_row('all', 'out', f'`{each.name}`', each.type, each.quality.describe(), each.what)
                for each in TOPICS if 'all nodes' in each.publishers)


def _services() -> Iterator[str]:
    for node, services in SERVICES.items():
        yield from (_row(node, f'`{name}`', what) for name, what in services)


def _parameters(entry: NodeEntry) -> Iterator[str]:
    yield (f'\n### {entry.name}\n| name | type | default | range | unit | description | live |\n'
           '|---|---|---|---|---|---|---|\n')
    for name, field in entry.load().settings_class.model_fields.items():
        yield _row(f'`{name}`', ros_type(field).name.lower(), f'`{_text(default_of(field))}`',
                   _range(field), _unit(field), field.description or '',
                   'yes' if is_live(field) else '')


def _row(*cells: str) -> str:
    return f'| {" | ".join(each.replace("|", chr(92) + "|") for each in cells)} |\n'


def _section(entry: NodeEntry) -> str:
    lines = ['']
    if entry.name in _ASKED_FOR:
        lines += [f'# Not started unless bring-up or launch get {_ASKED_FOR[entry.name]}']
    lines += [f'/**/{entry.name}:', '  ros__parameters:']
    for name, field in entry.load().settings_class.model_fields.items():
        notes = [each for each in (_range(field), 'live' if is_live(field) else '') if each]
        whole = '; '.join(notes).replace(' ', _HARD)  # is not broken
        comment = (field.description or '') + (f' ({whole})' if notes else '')
        lines += [fill(comment, _WIDTH, initial_indent='    # ', subsequent_indent='    # ',
                       break_long_words=False, break_on_hyphens=False).replace(_HARD, ' ')]
        value = _SHIPPED.get(entry.name, {}).get(name, default_of(field))
        lines += [f'    {name}: {_text(value)}']
    return '\n'.join(lines) + '\n'


def _text(value: Any) -> str:
    """A value as YAML writes it."""
    value = list(value) if isinstance(value, tuple) else value
    text = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return text.removesuffix('...\n').strip()


def _unit(field: FieldInfo) -> str:
    if ros_type(field).name.removesuffix('_ARRAY') not in ('INTEGER', 'DOUBLE'):
        return ''
    return ', '.join(units_of(field))


def _range(field: FieldInfo) -> str:
    """The choices, or the bounds, of a field or of each item of it."""
    if get_origin(field.annotation) is Literal:
        return ', '.join(map(str, get_args(field.annotation)))
    items = [note for item in get_args(field.annotation)
             for note in getattr(item, '__metadata__', ())]  # Annotated[float, Field(gt=0)]
    bounds = {type(bound): bound for each in (field, *items) for bound in each.metadata}
    if Ge in bounds and Le in bounds:
        return f'{bounds[Ge].ge:.10g} to {bounds[Le].le:.10g}'
    words = ((Ge, '>=', 'ge'), (Gt, '>', 'gt'), (Le, '<=', 'le'), (Lt, '<', 'lt'))
    return ', '.join(f'{sign} {getattr(bounds[kind], value):.10g}' for kind, sign, value in words
                     if kind in bounds)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--parameters', action='store_true',
                        help='print config/pmcl.yaml, not docs/reference.md')
    options = parser.parse_args(args)
    sys.stdout.write(parameter_file() if options.parameters else reference())
    return 0


if __name__ == '__main__':
    sys.exit(main())
