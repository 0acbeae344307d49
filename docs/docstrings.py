"""An extension of mkdocstrings: lines `name: what it is` of docstrings become lists."""

import re

import griffe

_FIELD = re.compile(r'^((?:[a-z_]+, )*[a-z_]+): ', re.MULTILINE)


class Fields(griffe.Extension):
    """Rewrites docstrings when they are loaded."""

    def on_object(self, *, obj: griffe.Object, **_: object) -> None:
        """Put each field and `Raises ...` in a paragraph of its own, fields as list items."""
        if obj.docstring is not None:
            text = _FIELD.sub(r'\n- `\1`: ', obj.docstring.value)
            obj.docstring.value = re.sub(r'\n(?=Raises )', '\n\n', text)
