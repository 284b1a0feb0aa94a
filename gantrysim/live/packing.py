"""Content of a viewer as one binary message: a header in JSON, then the columns' bytes; unchanged parts are left out.

    length of the header (4 bytes, little-endian) | header in JSON, UTF-8 | bytes of the columns

The header holds "fields", values of the viewer's content by name; "columns", each as `gantrysim.report.encoding`
describes it, with [offset, length] of its bytes in place of base64; and "same", names of fields and columns that are
those of the message before.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

_BYTES = ("data", "jumps")  # of a column


class Column(NamedTuple):
    """A column: what describes it in JSON, and its bytes by name."""

    description: str
    content: dict[str, bytes]


class Parts(NamedTuple):
    """The parts of a viewer's content: fields in JSON, and columns, by name."""

    fields: dict[str, str]
    columns: dict[str, Column]

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> Parts:
        """Return the parts of a viewer's content, as of `gantrysim.report.viewer_data.ViewerData.content`."""
        fields = {name: _json(value) for name, value in content.items() if name != "columns"}
        return cls(fields, {name: _column(column) for name, column in content["columns"].items()})


NOTHING = Parts({}, {})


def message(head: Mapping[str, Any], parts: Parts, before: Parts = NOTHING) -> bytes:
    """Return the binary message of a viewer's content.

    Args:
        head: further values of the header.
        parts: of the content.
        before: those that the receiver has.
    """
    same = [name for name, text in parts.fields.items() if before.fields.get(name) == text]
    same_columns = [name for name, column in parts.columns.items() if before.columns.get(name) == column]
    fields = {name: json.loads(text) for name, text in parts.fields.items() if name not in same}
    columns: dict[str, dict[str, Any]] = {}
    body = bytearray()
    for name, column in parts.columns.items():
        if name in same_columns:
            continue
        columns[name] = json.loads(column.description)
        for key, content in column.content.items():
            columns[name][key] = [len(body), len(content)]
            body += content
    header = {**head, "fields": fields, "columns": columns, "same": {"fields": same, "columns": same_columns}}
    text = _json(header).encode()
    return len(text).to_bytes(4, "little") + text + bytes(body)


def _column(column: Mapping[str, Any]) -> Column:
    description = {key: value for key, value in column.items() if key not in _BYTES}
    return Column(_json(description), {key: base64.b64decode(column[key]) for key in _BYTES if key in column})


def _json(value: Any) -> str:
    return json.dumps(value, allow_nan=False, separators=(",", ":"))
