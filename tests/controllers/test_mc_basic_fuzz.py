"""Mutated MC-Basic programs: they run, or are refused in one line."""

import random
import re

import pytest

from gantrysim import Job
from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Basic

from support.soaked import number_of_examples

SEEDS = (
    Job.load("softmc-basic").program["text"].replace("sleep 1\n", "sleep 50\n"),
    "attach G1\nG1.en = 1\nrecord a.rec 100 gap = 2 recdata = G1.setpoint{1}, pcmd, sys.clock\nmove G1 #{10, 0, 5, 0}\n"
    "delay G1 300\nrecordon\ncircle G1 circlepoint = #{0, 10, 5, 0} targetpoint = #{-10, 0, 5, 90}\nrecordclose\n",
    "dim i as long\ndim p[4] as joint of XY\nfor i = 1 to 4\nselect case i mod 2\ncase 0\np[i] = {i, -i}\ncase else\n"
    "p[i] = 3*{1, i}/2\nend select\nnext\ndo\nmove p[i - 1] abs = 0\ni = i - 1\nloop until i < 2 or i = 9\n"
    'sys.dout.1 = on\nsleep 5\n?VesExecute("vmax = 300"), "s"\nif i > 1 then sleep 3 else sleep 4\n',
)
NUMBERS = ("0", "-1", "2", "0.5", "1e5", "1e-9", "1e300", "{1, 2, 3}", '"s"', "pi")
PIECES = (
    *"{}()[]#,;:=<>.+-*/^_'\"\n 019",
    *("if", "then", "else", "end", "sub", "program", "for", "next", "while", "call", "move", "circle", "print"),
    *("1e308", "-1", "1e-300", "pcmd", "a1", "j9", "{1, 2}", "sys.", "dim", "as", "long", "string", "group", "const"),
    *(
        "ismoving",
        "sleep 1\n",
        "vcruise = ",
        "angle",
        "abs",
        "move {1, 1}\n",
        "en = 0\n",
        "next\n",
        "end if\n",
        "\x00",
        "é",
    ),
)


def mutated(rng):
    """A seed with some lines, words, numbers or characters replaced, doubled or left out."""
    text = rng.choice(SEEDS)
    for _ in range(rng.randint(1, 2)):
        kind = rng.randrange(8)
        if kind < 3:  # a word or a number by another
            words = list(re.finditer(r"\w+", text)) if kind else list(re.finditer(r"\b[\d.]+", text))
            one, other = rng.choice(words), rng.choice(words)[0]
            by = rng.choice((other, *NUMBERS)) if kind < 2 else rng.choice((other, *PIECES))
            text = text[: one.start()] + by + text[one.end() :]
        elif kind < 6:  # lines
            lines = text.splitlines(keepends=True)
            k, at = rng.randrange(len(lines)), rng.randrange(len(lines))
            line = lines[k] if kind == 5 else lines.pop(k)
            if kind > 3:
                lines.insert(at, line)
            text = "".join(lines) or " "
        else:
            at = rng.randrange(len(text) + 1)
            text = text[:at] + rng.choice(PIECES) + text[at + rng.randint(0, 3) :]
    return text


def run(rng, count):
    accepted, refused = 0, []
    for _ in range(count):
        text = mutated(rng)
        try:
            basic = Basic(text, max_statements=3000, coordinates=("x", "y", "z", "r")[: rng.randint(2, 4)])
            assert basic.requested.length > 0
            if basic.duration < 20:
                assert len(basic.setpoints(2e-3).position) > 1
            accepted += 1
        except InputError as error:
            refused.append(str(error))
        except Exception as error:  # so that the program is shown
            raise AssertionError(text) from error
    assert not any("\n" in message for message in refused)
    return accepted


def test_a_mutated_program_runs_or_is_refused():
    count = number_of_examples(300)
    assert 0.1 * count < run(random.Random(1), count) < 0.9 * count


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(10))
def test_a_hundred_thousand_mutated_programs_run_or_are_refused(seed, record_property):
    accepted = run(random.Random(100 + seed), 10_000)
    assert accepted > 100
    record_property("attack", "MC-Basic: random changes to programs")
    record_property("tries", 10_000)
    record_property("refused", 10_000 - accepted)
