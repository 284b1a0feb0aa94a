"""Code in a job: what is asked for, the question on the terminal, and that nothing runs before the answer."""

import asyncio
import os
import subprocess
import sys
import time

import pytest

from gantrysim.live.consent import Code, Terminal, code_of
from gantrysim.live.draft import Draft, Request
from gantrysim.live.store import Store
from gantrysim.live.studio import Studio
from gantrysim.live.workbench import Workbench
from gantrysim.live.worker import Message

from support import live_jobs

PATIENCE = 120.0  # [s]
LAW = """from pathlib import Path
Path(__file__).with_name("it-ran").touch()

def law(tick, state, torque):
    for a in range(tick.axes):
        change = (tick.error[a] - state[a]) / tick.period if tick.time > 0 else 0.0
        state[a] = tick.error[a]
        torque[a] = tick.gains[a, 0] * tick.error[a] + tick.gains[a, 2] * change
"""
JOB = f"""{live_jobs.JOB}[servo]
law = "own.py:law"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A job with a law of its own outside the working folder."""
    made = tmp_path / "elsewhere"
    made.mkdir()
    (made / "own.py").write_text(LAW)
    (made / "own.toml").write_text(JOB)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    return made


def ask(studio, draft, *allowed):
    studio.newest += 1
    messages = []
    request = Request(studio.newest, "show", draft, allowed=frozenset(allowed))
    studio.answer(request, lambda *message: messages.append(message))
    return messages


def test_the_code_of_a_job_is_named_with_its_files_and_their_content(folder):
    path = str(folder / "own.toml")
    code = code_of(JOB, path)
    assert code.entries == (f"servo.law = {folder / 'own.py'}:law",)
    assert code_of(JOB.replace("100.0", "50.0"), path) == code
    (folder / "own.py").write_text(LAW + "# changed\n")
    assert code_of(JOB, path) != code
    assert code_of(JOB.replace("own.py:law", "pid"), path) is None
    assert code_of("[servo", path) is None
    os.mkfifo(folder / "pipe.py")
    assert code_of(JOB.replace("own.py", "pipe.py"), path).digests == ("",)


def test_a_question_moves_no_cursor():
    question = Code("a\x1b[2J\n.toml", ("servo.law = \x9b1A\u202e.py:f",), ("",)).question
    assert all(letter.isprintable() for line in question.split("\n") for letter in line)
    assert question.count("\n") == 2


@pytest.mark.parametrize(("typed", "expected"), [("y\n", True), ("Yes\n", True), ("\n", False), ("no\n", False)])
def test_only_a_yes_on_the_terminal_allows_it(typed, expected):
    master, slave = os.openpty()
    try:
        with os.fdopen(slave) as keyboard, os.fdopen(os.dup(slave), "w") as screen:
            terminal = Terminal(keyboard, screen)

            async def answers():
                pending = [asyncio.create_task(terminal.ask(f"{k}? ")) for k in range(2)]
                await asyncio.sleep(0.01)
                assert not pending[0].done()
                os.write(master, typed.encode())
                first = await pending[0]
                assert not pending[1].done()
                os.write(master, b"\n")
                return first, await pending[1]

            assert asyncio.run(answers()) == (expected, False)
    finally:
        os.close(master)


def test_what_was_typed_before_the_question_is_no_answer():
    master, slave = os.openpty()
    try:
        with os.fdopen(slave) as keyboard, os.fdopen(os.dup(slave), "w") as screen:

            async def answered():
                os.write(master, b"y\n")
                asked = asyncio.create_task(Terminal(keyboard, screen).ask("Run it? "))
                await asyncio.sleep(0.1)
                assert not asked.done()
                os.write(master, b"\n")
                return await asked

            assert not asyncio.run(answered())
    finally:
        os.close(master)


def test_a_pipe_is_no_terminal(tmp_path):
    with (tmp_path / "in").open("w+", encoding="utf-8") as file:
        assert not Terminal(file, file).is_interactive


def test_nothing_runs_before_it_is_allowed(folder, tmp_path):
    studio = Studio(tmp_path)
    draft = Draft(str(folder / "own.toml"))
    ((kind, content),) = ask(studio, draft)
    assert kind == "code"
    assert not (folder / "it-ran").exists()
    kinds = [kind for kind, _ in ask(studio, draft, content["code"])]
    assert kinds.count("result") == 2
    assert (folder / "it-ran").exists()


def test_an_edited_job_and_changed_code_are_asked_for_anew(folder, tmp_path):
    studio = Studio(tmp_path)
    path = str(folder / "own.toml")
    code = code_of(JOB, path)
    edited = Draft(path, JOB.replace("100.0", "80.0"))
    # of the same code, which was allowed
    assert "result" in [kind for kind, _ in ask(studio, edited, code)]
    (folder / "it-ran").unlink()
    (folder / "own.py").write_text(LAW + "# changed\n")
    assert [kind for kind, _ in ask(studio, Draft(path, version=1), code)] == ["code"]
    other = Draft(path, JOB.replace("own.py", "other.py"))
    assert [kind for kind, _ in ask(studio, other, code)] == ["code"]
    assert not (folder / "it-ran").exists()


def test_code_that_changed_since_it_was_allowed_does_not_run_with_a_moved_slider(folder, tmp_path):
    """A value of the servo imports the law again, from a file that may be another by now."""
    studio = Studio(tmp_path)
    path = str(folder / "own.toml")
    code = code_of(JOB, path)
    assert "result" in [kind for kind, _ in ask(studio, Draft(path), code)]
    (folder / "it-ran").unlink()
    (folder / "own.py").write_text(LAW + "# changed\n")
    assert [kind for kind, _ in ask(studio, Draft(path, values={"servo.damping": 0.6}), code)] == ["code"]
    assert not (folder / "it-ran").exists()
    now = code_of(JOB, path)
    assert "result" in [kind for kind, _ in ask(studio, Draft(path, values={"servo.damping": 0.6}), now)]


def test_the_code_of_an_edited_built_in_job_is_that_of_the_question(folder, tmp_path):
    text = JOB.replace('"own.py:law"', f'"{folder / "own.py"}:law"')
    code = code_of(text, "an225")
    assert code.entries == (f"servo.law = {folder / 'own.py'}:law",)
    assert "result" in [kind for kind, _ in ask(Studio(tmp_path), Draft("an225", text), code)]
    relative = code_of(JOB, "an225")
    assert relative.entries == (f"servo.law = {tmp_path / 'here' / 'own.py'}:law",)
    # there is none, and no other is sought
    kind, refusal = ask(Studio(tmp_path), Draft("an225", JOB), relative)[-1]
    assert kind == "refused"
    assert str(tmp_path / "here" / "own.py") in refusal["text"]


def test_the_terminal_is_asked_once_and_its_answer_holds(tmp_path):
    asked = []
    requests = []
    told = []
    bench = Workbench(
        Store(tmp_path, tmp_path),
        "an225",
        requests.append,
        lambda *message: told.append(message),
        lambda code, answered: asked.append((code, answered)),
    )
    bench.start()
    code = Code("an225", ("servo.law = /x/own.py:law",), ("0",))
    content = {"code": code, "text": "would run code of its own, servo.law = /x/own.py:law", "task": "show"}

    def refusal():
        bench.receive(Message(requests[-1].number, "code", content))
        kind, refused = told[-1]
        assert kind == "refused"
        assert set(refused) == {"text", "line", "word", "task"}
        return refused["text"]

    begin = "job an225 would run code of its own, servo.law = /x/own.py:law: "
    assert refusal() == f"{begin}answer on the terminal that started gantrysim live"
    assert refusal() == f"{begin}is asked for on the terminal"
    ((_, answered),) = asked
    answered(False)
    assert requests[-1].allowed == frozenset()
    assert refusal() == f"{begin}was refused on the terminal"
    answered(True)
    assert requests[-1].allowed == {code}
    assert len(asked) == 1
    # the answer to the question of a job that is no longer open starts nothing
    begun = len(requests)
    bench.receive(Message(requests[-1].number, "code", {**content, "code": code._replace(job="/x/own.toml")}))
    asked[-1][1](True)
    assert len(asked) == 2
    assert len(requests) == begun


def test_without_a_terminal_the_refusal_says_what_to_do(tmp_path):
    requests = []
    told = []
    bench = Workbench(Store(tmp_path, tmp_path), "an225", requests.append, lambda *message: told.append(message))
    bench.start()
    code = Code("/x/own.toml", ("servo.law = /x/own.py:law",), ("0",))
    content = {"code": code, "text": "would run code of its own, servo.law = /x/own.py:law", "task": "show"}
    bench.receive(Message(requests[-1].number, "code", content))
    assert "gantrysim live was not started from one" in told[-1][1]["text"]
    assert "--allow-code" in told[-1][1]["text"]


@pytest.mark.soak
def test_the_command_asks_on_its_terminal(folder):
    master, slave = os.openpty()
    command = [sys.executable, "-m", "gantrysim", "live", str(folder / "own.toml"), "--no-browser"]
    process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True, preexec_fn=own)
    os.close(slave)
    try:
        seen = b""
        while b"run it? [y/N] " not in seen:
            seen += os.read(master, 4096)
        assert f"servo.law = {folder / 'own.py'}:law".encode() in seen
        assert not (folder / "it-ran").exists()
        os.write(master, b"y\n")
        end = time.monotonic() + PATIENCE
        while not (folder / "it-ran").exists():
            assert time.monotonic() < end
            time.sleep(0.1)
        os.write(master, b"\x03")
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
        os.close(master)


def own():
    """Make the standard input the terminal of the process, as a shell does."""
    import fcntl
    import termios

    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
