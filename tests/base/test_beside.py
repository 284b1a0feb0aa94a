"""A copy of a process computes beside it, ends with it, and is not made where it could hang."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from gantrysim.base import beside as module
from gantrysim.base.beside import beside

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="copies are made on Linux alone")

# in a process of its own, as that of the tests may have threads
SCRIPT = """
import json, os, signal, sys, time
from gantrysim.base import beside as module
from gantrysim.base.beside import beside

os.sched_getaffinity = lambda _: {0, 1}
told = {"parent": os.getpid()}

def interrupted():
    os.kill(os.getpid(), signal.SIGINT)
    return os.getpid()

with beside(interrupted) as value:
    told["copy"] = value()
with beside(lambda: 1 / 0) as value:
    told["failed"] = value()
with beside(lambda: "x" * 10_000_000) as value:
    told["long"] = len(value())

def refuse():
    raise BlockingIOError("no process is left")

fork = os.fork
os.fork = refuse
with beside(os.getpid) as value:
    told["refused"] = value()
os.fork = fork
module._PATIENCE = 0.1
with beside(lambda: time.sleep(60)) as value:
    told["late"] = value()

def sleep():
    print(os.getpid(), file=sys.stderr, flush=True)
    time.sleep(60)

start = time.monotonic()
try:
    with beside(sleep):
        raise RuntimeError
except RuntimeError:
    told["children"] = open(f"/proc/self/task/{os.getpid()}/children").read()
told["took"] = time.monotonic() - start
print(json.dumps(told), flush=True)
module._PATIENCE = 60
with beside(sleep) as value:
    value()
"""


def is_there(process):
    """Whether a process runs; one that has ended may remain as a zombie until its parent asks for it."""
    try:
        status = Path(f"/proc/{process}/stat").read_text()
    except OSError:
        return False
    return status.rpartition(")")[2].split()[0] != "Z"


def test_a_copy_computes_and_ends_with_its_block_or_its_parent():
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", SCRIPT], text=True, **pipes) as process:
        told = json.loads(process.stdout.readline())
        assert told["parent"] == process.pid
        assert told["copy"] not in (None, process.pid)  # Ctrl-C of the terminal is the parent's
        assert told["failed"] is None
        assert told["long"] == 10_000_000
        assert (told["refused"], told["late"]) == (None, None)
        assert told["children"] == ""
        assert told["took"] < 30
        copies = map(int, process.stderr)
        copy = next(number for number in copies if is_there(number))  # that of the block that failed has ended
        process.send_signal(signal.SIGKILL)
        deadline = time.monotonic() + 20
        while is_there(copy) and time.monotonic() < deadline:
            time.sleep(0.01)
        assert not is_there(copy)


def test_no_copy_is_made_of_a_process_with_threads_or_for_one_core(monkeypatch):
    def never():
        raise AssertionError("computed")

    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})
    done = threading.Event()
    thread = threading.Thread(target=done.wait)
    thread.start()
    with beside(never) as value:
        assert value() is None
    done.set()
    thread.join()
    monkeypatch.setattr(module, "_THREADS", Path("nowhere"))
    with beside(never) as value:
        assert value() is None
    monkeypatch.undo()
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with beside(never) as value:
        assert value() is None
