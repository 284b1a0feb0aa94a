"""Loops of MC-Basic that wait for a motion: skipped passes against the same program run pass by pass."""

import random

import pytest

from gantrysim.base.errors import InputError
from gantrysim.controllers.softmc import Basic
from gantrysim.controllers.softmc.basic import program
from gantrysim.controllers.softmc.basic.execution import Waits

from support.soaked import number_of_examples

BEGIN = "dim k as long\ndim n as long\nmove {0, 0}\nmove {30, 20} vcruise = 40\n"
WAIT = "while ismoving\nsleep 3\nend while\n"
COUNTED_WAIT = "while ismoving\nsleep 1\nk = k + 1\nend while\n"
END = f"print sys.clock, pcmd, k\nmove {{1, 2}}\n{WAIT}sys.dout.1 = on\nsleep 7\nmove {{0, 0}}\n"
BOTH = "common shared n as long\nfunction double(x as long) as long\ndouble = 2*x\nn = n + 1\nend function\n"
LOOPS = {
    "while": "while ismoving <> 0\nsleep 1\nend while\n",
    "two sleeps": "while ismoving and not (k > 2)\nsleep 0.7\nif k = 1 then sleep 3 else sleep 0.3\nend while\n",
    "do until": "do\nsleep 2.5\nloop until ismoving = 0\n",
    "nested": "do\nwhile ismoving and k < 3\nsleep 1\nend while\nk = k + 1\nloop while k < 5\n",
    "two motions": "move {-5, 9} vcruise = 30\nwhile ismoving\nsleep 0.9\nend while\n",
    "no time": "while ismoving\nend while\n",
}
WATCHING = {
    "the clock": "n = sys.clock + 400\nwhile ismoving and sys.clock < n\nsleep 1\nend while\n",
    "the place": "while ismoving and a1.pcmd < 17\nsleep 1\nend while\n",
    "a counter": COUNTED_WAIT,
    "prints": "while ismoving\nsleep 50\nprint k\nend while\n",
    "settling": "while issettled = 0 and ismoving\nsleep 1\nend while\n",
}


def outcome(text, **settings):
    """All that a program leaves behind, or its error."""
    program._run.cache_clear()
    try:
        task = Basic(text, **settings).task
    except InputError as error:
        return str(error)
    steps = [(type(step).__name__, step.duration) for step in task.time.steps]
    return task.time.clock, task.time.free, task.clock.count, task.clock.line, task.printed, task.switched, steps


def both(text, monkeypatch, **settings):
    """What a program leaves behind with passes skipped, after a look that it is the same without; and how many are."""
    count = 0
    skip = Waits._skip

    def counted(waits, statements):
        nonlocal count
        before = waits._clock.count
        skip(waits, statements)
        count += waits._clock.count - before

    with monkeypatch.context() as patch:
        patch.setattr(Waits, "_skip", counted)
        skipped = outcome(text, **settings)
    with monkeypatch.context() as patch:
        patch.setattr(Waits, "_skip", lambda waits, statements: None)
        assert outcome(text, **settings) == skipped
    program._run.cache_clear()
    return skipped, count


@pytest.mark.parametrize("line_time", [1e-5, 3.3e-4])
@pytest.mark.parametrize("loop", LOOPS)
def test_a_wait_takes_the_same_time_and_statements_where_its_passes_are_skipped(loop, line_time, monkeypatch):
    _, skipped = both(BEGIN + LOOPS[loop] + END, monkeypatch, line_time=line_time)
    assert skipped > 100


@pytest.mark.parametrize("loop", WATCHING)
def test_a_loop_that_sees_or_changes_more_than_the_time_is_run(loop, monkeypatch):
    _, skipped = both(
        BEGIN + WATCHING[loop] + "while ismoving\nsleep 1\nk = k + 1\nend while\nmove {0, 0}", monkeypatch
    )
    assert skipped == 0


def test_a_function_in_the_condition_is_called_in_every_pass(monkeypatch):
    wait = "while ismoving and double(2) = 4\nsleep 1\nend while\nprint n\n"
    result, skipped = both(f"{BOTH}program\nmove {{0, 0}}\nmove {{30, 20}}\n{wait}end program", monkeypatch)
    assert skipped == 0
    assert int(result[4][0]) > 100


@pytest.mark.parametrize("most", [20, 21, 22, 500, 501])
def test_the_limit_of_statements_ends_a_wait_at_the_same_one(most, monkeypatch):
    error, _ = both(BEGIN + LOOPS["while"] + END, monkeypatch, max_statements=most)
    assert error.startswith(f"line 5: {most} statements are run") or error.startswith(f"line 6: {most} statements are")


def test_a_wait_for_what_never_comes_is_run_to_the_limit(monkeypatch):
    endless = "sleep 2000\nwhile ismoving = 0\nsleep 1\nend while\n"
    error, skipped = both(BEGIN + endless, monkeypatch, max_statements=500)
    assert error.endswith("500 statements are run: a program must end before; see max_statements")
    assert skipped == 0


def test_random_waits_are_the_same_either_way(monkeypatch):
    choice = random.Random(4)
    total = 0
    for _ in range(number_of_examples(30)):
        parts = choice.choices([*LOOPS.values(), *WATCHING.values(), "k = 0\n", "move {8, k} vcruise = 90\n"], k=4)
        if choice.random() < 0.3:
            parts.insert(2, f"while ismoving\n{parts[0]}sleep {choice.choice(['1', '0', 'k'])}\nend while\n")
        _, skipped = both(
            BEGIN + "".join(parts) + END, monkeypatch, line_time=choice.choice([0.0, 1e-5, 1e-3]), max_statements=30_000
        )
        total += skipped
    assert total > number_of_examples(1000)
