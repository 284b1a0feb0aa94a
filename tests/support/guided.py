"""Inputs that grow towards code not yet reached: atheris' search on each of the readers of a user's files.

python tests/support/guided.py TARGET|all [RUNS] [FOLDER]

Only InputError may come out of a reader, in one line, and no input may take much memory; anything else ends the search
with exit status 77 and leaves the input in FOLDER, by default the working folder. The last line says how many inputs
were tried.
"""

import re
import resource
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

DOCS = Path(__file__).parents[2] / "docs"
LONGEST = 4096  # bytes of an input
SLOWEST = 60  # seconds for one input
LARGEST = 4000  # of the whole search, which compiles what a reader calls [MB]
MOST = 500  # for one input [MB]
SHORT = 5.0  # of machine time that is planned [s]


class Target(NamedTuple):
    """A reader.

    Attributes:
        seeds: inputs to begin with.
        read: reads an input; raises InputError.
    """

    seeds: Callable[[], Sequence[bytes]]
    read: Callable[[bytes], object]


def program_seeds(name: str, page: str, fence: str) -> list[bytes]:
    """Return the programs of a controller's built-in jobs and of its page."""
    from gantrysim.job.job import Job
    from gantrysim.job.loading import builtin_jobs
    from gantrysim.job.programs import PROGRAMS

    key = PROGRAMS[name].text_argument
    found = [job.program[key] for job in map(Job.load, builtin_jobs()) if job.program["controller"] == name]
    text = (DOCS / page).read_text(encoding="utf-8")
    return [one.encode() for one in [*found, *re.findall(rf"```{fence}\n(.*?)```", text, flags=re.DOTALL)]]


def reads(name: str, **limits: object) -> Callable[[bytes], object]:
    """Return the reader of a controller's programs."""

    def read(content: bytes) -> object:
        from gantrysim.job.programs import PROGRAMS

        kind: Any = PROGRAMS[name]
        program = kind(**{kind.text_argument: content.decode("utf-8", errors="replace"), **limits})
        if program.duration < SHORT:
            assert np.isfinite(program.setpoints(0.001).position).all()
        return program.notes

    return read


def in_a_file(suffix: str, read: Callable[[str], object]) -> Callable[[bytes], object]:
    """Return a reader of bytes, from one of files."""
    folder = tempfile.TemporaryDirectory()

    def from_file(content: bytes) -> object:
        _ = folder
        path = Path(folder.name) / f"input{suffix}"
        path.write_bytes(content)
        return read(str(path))

    return from_file


def _job(path: str) -> object:
    from gantrysim.job.job import Job

    return Job.load(path)


def _machine(path: str) -> object:
    from gantrysim import Machine

    return Machine(path)


def _record(path: str) -> object:
    from gantrysim import Run

    return Run.load(path)


def _jobs() -> list[bytes]:
    from gantrysim.job.loading import builtin_jobs, job_text

    return [job_text(name).encode() for name in builtin_jobs()]


def _machines() -> list[bytes]:
    from importlib.resources import files

    import mujoco

    made = []
    for name in ("xy", "stage"):
        spec = mujoco.MjSpec.from_file(str(files("gantrysim.models") / f"{name}.xml"))
        spec.compile()
        made.append(spec.to_xml().encode())
    return made


def _records() -> list[bytes]:
    from gantrysim import Machine, Servo, simulate
    from gantrysim.paths.arcs import ArcChain
    from gantrysim.record.setpoints import Setpoints

    machine = Machine("xy")
    servo = Servo.derive(machine.axes)
    run = simulate(machine, servo, Setpoints.along(ArcChain((0, 0), 0, [0], [1.0]), 50, servo.period))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.npz"
        run.save(path)
        return [path.read_bytes()]


def _drawings() -> list[bytes]:
    from support.drawings import csv, dxf, line, svg

    square = [(0, 0), (10, 0), (10, 10)]
    drawn = (
        dxf(line((0, 0), (3, 0)) + line((3, 0), (3, 4))),
        svg('<path d="M0 0 L10 0 A5 5 0 0 1 10 10 z"/>'),
        csv(square),
    )
    return [one.encode() for one in drawn]


TARGETS = {
    "Trio BASIC": Target(
        lambda: program_seeds("trio.Basic", "trio-basic.md", "basic"),
        reads("trio.Basic", statement_limit=500, time_limit=0.3, unassigned_zero=True),
    ),
    "MC-Basic": Target(
        lambda: program_seeds("softmc.Basic", "mc-basic.md", "basic"),
        reads("softmc.Basic", max_statements=5000),
    ),
    "G-code of LinuxCNC": Target(
        lambda: program_seeds("linuxcnc.Program", "g-code.md", "gcode"),
        reads("linuxcnc.Program", max_steps=300),
    ),
    "G-code of slicers": Target(
        lambda: program_seeds("slicer.Program", "g-code.md", "gcode"),
        reads("slicer.Program", max_steps=300),
    ),
    "FANUC programs": Target(
        lambda: program_seeds("fanuc.Program", "controllers.md", "gcode"),
        reads("fanuc.Program", max_steps=300),
    ),
    "drawings": Target(_drawings, reads("cad.Drawing", unit="mm")),
    "job files": Target(_jobs, in_a_file(".toml", _job)),
    "MJCF": Target(_machines, in_a_file(".xml", _machine)),
    "records": Target(_records, in_a_file(".npz", _record)),
}


def _any(content: bytes) -> object:
    return list(TARGETS.values())[content[0] % len(TARGETS)].read(content[1:]) if content else None


# the first byte names the reader
EVERY = Target(lambda: [bytes([k]) + seed for k, one in enumerate(TARGETS.values()) for seed in one.seeds()], _any)


def compiled() -> list[str]:
    """Return the modules with functions that numba compiles, which may not be changed."""
    root = DOCS.parent / "gantrysim"
    marked = re.compile(r"\bjit\b|\bc_function\b|\bwith_parts\b|PlainLaw")
    paths = [path for path in root.rglob("*.py") if marked.search(path.read_text(encoding="utf-8"))]
    # plain functions of laws and faults, and what they call, are compiled as parts of the servo tick
    paths += [root / "servo" / "notch.py", *(root / "servo" / "laws").glob("*.py"), *(root / "faults").glob("*.py")]
    return [".".join(path.relative_to(root.parent).with_suffix("").parts) for path in paths]


def search(name: str, runs: int, folder: Path) -> None:
    """Try inputs; ends the process."""
    import atheris

    target = TARGETS.get(name, EVERY)
    with atheris.instrument_imports(include=["gantrysim"], exclude=compiled()):
        import_module("gantrysim.cli.start")
        seeds = target.seeds()
    from gantrysim.base.errors import InputError

    warnings.simplefilter("ignore")

    def one(content: bytes) -> None:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            target.read(content)
        except InputError as error:
            text = str(error)
            if "\n" in text or len(text) > 600:
                raise AssertionError(text) from error
        taken = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1e3
        assert taken < MOST, f"{taken:.0f} MB for one input"

    with tempfile.TemporaryDirectory() as corpus:
        for k, seed in enumerate(seeds):
            (Path(corpus) / str(k)).write_bytes(
                seed[:LONGEST] if len(seed) > LONGEST and b"PK" not in seed[:2] else seed
            )
        most = max(LONGEST, *map(len, seeds))
        limits = f"-runs={runs} -max_len={most} -timeout={SLOWEST} -rss_limit_mb={LARGEST} -seed=1 -verbosity=1"
        atheris.Setup([name, *limits.split(), f"-artifact_prefix={folder}/", corpus], one)
        atheris.Fuzz()


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))
    name, runs, folder = [*sys.argv[1:], *("2000", ".")[len(sys.argv) - 2 :]]
    search(name, int(runs), Path(folder))
