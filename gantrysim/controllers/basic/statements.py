"""Statements by name: each is one function, with its syntax at its head, from which the grammar is completed."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Generic, TypeVar

PREFIX = "cmd_"  # of the functions

_TERMINAL = re.compile(r'"[^"]*"|\b_?[A-Z][A-Z0-9_]*\b')
_DEFINED = re.compile(r"^(_?[A-Z][A-Z0-9_]*)(?:\.\d+)?:", re.MULTILINE)
_FIRST_WORDS = re.compile(r'\(([^)]*)\)|("[^"]*"|\w+)')

Handler = TypeVar("Handler", bound=Callable[..., object])


class Statements(Generic[Handler]):
    """The statements of a dialect, or some of them.

    A statement is a function `cmd_NAME`, marked with its syntax in the notation of lark. The syntax is an alternative
    of a rule of the grammar, and makes a node called NAME, which the function handles. Words in capitals of which the
    grammar has no definition are keywords: `SLEEP`, or `_SLEEP` for one that makes no child of the node.
    """

    def __init__(self) -> None:
        self.handlers: dict[str, Handler] = {}
        self._syntax: dict[str, str] = {}

    @classmethod
    def of(cls, *tables: Statements[Handler]) -> Statements[Handler]:
        """Return the statements of several tables."""
        union = cls()
        for table in tables:
            union.handlers |= table.handlers
            union._syntax |= table._syntax
        return union

    def __call__(self, syntax: str) -> Callable[[Handler], Handler]:
        """Return a decorator that enters a function with its syntax."""

        def enter(handler: Handler) -> Handler:
            name = handler.__name__.removeprefix(PREFIX)
            self.handlers[name] = handler
            self._syntax[name] = syntax
            return handler

        return enter

    @property
    def rule(self) -> str:
        """The alternatives of the grammar."""
        return "\n    | ".join(f"{syntax} -> {name}" for name, syntax in self._syntax.items())

    @property
    def first_words(self) -> set[str]:
        """Keywords that statements begin with, in small letters."""
        words = set()
        for syntax in self._syntax.values():
            first = _FIRST_WORDS.match(syntax)
            for word in re.findall(r"\b_?[A-Z][A-Z0-9_]*\b", first[0]) if first else ():
                words.add(word.strip("_").split("_")[0].lower())
        return words


def with_keywords(grammar: str) -> str:
    """Return a grammar with a definition of every keyword in it that has none, in capitals or small letters."""
    rules = re.sub(r"//[^\n]*|/(?:\\.|[^/\n])+/", "", grammar)
    defined = set(_DEFINED.findall(grammar))
    words = {word for word in _TERMINAL.findall(rules) if not word.startswith('"')}
    keywords = sorted(words - defined)
    return grammar + "".join(f'{word}: "{word.strip("_").lower()}"i\n' for word in keywords)
