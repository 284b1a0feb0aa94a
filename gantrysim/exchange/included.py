"""Configurations whose files include others."""

from __future__ import annotations

from pathlib import Path

from gantrysim.base.errors import InputError
from gantrysim.base.input_files import read_text

# of one configuration; those of real machines have a tenth of these
_NESTED_INCLUSIONS = 16  # inclusions within one another
_FILES = 200
_LENGTH = 1 << 24  # of all files together [characters]


class IncludedFiles:
    """The files of one configuration, bounded in number, depth and length.

    Args:
        word: with which a file includes another, for errors.
    """

    def __init__(self, word: str) -> None:
        self._word = word
        self._files = 0
        self._length = 0

    def text(self, path: Path, depth: int) -> str:
        """Return the text of a file that is included at a depth.

        Raises:
            InputError: a file that cannot be read, or more files than a configuration has.
        """
        self._files += 1
        if depth > _NESTED_INCLUSIONS:
            raise InputError(
                f"{path}: {self._word} is nested more than {_NESTED_INCLUSIONS} deep: does a file include itself?"
            )
        if self._files > _FILES:
            raise InputError(f"{path}: {self._word} names more than {_FILES} files in all: are some named repeatedly?")
        try:
            text = read_text(path, errors="replace")
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror}") from None
        self._length += len(text)
        if self._length > _LENGTH:
            raise InputError(f"{path}: with the files before it has more than {_LENGTH:.3g} characters")
        return text
