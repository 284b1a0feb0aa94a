"""Packages that are installed on request: those of the extras in pyproject.toml."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from gantrysim.base.errors import InputError, text_of


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
