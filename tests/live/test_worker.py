"""The process that simulates: replaced where it does not let go of a request, or has ended."""

import os
import queue
import signal
import time

import pytest

from gantrysim.live.draft import Draft, Request
from gantrysim.live.worker import PATIENCE as REPLACED_AFTER
from gantrysim.live.worker import Worker

PATIENCE = 120.0  # [s]
# computes for a long time before its first setpoint, and reports no progress
ENDLESS = """BASE(0,1)
x=0
WHILE 1
x=x+1
WEND
"""


@pytest.fixture
def worker():
    answers = queue.Queue()
    made = Worker(answers.put)
    yield made, answers
    made.close()


def done(answers, number):
    """The kinds of the messages of a request until it is done."""
    kinds = []
    while not kinds or kinds[-1] != "done":
        message = answers.get(timeout=PATIENCE)
        if message.number == number:
            kinds.append(message.kind)
    return kinds


@pytest.mark.soak
def test_a_process_that_does_not_let_go_is_replaced(worker, tmp_path):
    made, answers = worker
    made.ask(Request(1, "show", Draft("an225")))
    assert done(answers, 1).count("result") == 2
    (tmp_path / "endless.bas").write_text(ENDLESS)
    first = made.process_id
    made.ask(Request(2, "show", Draft(str(tmp_path / "endless.bas"))))
    while answers.get(timeout=PATIENCE).kind != "begun":
        pass
    time.sleep(1.0)  # else the newer request comes before the program is read
    made.ask(Request(3, "show", Draft("an225")))
    assert done(answers, 3).count("result") == 2
    assert made.process_id != first


@pytest.mark.soak
def test_a_process_that_ends_is_said_and_replaced(worker):
    made, answers = worker
    while answers.get(timeout=PATIENCE).kind != "ready":
        pass
    made.ask(Request(1, "show", Draft("an225")))
    while answers.get(timeout=PATIENCE).kind != "begun":
        pass
    os.kill(made.process_id, signal.SIGKILL)
    assert done(answers, 1)[-2:] == ["refused", "done"]
    made.ask(Request(2, "show", Draft("an225")))
    assert done(answers, 2).count("result") == 2


def stop_a_search(made, answers):
    """Ask for a search, and stop it by the second request once it makes progress."""
    made.ask(Request(1, "improve", Draft("an225")))
    while answers.get(timeout=PATIENCE).kind != "progress":
        pass
    made.ask(Request(2, "stop"))


@pytest.mark.soak
def test_a_stop_ends_a_request_without_an_answer(worker):
    made, answers = worker
    stop_a_search(made, answers)
    made.ask(Request(3, "show", Draft("an225")))
    assert done(answers, 3).count("result") == 2
    assert answers.empty()


@pytest.mark.soak
def test_a_process_that_has_stopped_is_kept(worker):
    made, answers = worker
    stop_a_search(made, answers)
    assert done(answers, 2) == ["done"]
    first = made.process_id
    time.sleep(1.5 * REPLACED_AFTER)
    assert made.process_id == first
