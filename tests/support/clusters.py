"""A Dask cluster on this machine, and what its workers are asked to measure."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

from gantrysim.study import measure

from support.studies import PATIENCE

TESTS = Path(__file__).parent.parent
# they end by themselves where the tests are killed [s]
IDLE = 120
ORPHANED = 5


class Cluster:
    """A scheduler that knows nothing of gantrysim, and workers of one thread each, as processes of their own.

    Args:
        folder: for what they write.
        settings: of Dask, as environment variables.
    """

    def __init__(self, folder, **settings):
        self.folder, self.processes = folder, []
        # a statistical profile of its threads, every hundredth of a second, takes a third of a worker's time
        self.environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False", **settings}
        file, bare = folder / "scheduler.json", without_gantrysim(folder)
        self.scheduler = self._begin("scheduler", [bare], "--scheduler-file", file, "--port", 0, "--idle-timeout", IDLE)
        waited_for(lambda: file.exists() and file.read_text().endswith("}"), self.scheduler)
        self.address = json.loads(file.read_text())["address"]
        self.workers = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            process.kill()
            process.wait()

    def filled(self, count, *paths):
        """Have so many workers, and return their processes; those that are new search some folders first."""
        self.workers = [worker for worker in self.workers if worker.poll() is None]
        while len(self.workers) > count:
            self.kill(self.workers.pop())
        self.workers += [self._worker(*paths) for _ in range(count - len(self.workers))]
        waited_for(lambda: self.count("workers") == count, *self.workers)
        return self.workers

    @contextmanager
    def odd_one(self, path):
        """Have one worker alone inside the block, which searches a folder first for what it imports."""
        self.filled(0)
        self.filled(1, path)
        yield
        self.filled(0)

    def count(self, what):
        """Number of workers or tasks that the scheduler has."""
        from distributed import Client

        with Client(self.address, timeout=PATIENCE, set_as_default=False) as client:
            return client.run_on_scheduler(lambda dask_scheduler: len(getattr(dask_scheduler, what)))

    def kill(self, worker):
        worker.send_signal(signal.SIGKILL)
        worker.wait()

    def _worker(self, *paths):
        paths = (*paths, TESTS)
        return self._begin("worker", paths, self.address, "--no-nanny", "--nthreads", 1, "--death-timeout", ORPHANED)

    def _begin(self, what, paths, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", "--host", "127.0.0.1", "--no-dashboard"]
        with (self.folder / "log").open("ab") as log:
            process = subprocess.Popen(
                [*command, *map(str, arguments)],
                env={**self.environment, "PYTHONPATH": os.pathsep.join(map(str, paths))},
                cwd=self.folder,
                stdout=log,
                stderr=log,
            )
        self.processes.append(process)
        return process


def without_gantrysim(folder):
    """A folder, to be searched first for what is imported, that hides gantrysim."""
    hiding = folder / "hiding"
    (hiding / "gantrysim").mkdir(parents=True)
    (hiding / "gantrysim" / "__init__.py").touch()
    return hiding


def waited_for(happened, *processes):
    """Wait until something has happened, while processes live."""
    until = time.monotonic() + PATIENCE
    while not happened():
        assert all(process.poll() is None for process in processes), "a process has ended"
        assert time.monotonic() < until, "it has not happened"
        time.sleep(0.02)


# what workers measure


def where(case):
    """The process that measures a case."""
    return {"status": "ok", "process": os.getpid()}


def all_of(cases):
    return [measure(case) for case in cases]


def held(case, folder, free):
    """Measure a case; those of a longer loop period than is free wait until the folder's gate is opened.

    A file in the folder tells of each that was begun in which process.
    """
    if case.settings["program.loop_period"] > free:
        (Path(folder) / f"{case.key[:8]}-{os.getpid()}").touch()
        waited_for((Path(folder) / "gate").exists)
    return measure(case)


def company(case, folder, patience):
    """How many cases are under way while this one is, at most; it waits a while for another."""
    mark = Path(folder) / case.key[:8]
    mark.touch()
    until, most = time.monotonic() + patience, 1
    while time.monotonic() < until and most < 2:
        most = max(most, len(list(Path(folder).iterdir())))
        time.sleep(0.01)
    time.sleep(0.1)  # to be seen by the other
    mark.unlink()
    return {"status": "ok", "most": most}


def deadly(case):
    os.kill(os.getpid(), signal.SIGKILL)


def broken(case):
    raise ZeroDivisionError("in the case")
