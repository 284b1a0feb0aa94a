"""Parsing with the tables of a lark parser: the same values as from its own loop, in a part of the time.

Lark tries the keywords that a state accepts one after the other, makes a token of every bracket and comma, and compares
rules symbol by symbol. Here a word is looked up, a token that no rule keeps is not made, and a state holds what follows
it. A text that is not read to its end is read once more by lark, which then states the error.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from lark import Lark, Token
from lark.grammar import Rule, Terminal
from lark.lexer import PatternRE, PatternStr, TerminalDef
from lark.parse_tree_builder import ExpandSingleChild

END = "$END"  # lark's terminal behind the text

Match = Callable[[str, int], "re.Match[str] | None"]
Build = Callable[[list[Any]], Any]


class Reduction:
    """The end of a rule.

    Attributes:
        count: number of the rule's symbols.
        rule: its name.
        build: returns its value, given those of its symbols.
        passes_on: whether its value is that of its only symbol.
    """

    __slots__ = ("build", "count", "passes_on", "rule")

    def __init__(self, count: int, rule: str, build: Build) -> None:
        self.count = count
        self.rule = rule
        self.passes_on = count == 1 and isinstance(build, ExpandSingleChild)
        self.build = build


class State:
    """A state of the parser.

    Attributes:
        actions: by the name of the terminal that follows: the next state, or the rule that ends before it.
        successors: next state by the name of a rule that has ended.
        match: matches a terminal that is accepted, or ignored, as the group of its name; None until it is needed.
        keywords: by the name of a terminal that matches words: the keywords that are accepted, by their capitals.
    """

    __slots__ = ("actions", "keywords", "match", "successors")

    def __init__(self) -> None:
        self.actions: dict[str, State | Reduction] = {}
        self.successors: dict[str, State] = {}
        self.match: Match | None = None
        self.keywords: dict[str, dict[str, str]] = {}


class _StuckError(Exception):
    """The text goes on with what the tables do not accept, or not in this way."""


class TableParser:
    """Parses texts as a lark parser does.

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
            if isinstance(symbol, Terminal) and not (symbol.filter_out and _drops(lark, rule))
        )
        automaton = lark.parser.parser.parser
        builds = automaton.callbacks
        reductions = {rule: Reduction(len(rule.expansion), str(rule.origin.name), builds[rule]) for rule in builds}
        table = automaton.parse_table
        states = {number: State() for number in table.states}
        for number, state in states.items():
            for symbol, (action, target) in table.states[number].items():
                name = str(symbol)  # lark's own are tokens, which compare slowly
                if action.name == "Reduce":
                    state.actions[name] = reductions[target]
                elif name in self._terminals:
                    state.actions[name] = states[target]
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
        end = self._end
        length = len(text)
        state = self._start
        states = [state]
        values: list[Any] = []
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
                if name in state.keywords:
                    name = _word(state.keywords[name], spelled, name)
                action = state.actions.get(name)
                while isinstance(action, Reduction):
                    if action.count == 1:
                        if not action.passes_on:
                            values[-1] = action.build(values[-1:])
                        state = states[-2].successors[action.rule]
                        states[-1] = state
                    else:
                        first = len(values) - action.count
                        values[first:] = [action.build(values[first:])]
                        state = states[first].successors[action.rule]
                        states[first + 1 :] = [state]  # one for every value, after the start
                    action = state.actions.get(name)
                if isinstance(action, State):
                    state = action
                    states.append(state)
                    values.append(_token(name, spelled, line) if name in valued else None)
                elif state is not end:
                    raise _StuckError
            if "\n" in spelled:
                line += spelled.count("\n")
        return values[-1]

    def _prepared(self, state: State) -> Match:
        """Return what matches the terminals that a state accepts, in the order in which lark tries them."""
        accepted = [self._terminals[name] for name in {*state.actions, *self._ignored} - {END}]
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


def _drops(lark: Lark, rule: Rule) -> bool:
    """Whether a rule's value needs none of the tokens that have no name, not even for its place in the text."""
    return not (rule.options.keep_all_tokens or lark.options.propagate_positions)


def _order(terminal: TerminalDef) -> tuple[int, int, int, str]:
    return -terminal.priority, -terminal.pattern.max_width, -len(terminal.pattern.value), terminal.name


def _matches(terminal: TerminalDef, text: TerminalDef) -> bool:
    return re.fullmatch(terminal.pattern.to_regexp(), text.pattern.value) is not None


def _word(keywords: dict[str, str], spelled: str, name: str) -> str:
    """Return the keyword that a word is, else the name of what matches words."""
    if not spelled.isascii():  # its capitals may be another word than lark sees in it
        raise _StuckError
    return keywords.get(spelled.upper(), name)


def _token(name: str, spelled: str, line: int) -> Token:
    """Return a token that states its line, and no columns; lark's own constructor takes longer than a rule."""
    token = str.__new__(Token, spelled)
    token.type = name
    token.value = spelled
    token.line = line
    token.end_line = line
    token.column = None
    token.end_column = None
    token.start_pos = None
    token.end_pos = None
    return token
