"""Data frames of pandas, which is installed on request."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gantrysim.base.extras import extra

if TYPE_CHECKING:
    import pandas


def pandas_frame(method: str, columns: Mapping[str, Any], index: Sequence[str] | None = None) -> pandas.DataFrame:
    """Return columns as a pandas DataFrame.

    Args:
        method: that was called, named in the error.
        columns: by name, each (n,).
        index: names of the rows; None for their numbers.

    Raises:
        InputError: pandas is not installed.
    """
    with extra("tables", method):
        import pandas
    return pandas.DataFrame(dict(columns), index=index)
