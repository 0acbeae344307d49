"""Live parameters: a running node checks a new value, then uses it or refuses it."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from pydantic.fields import FieldInfo
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from pmcl_ros.runtime.errors import PmclError
from pmcl_ros.runtime.settings import Settings


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
