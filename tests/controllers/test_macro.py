"""The core of macro languages: its words are data of a dialect, its flow that of any lines with labels."""

import math
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.fanuc.sequence import GRAMMAR as FANUC
from gantrysim.controllers.gcode.lines import GRAMMAR as LINUXCNC
from gantrysim.controllers.macro import order
from gantrysim.controllers.macro.order import END, Flow, Places
from gantrysim.controllers.macro.scanner import OPERATORS, BinaryOperator, Grammar, Scanner
from gantrysim.controllers.macro.variables import Numbering, Parameters


def parameters(local=3, highest=9):
    return Parameters(lambda key: 42.0 if key in (7, "_answer") else None, Numbering(local, highest))


def value(text, grammar, store=None):
    scanner = Scanner(text, grammar)
    result = scanner.value("X")(store or parameters())
    assert scanner.remaining == ""
    return result


def test_operators_and_functions_are_spelled_as_the_dialect_says():
    grammar = Grammar(
        operators={"PLUS": OPERATORS["+"], "TIMES": OPERATORS["*"], "CUT": BinaryOperator(9, lambda a, b: min(a, b))},
        functions={"HALF": lambda x: x / 2},
        arc_tangent="ANGLE",
        existence="KNOWN",
    )
    assert value("[1PLUS2TIMES9CUT4]", grammar) == 9  # the strongest first: 1 + 2 min(9, 4)
    assert value("HALF[ANGLE[1]/[1]PLUSKNOWN[#10]]", grammar) == pytest.approx(22.5)
    with pytest.raises(InputError, match="must be an operator or ]"):
        value("[1+2]", grammar)
    with pytest.raises(InputError, match="must be followed by a number"):
        value("SIN[1]", grammar)


@given(st.floats(-1e6, 1e6))
def test_dialects_differ_in_how_fix_and_fup_round(x):
    text = f"{x:.6f}"
    number = float(text)
    assert value(f"FIX[{text}]", LINUXCNC) == math.floor(number)
    assert value(f"FUP[{text}]", LINUXCNC) == math.ceil(number)
    assert value(f"FIX[{text}]", FANUC) == math.trunc(number)
    assert value(f"FUP[{text}]", FANUC) == math.trunc(number) + (0 if number.is_integer() else math.copysign(1, number))
    assert value(f"ROUND[{text}]", LINUXCNC) == value(f"ROUND[{text}]", FANUC)


@given(st.integers(-99, 99), st.integers(-99, 99).filter(bool))
def test_a_modulus_is_never_negative(a, b):
    assert value(f"[{a}MOD{b}]", LINUXCNC) == a % abs(b)


def test_parameters_are_local_common_or_the_controller_s():
    store = parameters()
    outer = store.scope
    for target in (lambda _: 3.0, lambda _: 4.0, "name", "_name"):
        store.set(target, 5.0)
    store.scope = type(outer)()
    assert [store.numbered(k) for k in (3, 4, 7)] == [0, 5, 42]
    assert [store.exists(key) for key in ("name", "_name", "_answer", 9, 10)] == [False, True, True, True, False]
    assert [store.vacant(k) for k in (3, 4, 7)] == [True, False, False]
    store.scope = outer
    assert (store.numbered(3), store.named("name"), store.named("_name")) == (5, 5, 5)


MARKS = st.lists(st.tuples(st.sampled_from("ab"), st.sampled_from(["DO", "END", "IF"])), max_size=30)


@given(MARKS, st.sampled_from("abc"), st.sets(st.sampled_from(["DO", "END", "IF"])), st.integers(-1, 31))
def test_places_are_those_that_a_search_of_all_lines_finds(marks, label, words, place):
    places = Places()
    for k, (marked, word) in enumerate(marks):
        places.mark(marked, word, k)
    hits = [k for k, (marked, word) in enumerate(marks) if marked == label and word in words]
    assert places.next(label, tuple(words), place) == min((k for k in hits if k > place), default=None)
    assert places.last(label, tuple(words), place) == max((k for k in hits if k < place), default=None)
    assert set(places.labels("DO")) == {marked for marked, word in marks if word == "DO"}


class Listing(Flow):
    """Lines of a word and a number: `go`, `call`, `again`, `leave`, `while` an entry of a list, `end`, or a letter."""

    def __init__(self, text, conditions=(), steps=100):
        super().__init__(parameters(), steps, "lines")
        self._lines = [line.split() for line in text.splitlines()]
        self._conditions = iter(conditions)
        for place, (word, number) in enumerate(self._lines):
            self.places.mark(number, word, place)

    def runs(self, place):
        return place < len(self._lines)

    def refusal(self, fault, detail):
        return InputError(f"{fault.name}: {detail}")

    def unmatched(self, label, words, ahead):
        return InputError(f"{words} of {label} {'ahead' if ahead else 'behind'}")

    def execute(self):
        word, number = self._lines[self.place]
        if word == "go":
            return int(number), None
        if word == "call":
            self.check_depth()
            return self.enter(int(number), times=2), None
        if word == "again":
            return self.end_repetition(), None
        if word == "while":
            return self.enter_loop(next(self._conditions), number, "end"), None
        if word == "end":
            return self.behind(number, ("while",)), None
        return (END if word == "stop" else self.following), word


def test_a_subprogram_is_repeated_and_returns_behind_its_call():
    flow = Listing("a 0\ncall 4\nb 0\nstop 0\nc 0\nagain 0")
    assert list(flow.run()) == ["a", "c", "c", "b", "stop"]
    assert flow.depth == 0


def test_a_loop_runs_while_its_condition_holds():
    assert list(Listing("while 1\na 0\nwhile 2\nb 0\nend 2\nend 1\nc 0", [1, 1, 0, 1, 0, 0]).run()) == [*"abac"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("go 0", "STEPS: 100 lines have run: must end before; is there an endless loop"),
        ("call 0", "DEPTH: calls nested deeper than 10 levels"),
        ("while 1\na 0\nend 2", r"\('end',\) of 1 ahead"),
        ("end 2\nwhile 2", r"\('while',\) of 2 behind"),
    ],
)
def test_what_has_no_order_is_refused(text, message):
    with pytest.raises(InputError, match=message):
        list(Listing(text, [False]).run())


def test_lines_without_a_motion_have_a_limit_of_time(monkeypatch):
    """A clock that advances by 1 s a step: the limit counts from the last motion on."""
    clock = count()
    monkeypatch.setattr(order, "_LOOKS", 1)
    monkeypatch.setattr(order.time, "thread_time", lambda: float(next(clock)))
    assert len(list(Listing("a 0\n" * 90).run())) == 90
    with pytest.raises(InputError, match="STEPS: lines have run for 5 s without a motion: is there an endless loop"):
        list(Listing("a 0\na 0\ngo 2").run())
