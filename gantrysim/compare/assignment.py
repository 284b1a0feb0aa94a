"""Which columns of a log are which quantities, as a user assigns them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gantrysim.base.errors import InputError, expanded, positive
from gantrysim.base.toml_files import read_toml
from gantrysim.tables.source import Source


@dataclass(frozen=True)
class Assignment:
    """Which columns of a log are which quantities.

    Attributes:
        columns: by quantity: time; x, y, z of the nozzle; commanded.AXIS and encoder.AXIS.
        period: of the samples, for a log without time [s].
        blocks: columns of a TABLE dump, one block after the other.
    """

    columns: Mapping[str, Source]
    period: float | None = None
    blocks: int = 0

    @classmethod
    def parse(cls, text: str) -> Assignment:
        """Return the mapping of a text "time=t,x=px*0.001,y=py[um]", or of a TOML file with a table [columns].

        Raises:
            InputError: no such file, or a text that is none.
        """
        if "=" not in text:
            content = read_toml(expanded(text), f"--columns {text}")
            table = content.pop("columns", None)
            if not isinstance(table, dict) or not content.keys() <= {"period", "blocks"}:
                raise InputError(f"--columns {text}: must have a table [columns], and may have period and blocks")
            period = content.get("period")
            blocks = content.get("blocks", 0)
            if not isinstance(blocks, int):
                raise InputError(f"--columns {text}: blocks = {blocks!r}: must be a whole number")
            given = None if period is None else positive("period", period, "s")
            columns = {key: Source.parse(f"--columns {key}", str(value)) for key, value in table.items()}
            return cls(columns, given, blocks)
        pairs = [part.partition("=") for part in text.split(",")]
        return cls({key.strip(): Source.parse(f"--columns {key}", value) for key, _, value in pairs})
