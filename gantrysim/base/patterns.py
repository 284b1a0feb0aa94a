"""Regular expressions that several readers of text share."""

from __future__ import annotations

NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"  # decimal
