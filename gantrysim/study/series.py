"""Columns of a study's rows as arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.study.cases import OK, Row, Value


def series(rows: Sequence[Row], *columns: str, **tags: Value) -> tuple[Floats, ...]:
    """Return columns of the rows with all these tags, sorted by the first column, each (m,).

    Rows without values in one of the columns are left out.
    """
    chosen = []
    for row in rows:
        tagged = all(row.get(tag) == value for tag, value in tags.items())
        if row["status"] == OK and tagged and all(row.get(column) is not None for column in columns):
            chosen.append([row[column] for column in columns])
    values = np.array(chosen, float).reshape(-1, len(columns))
    return tuple(values[np.argsort(values[:, 0], kind="stable")].T)
