"""Message classes by their names."""

from importlib import import_module

from pmcl_ros.runtime.errors import BagError


def message_type(name: str) -> type:
    """The class of `PACKAGE/msg/KIND`; BagError when it is not installed."""
    package, _, kind = name.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), kind)
    except (ImportError, AttributeError):
        raise BagError(f'message type {name} is not installed') from None
