"""Parsing with the tables of a lark parser: the same values as from its own loop, in a part of the time.

Lark tries the keywords that a state accepts one after the other, makes a token of every bracket and comma and a tree of
every part of a list, and compares rules symbol by symbol. Here a word is looked up, nothing is made that no rule keeps,
and a state holds what follows it. A text that is not read to its end is read once more by lark, which then states the
error.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from lark import Lark, Token, Tree
from lark.grammar import Rule, Terminal
from lark.lexer import PatternRE, PatternStr, TerminalDef

END = "$END"  # lark's terminal behind the text
_NONE = -1  # place of a part that the text may have, and that a rule is without

Match = Callable[[str, int], "re.Match[str] | None"]
Build = Callable[[list[Any]], Any]


class Reduction:
    """The end of a rule.

    Args:
        rule: the rule.
        make: returns its value, given those of its symbols that it keeps.

    Attributes:
        count: number of the rule's symbols.
        rule: its name.
        passes_on: whether its value is that of its only symbol.
        build: returns its value, given those of all its symbols.
    """

    __slots__ = ("_gives_way", "_kept", "_make", "build", "count", "passes_on", "rule")

    def __init__(self, rule: Rule, make: Build) -> None:
        self.count = len(rule.expansion)
        self.rule = str(rule.origin.name)
        self._make = make
        self._kept = tuple(_kept(rule))
        self._gives_way = bool(rule.options.expand1 and not rule.alias)
        keeps_all = self._kept == tuple((place, False) for place in range(self.count))
        self.passes_on = self._gives_way and self.count == 1 and keeps_all
        self.build: Build = make if keeps_all else self._build

    def _build(self, values: list[Any]) -> Any:
        parts: list[Any] = []
        for place, is_list in self._kept:
            if place == _NONE:
                parts.append(None)
            elif not is_list:
                parts.append(values[place])
            elif parts:
                parts += values[place]
            else:  # no copy: a list grows by a part at a time
                parts = values[place]
        if self._gives_way and len(parts) == 1:
            return parts[0]
        return self._make(parts)


class State:
    """A state of the parser.

    Attributes:
        reductions: by the name of the terminal that follows: the rule that ends before it.
        successors: next state by the name of a terminal, or of a rule that has ended.
        match: matches a terminal that is accepted, or ignored, as the group of its name; None until it is needed.
        keywords: by the name of a terminal that matches words: the keywords that are accepted, by their capitals.
    """

    __slots__ = ("keywords", "match", "reductions", "successors")

    def __init__(self) -> None:
        self.reductions: dict[str, Reduction] = {}
        self.successors: dict[str, State] = {}
        self.match: Match | None = None
        self.keywords: dict[str, dict[str, str]] = {}


class _StuckError(Exception):
    """The text goes on with what the tables do not accept, or not in this way."""


class TableParser:
    """Parses texts as a lark parser does; of the places of its tokens and trees it states the line alone.

    Args:
        lark: a parser of kind LALR with a contextual lexer, whose keywords have no case.
    """

    def __init__(self, lark: Lark) -> None:
        self._lark = lark
        self._terminals = {terminal.name: terminal for terminal in lark.terminals}
        self._ignored = frozenset(lark.ignore_tokens)
        self._valued = frozenset(
            symbol.name
            for rule in lark.rules
            for symbol in rule.expansion
            if isinstance(symbol, Terminal) and not _drops(rule, symbol)
        )
        self._places_trees = bool(lark.options.propagate_positions)
        table = lark.parser.parser.parser.parse_table
        reductions = {rule: Reduction(rule, _builder(lark, rule)) for rule in lark.rules}
        states = {number: State() for number in table.states}
        for number, state in states.items():
            for symbol, (action, target) in table.states[number].items():
                name = str(symbol)  # lark's own are tokens, which compare slowly
                if action.name == "Reduce":
                    state.reductions[name] = reductions[target]
                else:
                    state.successors[name] = states[target]
        self._start = states[table.start_states["start"]]
        self._end = states[table.end_states["start"]]

    def parse(self, text: str, restart: Callable[[], None] = lambda: None) -> Any:
        """Return the value of a text.

        Args:
            text: the text.
            restart: is called before lark reads a text of which a part has been read.

        Raises:
            lark.exceptions.UnexpectedInput: the text breaks the grammar.
        """
        try:
            return self._parse(text)
        except _StuckError:
            restart()
            return self._lark.parse(text)

    def _parse(self, text: str) -> Any:
        ignored = self._ignored
        valued = self._valued
        places_trees = self._places_trees
        end = self._end
        length = len(text)
        state = self._start
        states = [state]
        values: list[Any] = []
        lines: list[int] = []  # of the first token of every value, 0 for a value without one
        place = 0
        line = 1
        while state is not end:
            if place < length:
                lexeme = (state.match or self._prepared(state))(text, place)
                if lexeme is None:
                    raise _StuckError
                name = lexeme.lastgroup or ""
                spelled = lexeme[0]
                place += len(spelled)
            else:
                name = END
                spelled = ""
            if name not in ignored:
                words = state.keywords.get(name)
                if words is not None:
                    if not spelled.isascii():  # its capitals may be another word than lark sees in it
                        raise _StuckError
                    name = words.get(spelled.upper(), name)
                reduction = state.reductions.get(name)
                while reduction is not None:
                    if reduction.passes_on:
                        state = states[-2].successors[reduction.rule]
                        states[-1] = state
                    else:
                        first = len(values) - reduction.count
                        value = reduction.build(values[first:])
                        values[first:] = [value]
                        state = states[first].successors[reduction.rule]
                        states[first + 1 :] = [state]  # one for every value, after the start
                        if places_trees:
                            lines[first:] = [_line_of(value, lines[first:])]
                    reduction = state.reductions.get(name)
                successor = state.successors.get(name)
                if successor is not None:
                    state = successor
                    states.append(state)
                    values.append(_token(name, spelled, line) if name in valued else None)
                    if places_trees:
                        lines.append(line)
                elif state is not end:
                    raise _StuckError
            if "\n" in spelled:
                line += spelled.count("\n")
        return values[-1]

    def _prepared(self, state: State) -> Match:
        """Return what matches the terminals that a state accepts, in the order in which lark tries them."""
        names = {*state.reductions, *state.successors, *self._ignored}
        accepted = [self._terminals[name] for name in self._terminals.keys() & names]
        accepted.sort(key=_order)
        texts = [terminal for terminal in accepted if isinstance(terminal.pattern, PatternStr)]
        looked_up = set()
        for terminal in accepted:
            if isinstance(terminal.pattern, PatternRE):
                words = [text for text in texts if text.priority == terminal.priority and _matches(terminal, text)]
                looked_up |= {word.name for word in words}
                if words:
                    state.keywords[terminal.name] = {word.pattern.value.upper(): word.name for word in words}
        parts = [f"(?P<{part.name}>{part.pattern.to_regexp()})" for part in accepted if part.name not in looked_up]
        state.match = re.compile("|".join(parts)).match
        return state.match


def _drops(rule: Rule, symbol: Any) -> bool:
    """Whether a rule's value has no place for a symbol: a terminal that has no name."""
    return symbol.is_term and symbol.filter_out and not rule.options.keep_all_tokens


def _kept(rule: Rule) -> Iterator[tuple[int, bool]]:
    """Yield the places of the symbols that a rule keeps, and whether the value of each is a list of parts."""
    place = 0
    for is_missing in rule.options.empty_indices or (False,) * len(rule.expansion):
        if is_missing:
            yield _NONE, False
            continue
        symbol = rule.expansion[place]
        if not _drops(rule, symbol):
            yield place, _is_list(symbol)
        place += 1


def _is_list(symbol: Any) -> bool:
    """Whether lark puts the parts of a symbol's value in the place of the value."""
    return not symbol.is_term and symbol.name.startswith("_")


def _builder(lark: Lark, rule: Rule) -> Build:
    """Return what makes a rule's value of its parts: a function of the parser's transformer, or else a tree."""
    if _is_list(rule.origin):
        return _itself
    name = str(rule.alias or rule.origin.name)
    builder: Build = getattr(lark.options.transformer, name, None) or partial(Tree, name)
    return builder


def _itself(parts: list[Any]) -> list[Any]:
    return parts


def _order(terminal: TerminalDef) -> tuple[int, int, int, str]:
    return -terminal.priority, -terminal.pattern.max_width, -len(terminal.pattern.value), terminal.name


def _matches(terminal: TerminalDef, text: TerminalDef) -> bool:
    return re.fullmatch(terminal.pattern.to_regexp(), text.pattern.value) is not None


def _token(name: str, spelled: str, line: int) -> Token:
    """Return a token that states its line, and no other place; lark's own constructor takes longer than a rule."""
    token = str.__new__(Token, spelled)
    token.type = name
    token.value = spelled
    token.line = line
    return token


def _line_of(value: Any, lines: list[int]) -> int:
    """Return the line of the first token of a rule, 0 without one, given those of its symbols; enter it into a tree."""
    if isinstance(value, Token):  # the only part of a rule that gives way to it
        return int(value.line or 0)
    line = next(filter(None, lines), 0)
    if line and isinstance(value, Tree) and value.meta.empty:
        value.meta.line = line
        value.meta.empty = False
    return line
