"""Mutated programs: nothing but InputError comes out, in one line, and every run is bounded."""

import random
import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import Basic
from gantrysim.controllers.trio.basic.expressions import known_words
from gantrysim.job.job import Job

from support.soaked import examples, suite_runs

PAGE = (Path(__file__).parent.parent.parent / "docs" / "trio-basic.md").read_text(encoding="utf-8")
WORDS = """
BASE(0,1): SPEED=200: ACCEL=5000: MERGE=ON: DEFPOS(1,2)
TABLE(0, 0, 1, 4, 9): FOR k=4 TO 9 STEP 1: TABLE(k, k*k): NEXT k
CAM(0, 5, 0.1, 10): WAIT LOADED: CAMBOX(0, 5, 0.1, 10, 3, 4): CANCEL(2)
BASE(0): MOVELINK(3, 5, 1, 1, 3, 2, 1): MOVE(7) AXIS(3): WAIT IDLE AXIS(3): CANCEL
BASE(0,1,2): MHELICAL(0,0,3,0,1,2,0): WAIT UNTIL MTYPE=0 AND NTYPE=0
ADDAX(3): FORWARD AXIS(3): WA(5): ADDAX(-1): RAPIDSTOP
ON 2 GOSUB show, show: OP(8, ON): VR(3)=IN(2)+READ_OP(8): TICKS=5
IF VR(3)=1 THEN PRINT#6, "one";VR(3)[4,1] ELSE PRINT CHR(65), $FF
RUN "other", 4
REPEAT: WA(1): UNTIL TICKS<0 OR NOT (SQR(4)=2)
STOP "other": STOP
show: MOVEABS(1,-1): RETURN
'$PROGRAM other
WHILE TRUE: VR(1)=VR(1)^2-3*(-VR(1)+2) MOD 7: WA(2): WEND
HALT
"""
PROGRAMS = (re.search(r"```basic\n(.*?)```", PAGE, flags=re.DOTALL)[1], Job.load("trio-basic").program["text"], WORDS)
TOKEN = re.compile(r"\s+|\w+|[^\w\s]")
PIECES = [
    *known_words(),
    *"()[]+-*/^=<>:,;#$_'\"\n",
    "<>",
    "-1",
    "0",
    "1e308",
    "64",
    "0.5",
    "é",
    "x",
    "THEN\n",
    "other",
]


NUMBERS = ("0", "1", "-1", "0.5", "3", "64", "1e3", "1e308", "$FF", "TICKS", "VR(3)", "TABLE(2)")


def varied(chance):
    """A program whose syntax mostly holds: numbers replaced, lines left out, repeated and exchanged."""
    lines = chance.choice(PROGRAMS).splitlines()
    for _ in range(chance.randint(1, 3)):
        a, b = chance.randrange(len(lines)), chance.randrange(len(lines))
        match chance.randrange(5):
            case 0 if len(lines) > 1:
                del lines[a]
            case 1:
                lines.insert(a, lines[b])
            case 2:
                lines[a], lines[b] = lines[b], lines[a]
            case _:
                places = list(re.finditer(r"(?<![\w.])\d+(\.\d+)?", lines[a]))
                if places:
                    at = chance.choice(places)
                    lines[a] = lines[a][: at.start()] + chance.choice(NUMBERS) + lines[a][at.end() :]
    return "\n".join(lines)


def mutated(chance):
    if chance.random() < 0.5:
        return varied(chance)
    tokens = TOKEN.findall(chance.choice(PROGRAMS))
    for _ in range(chance.randint(1, 6)):
        at = chance.randrange(len(tokens))
        match chance.randrange(5):
            case 0:
                del tokens[at : at + chance.randint(1, 3)]
            case 1:
                tokens[at] = chance.choice(PIECES)
            case 2:
                tokens.insert(at, chance.choice(PIECES))
            case 3:
                other = chance.randrange(len(tokens))
                tokens[at], tokens[other] = tokens[other], tokens[at]
            case _:
                tokens[at:at] = tokens[at : at + chance.randint(1, 20)]
        if not tokens:
            tokens = ["\n"]
    return "".join(tokens)


def survives(text, limit=0.05):
    """Whether a text is a program that ends within a time limit; another error than InputError fails the test."""
    try:
        made = Basic(text, statement_limit=max(400, 400 * limit), time_limit=limit, unassigned_zero=len(text) % 2 == 0)
        if limit < 1:
            made.trace(0.001)
        assert made.setpoints(0.002).duration <= limit + 0.002
        assert len(made.notes) < 60
    except InputError as error:
        text = str(error)
    else:
        return True
    assert "\n" not in text
    assert len(text) < 400
    return False


def test_the_programs_are_sound():
    for text in PROGRAMS:
        assert len(Basic(text).setpoints(0.001).position) > 100
    assert not survives(PROGRAMS[0])  # it takes longer than the limit


@pytest.mark.parametrize("seed", suite_runs(range(4), 0))
def test_mutated_programs_raise_nothing_but_input_errors(seed):
    chance = random.Random(seed)
    for _ in range(150):
        survives(mutated(chance))
    assert any(survives(varied(chance), 20.0) for _ in range(8))


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(100, 110))
def test_a_hundred_thousand_mutations(seed, record_property):
    chance = random.Random(seed)
    read = sum(survives(mutated(chance), chance.choice([0.05] * 9 + [20.0])) for _ in range(10_000))
    record_property("attack", "Trio BASIC: random changes to programs")
    record_property("tries", 10_000)
    record_property("refused", 10_000 - read)


@given(st.text(max_size=80) | st.lists(st.sampled_from(PIECES), max_size=25).map(" ".join))
@examples(150)
def test_any_text_is_a_program_or_an_input_error(text):
    survives(text)


@pytest.mark.parametrize(
    "text",
    [
        "(" * 100_000,
        "x=" + "(" * 4000,
        "x=" + "-" * 4000 + "1",
        "x=" + "NOT " * 1000 + "1",
        "x=" + "1+" * 2000 + "1",
        "IF 1 THEN " * 400 + "x=1",
        "IF 1 THEN\n" * 1000,
        "WHILE 1\n" * 500 + "WEND\n" * 500,
        ":" * 4000,
        "x=" + "2^" * 1000 + "2",
        "x=" + "9" * 4000,
        "x=$" + "F" * 4000,
        "a" * 4000,
        "MOVE(" + "1," * 2000 + "1)",
        "PRINT " + "1;" * 2000,
        "x=2: WHILE 1: x=x: MOVE(x): WEND",
        "WHILE 1: PRINT 1: WEND",
        "TABLE(511000" + ",1" * 1000 + ")",
        "\n" * 100_000,
    ],
    ids=lambda text: text[:12],
)
def test_excess_is_bounded(text):
    survives(text)


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("x=1\n" + "'" * 4097, r"line 2: 4097 characters: must have at most 4096"),
        ("'" * 4000 + "\n" + ("x=1\n" * 250_000), r"program of 1004001 characters: must have at most 1000000"),
        ("\n" + "a" * 65 + "=1", r"line 2: word of 65 characters: must have at most 64"),
        ("'$PROGRAM a\n" * 65, r"65 programs: must be at most 64"),
    ],
)
def test_sizes_are_bounded(text, error):
    with pytest.raises(InputError, match=f"^{error}$"):
        Basic(text)
