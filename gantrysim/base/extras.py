"""Packages that are installed on request, those of the extras in pyproject.toml; versions that a run depends on."""

from __future__ import annotations

import platform
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from gantrysim.base.errors import InputError, text_of

if TYPE_CHECKING:
    import pandas


class MissingPackageError(InputError, ImportError):
    """A package that an extra installs is not there, or cannot be imported."""


@contextmanager
def extra(name: str, purpose: str, alternative: str = "") -> Iterator[None]:
    """Import packages of an extra inside the block.

    Args:
        name: of the extra that installs them, such as "drawings".
        purpose: what needs the package, which begins the message.
        alternative: what works without the package, which ends the message.

    Raises:
        MissingPackageError: one of the packages cannot be imported.
    """
    try:
        yield
    except ImportError as error:
        # a package that lies there but is broken raises a plain ImportError, whose text says why
        is_missing = isinstance(error, ModuleNotFoundError) and error.name
        package = str(error.name).partition(".")[0]
        reason = f"{package} is not installed" if is_missing else text_of(error)
        install = f'pip install "gantrysim[{name}]"'
        raise MissingPackageError(f"{purpose}: {reason}: {install}{alternative and f', {alternative}'}") from None


# Data frames of pandas, which is installed on request.


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


def package_versions() -> dict[str, str]:
    """Return the versions of the packages that the numbers of a run depend on, and that of Python, by name."""
    packages = {name: version(name) for name in ("gantrysim", "mujoco", "numpy", "numba", "scipy")}
    return {**packages, "python": platform.python_version()}
