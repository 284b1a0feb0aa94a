"""Fresh processes that have imported nothing of gantrysim, cheap enough for one per example.

A server imports the libraries that gantrysim is built on and has numba compile once, which takes most of a start, but
imports nothing of gantrysim, and forks for every request. A child is thus where a stranger's interpreter is after its
imports of other libraries: what one module of gantrysim needs of another and does not import itself is missing.
"""

import json
import os
import subprocess
import sys
from typing import NamedTuple

# Not gymnasium: gantrysim acts when it is imported, so whether it is must be left to the example.
LIBRARIES = """
import ezdxf, imageio, imageio_ffmpeg, jinja2, joblib, lark, matplotlib.figure, mujoco, mujoco.batch, numba, numpy
import PIL.Image, pydantic, rich.console, scipy.optimize, scipy.signal, scipy.spatial, svgelements, tomli_w, typer
"""

_SERVER = """
import atexit, gc, json, os, sys, threading

LIBRARIES
# numba sets up its compiler at the first call, which takes half a second
numba.njit(lambda value: value)(1.0)

def run(request):
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(os.open(request["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
    os.dup2(os.open(request["error"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)
    os.chdir(request["folder"])
    sys.argv[:] = request["arguments"]
    try:
        exec(compile(request["code"], "example", "exec"), {"__name__": "__main__"})
    except SystemExit:
        raise
    except BaseException:
        sys.excepthook(*sys.exc_info())
        raise SystemExit(1)

def status_of(request):
    try:
        run(request)
    except SystemExit as stop:
        if isinstance(stop.code, str):
            print(stop.code, file=sys.stderr)
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    return 0

assert not any(name.partition(".")[0] == "gantrysim" for name in sys.modules)
gc.freeze()
for line in sys.stdin:
    child = os.fork()
    if child == 0:
        status = status_of(json.loads(line))
        threading._shutdown()
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)  # the end of the interpreter would take longer than most examples
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


class Done(NamedTuple):
    """What a fresh process did: its exit status, negative for a signal, and what it printed."""

    status: int
    output: str
    error: str


class FreshProcesses:
    """A server of fresh processes; `close` ends it.

    Args:
        folder: for what the processes print.
    """

    def __init__(self, folder):
        self._output = folder / "output"
        self._error = folder / "error"
        # threads of a linear algebra library do not survive a fork
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        code = _SERVER.replace("LIBRARIES", LIBRARIES)
        self._server = subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, **threads},
        )

    def run(self, code, folder, *arguments):
        """Run code in a fresh process, with a working directory and the arguments of its command."""
        request = {
            "code": code,
            "folder": str(folder),
            "arguments": ["example", *map(str, arguments)],
            "output": str(self._output),
            "error": str(self._error),
        }
        print(json.dumps(request), file=self._server.stdin, flush=True)
        answer = self._server.stdout.readline()
        assert answer, "the server has ended"
        return Done(
            json.loads(answer), self._output.read_text(encoding="utf-8"), self._error.read_text(encoding="utf-8")
        )

    def command(self, folder, *arguments):
        """Run the command `gantrysim` in a fresh process."""
        return self.run("from gantrysim.cli.start import main; main()", folder, *arguments)

    def close(self):
        self._server.stdin.close()
        self._server.wait()
        self._server.stdout.close()
