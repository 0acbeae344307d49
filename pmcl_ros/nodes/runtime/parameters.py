"""ROS parameters of a Settings class: declared, read, and changed while the node runs."""

import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import NoneType
from typing import Any, Literal, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterUninitializedException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from pmcl_ros.nodes.runtime.parameter_file import given_elsewhere, given_to_all, owners_of
from pmcl_ros.runtime.errors import PmclError, SettingsError
from pmcl_ros.runtime.settings import Settings, default_of, suggest

OVERRIDES = 'qos_overrides.'  # rclpy's own prefix
_TYPES = {bool: 'BOOL', int: 'INTEGER', float: 'DOUBLE', str: 'STRING'}


class Parameters:
    """The parameters of a node: names, defaults, ranges and descriptions are those of `kind`.

    A value that ROS refuses when the node starts does not end the node: `read` reports it
    until a valid one is set. It also reports values of unknown parameters.
    """

    def __init__(self, node: Node, kind: type[Settings]) -> None:
        self._node, self._kind = node, kind
        self._refused: dict[str, str] = {}
        self._used: Settings | None = None
        self._to_all = given_to_all(sys.argv)  # now: the files may go
        for name, field in kind.model_fields.items():
            self._declare(name, field)
        node.add_post_set_parameters_callback(self._accepted)
        full = node.get_fully_qualified_name()
        for file, section in given_elsewhere(sys.argv, full):
            node.get_logger().warning(
                f'{file} has parameters for {section!r}, not for {full}: for nodes in any '
                f'namespace it is /**/{node.get_name()}')

    def read(self) -> Settings:
        """The parameters as they are now; SettingsError names every impossible or missing one.

        A value that is the default counts as not chosen (`model_fields_set`): parameter files
        list all values.
        """
        self._refuse_unknown()
        if self._refused:
            raise SettingsError('; '.join(self._refused.values()))
        values = {}
        for name, field in self._kind.model_fields.items():
            try:
                value = self._node.get_parameter(name).value
            except ParameterUninitializedException:
                continue  # the settings know whether it may be missing
            value = value if isinstance(value, (bool, int, float, str)) else tuple(value)
            if field.is_required() or value != default_of(field):
                values[name] = value
        return self._kind.make(values, f'parameters of {self._node.get_name()}')

    @contextmanager
    def used(self, settings: Settings) -> Iterator[None]:
        """While it lasts, say of a parameter that is set that the node goes on with `settings`."""
        self._used = settings
        try:
            yield
        finally:
            self._used = None

    def _declare(self, name: str, field: FieldInfo) -> None:
        kind = ros_type(field)
        when = 'applied at once' if is_live(field) else 'read at the next configure'
        descriptor = ParameterDescriptor(description=field.description or '',
                                         additional_constraints=when)
        if kind == Parameter.Type.DOUBLE:
            descriptor.floating_point_range = _range(field, FloatingPointRange, float,
                                                     -sys.float_info.max, sys.float_info.max)
        elif kind == Parameter.Type.INTEGER:
            descriptor.integer_range = _range(field, IntegerRange, int, -2**63, 2**63 - 1)
        try:
            default = kind if default_of(field) is None else ros_value(field)
        except PmclError:  # its file is broken: `read` raises the error again, unless it is mended
            default = kind
        try:
            self._node.declare_parameter(name, default, descriptor)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            self._refused[name] = _reason(name, kind, error)
        if name in self._refused:
            self._node.declare_parameter(name, default, descriptor, ignore_override=True)

    def _refuse_unknown(self) -> None:
        """SettingsError for a misspelt name; one that another node has may be for all nodes.

        Without a word where a parameter file gives it to all: some of them are to take it.
        """
        node, misspelt = self._node.get_name(), []
        for name in unknown_parameters(self._node):
            if name.startswith(OVERRIDES):
                continue  # declared with their publisher or subscription
            owners = owners_of(name)
            if owners and name in self._to_all:
                continue
            if owners:
                self._node.get_logger().warning(
                    f'parameter {name!r} is none of {node}, it is one of {" and ".join(owners)}: '
                    'without effect here')
            else:
                misspelt.append(f'unknown parameter {name!r}{suggest(name, self._kind)}')
        if misspelt:
            raise SettingsError(f'{node}: {"; ".join(misspelt)}. Correct what the node is started '
                                'with (parameter file, -p) and start it again')

    def _accepted(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            self._refused.pop(parameter.name, None)
        waiting = [f'{each.name} {each.value}' for each in parameters if self._waits(each)]
        if waiting:
            self._node.get_logger().warning(
                f'{" and ".join(waiting)}: read at the next configure (deactivate, cleanup, '
                'configure, activate); until then the node goes on with what it has')

    def _waits(self, parameter: Parameter) -> bool:
        """Whether a value is another than the one in use, and the node does not take it over."""
        if self._used is None or parameter.name not in self._kind.model_fields:
            return False
        given, used = parameter.value, getattr(self._used, parameter.name)
        return not is_live(self._kind.model_fields[parameter.name]) and (
            tuple(given) if isinstance(used, tuple) else given) != used


def unknown_parameters(node: Node) -> list[str]:
    """The parameters that the node was started with but does not have."""
    # Private in rclpy 7.1, which has no public list of overrides that are not declared.
    return sorted(name for name in node._parameter_overrides if not node.has_parameter(name))


def ros_type(field: FieldInfo) -> Parameter.Type:
    """The ROS type of a settings field: scalars, choices among them, tuples of them, or None."""
    annotation: Any = field.annotation
    choices = [each for each in get_args(annotation) if each is not NoneType]
    if NoneType in get_args(annotation) and len(choices) == 1:
        annotation, choices = choices[0], list(get_args(choices[0]))
    if get_origin(annotation) is Literal:
        return Parameter.Type[_TYPES[type(choices[0])]]
    if get_origin(annotation) is tuple:
        item = getattr(choices[0], '__origin__', choices[0])  # Annotated[float, ...] is a float
        return Parameter.Type[f'{_TYPES[item]}_ARRAY']
    return Parameter.Type[_TYPES[annotation]]


def ros_value(field: FieldInfo) -> Any:
    """The default of a settings field as ROS takes it."""
    default = default_of(field)
    if ros_type(field) == Parameter.Type.DOUBLE:
        return float(default)
    return list(default) if isinstance(default, tuple) else default


def _range(field: FieldInfo, kind: type, number: type, low: float, high: float) -> list[Any]:
    bounds = {type(each): each for each in field.metadata}
    if not bounds.keys() & {Ge, Gt, Le, Lt}:
        return []
    # ROS knows no open ends: the settings refuse the end itself when the node is configured
    low = bounds[Ge].ge if Ge in bounds else bounds[Gt].gt if Gt in bounds else low
    high = bounds[Le].le if Le in bounds else bounds[Lt].lt if Lt in bounds else high
    return [kind(from_value=number(low), to_value=number(high), step=number(0))]


def _reason(name: str, kind: Parameter.Type, error: Exception) -> str:
    reason = f'parameter {name!r}: {str(error).removesuffix(f": {name}")}'
    if isinstance(error, InvalidParameterTypeException) and kind.name.startswith('DOUBLE'):
        return f'{reason}; ROS takes no integer where a double is expected: write 1.0, not 1'
    return reason


def is_live(field: FieldInfo) -> bool:
    """Whether a settings field is marked as one that a running node takes over."""
    return isinstance(field.json_schema_extra, dict) and bool(field.json_schema_extra.get('live'))


@contextmanager
def live_parameters(node: Node, settings: Settings,
                    renew: Callable[[Any], Callable[[], None]]) -> Iterator[None]:
    """While it lasts, hand changes of the live fields of `settings` to `renew`.

    renew: gets the settings as they would be, loads and checks what they name, changes nothing,
    and returns what puts it to use. Whatever it raises refuses the change, with the reason; the
    parameters that are set together are refused together. All runs on the node's own thread,
    between two messages.
    """
    live = _Live(node, settings, renew)
    node.add_on_set_parameters_callback(live.check)
    node.add_post_set_parameters_callback(live.apply)
    try:
        yield
    finally:
        node.remove_on_set_parameters_callback(live.check)
        node.remove_post_set_parameters_callback(live.apply)


class _Live:
    def __init__(self, node: Node, settings: Settings,
                 renew: Callable[[Any], Callable[[], None]]) -> None:
        self._logger, self._settings, self._renew = node.get_logger(), settings, renew
        self._source = f'parameters of {node.get_name()}'
        self._ready: tuple[Settings, Callable[[], None]] | None = None

    def check(self, parameters: list[Parameter]) -> SetParametersResult:
        """Prepare what is to be changed."""
        self._ready = None
        fields = type(self._settings).model_fields
        changed = {each.name: each.value for each in parameters
                   if each.name in fields and is_live(fields[each.name])}
        if not changed:
            return SetParametersResult(successful=True)
        try:
            settings = self._settings.make(self._settings.model_dump() | changed, self._source)
            self._ready = settings, self._renew(settings)
        except PmclError as error:
            self._logger.error(f'{" and ".join(changed)} not changed: {error}')
            return SetParametersResult(successful=False, reason=str(error))
        except Exception as error:
            self._logger.error(f'{" and ".join(changed)} not changed: unexpected error\n'
                               f'{traceback.format_exc()}')
            return SetParametersResult(successful=False,
                                       reason=f'{type(error).__name__}: {error}')
        return SetParametersResult(successful=True)

    def apply(self, _: list[Parameter]) -> None:
        """Put to use what was prepared."""
        ready, self._ready = self._ready, None
        if ready is not None:
            self._settings = ready[0]
            ready[1]()
