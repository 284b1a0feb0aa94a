"""Processes that get a signal at a chosen access to a folder, or at a chosen time.

Python reports every file that is opened, renamed or removed before it happens; these reports are counted.
"""

import atexit
import contextlib
import io
import json
import os
import signal
import subprocess
import sys
import threading
import time
import traceback
from pathlib import Path

from support.studies import SHORT

KILLS = [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP]
_EVENTS = {"open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate"}


def forked(action, folder, at=None, after=None, number=signal.SIGKILL, output=os.devnull):
    """Call a function in a copy of this process.

    It gets a signal before its at-th access to a folder, or after a time [s]. Returns its exit status, negative for a
    signal, the number of its accesses, and the time from the signal to its end [s], 0 without one.
    """
    told, tell = os.pipe()
    process = os.fork()
    if process == 0:
        os.close(told)
        _child(action, str(folder), at, number, output, tell)
    os.close(tell)
    sent = [0.0]

    def send():
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, number)
            sent[0] = time.monotonic()

    timer = threading.Timer(after or 0.0, send)
    if after is not None:
        timer.start()
    with os.fdopen(told, "rb") as stream:
        seen = b""
        while part := stream.read1():
            seen += part
            if at is not None and len(seen) == at + 1 and not sent[0]:
                sent[0] = time.monotonic()
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    timer.cancel()
    return status, len(seen), time.monotonic() - sent[0] if sent[0] else 0.0


def _child(action, folder, at, number, output, tell):
    status = 99
    try:
        os.setsid()
        atexit._clear()  # what the parent has opened is not this copy's to close, a display of OpenGL above all
        sink = os.open(output, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(sink, 1)
        os.dup2(sink, 2)
        sys.stdout, sys.stderr = (
            io.TextIOWrapper(io.FileIO(number, "w", closefd=False), write_through=True) for number in (1, 2)
        )
        for one in KILLS[1:]:
            signal.signal(one, signal.default_int_handler if one == signal.SIGINT else signal.SIG_DFL)
        count = 0

        def hook(event, arguments):
            nonlocal count
            if (
                event in _EVENTS
                and not isinstance(arguments[0], int | type(None))
                and folder in os.fsdecode(arguments[0])
            ):
                os.write(tell, b".")
                count += 1
                if at is not None and count == at + 1:
                    os.kill(os.getpid(), number)

        sys.addaudithook(hook)
        status = action() or 0
    except SystemExit as stop:
        status = stop.code or 0
    except KeyboardInterrupt:
        status = 97
    except BaseException:
        traceback.print_exc()
        status = 98
    finally:
        with contextlib.suppress(BaseException):  # as Python ends
            threading._shutdown()
            atexit._run_exitfuncs()
        os._exit(status)


class Commands:
    """Runs commands in copies of a process in which everything is imported and compiled. A context manager."""

    def __enter__(self):
        here = Path(__file__).parents[1]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join((str(here), str(here.parent)))}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "support.kills"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        return self

    def __exit__(self, *_):
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()

    def __call__(self, arguments, folder, at=None, after=None, number=signal.SIGKILL):
        """Return what `forked` returns of a command, and what it prints."""
        output = f"{folder}.txt"
        print(json.dumps([list(map(str, arguments)), str(folder), at, after, number, output]), file=self.process.stdin)
        self.process.stdin.flush()
        status, seen, ending = json.loads(self.process.stdout.readline())
        return status, seen, ending, Path(output).read_text()


def _serve():
    from gantrysim import Job
    from gantrysim.cli import evaluation, main, start
    from gantrysim.glue.bead import Bead
    from gantrysim.metrics.analysis import Analysis
    from gantrysim.render import save_video
    from gantrysim.report.page import write_run_page
    from gantrysim.report.plots import save_plots

    assert evaluation
    assert main
    assert save_plots
    assert save_video
    assert write_run_page
    job = Job.load("an225", SHORT)
    run = job.run()
    assert Bead(run, job.bead, Analysis(run)).values

    def command():
        sys.argv = ["gantrysim", *arguments]
        try:
            start.main()
        except KeyboardInterrupt as stop:
            start.last_words(KeyboardInterrupt, stop, None)

    for line in sys.stdin:
        arguments, folder, at, after, number, output = json.loads(line)
        print(json.dumps(forked(command, folder, at, after, number, output)), flush=True)


if __name__ == "__main__":
    _serve()
