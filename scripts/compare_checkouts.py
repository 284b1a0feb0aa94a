"""Run the same work in two checkouts and compare the numbers that they write, to the last bit.

    python scripts/compare_checkouts.py OLD NEW [NAME ...]

OLD and NEW are folders of checkouts that `scripts/test.sh` has set up. NAME is a built-in job, one of COMMANDS, or one
of PROBES; by default all of them, which takes a quarter of an hour. Of sentences the numbers must be equal; where words
alone differ, that is printed. What has another name in NEW is listed in RENAMED, what it lacks on purpose in REMOVED.
Exit status 1 where a number differs.
"""

import csv
import json
import re
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

COMMANDS = {
    "loop": ("study", "loop", "an225", "--set", "turns=1", "--set", "diameter=40"),
    "speed": ("study", "speed", "softmc-arc", "--tolerance", "100"),
    "machine": ("study", "machine", "softmc-arc", "--tolerance", "20", "--samples", "12"),
    "circle": ("study", "circle"),
    "repeat": ("study", "repeat", "softmc-arc", "--repeats", "3"),
    "laws": ("study", "laws", "softmc-arc"),  # every rung of the ladder
    "tune": ("tune", "softmc-arc", "--budget", "24", "--robust", "2", "--unseen", "2"),
    "causes": ("run", "softmc-arc", "--causes", "--repeat", "2", "--no-video", "--no-report"),
}
# Runs of softmc-arc with what no built-in job has
VARIANTS = {
    "load encoders": ("servo.feedback='load'",),
    "velocity drives": ("servo.mode='velocity'",),
    "position drives": ("servo.mode='position'",),
    "late": ("servo.delay=0.0005", "servo.feedback_delay=2"),
    "noisy encoders": ("servo.encoder_noise=0.001", "servo.interpolation_error=0.0005", "servo.signal_period=0.02"),
    "current loop and notch": ("servo.current_bandwidth=900", "servo.notch_frequency=180"),
    "friction, observer, contour": ("servo.law=['pid','friction','observer','contour']", "servo.integral_time=0.02"),
    "cascade, preview": ("servo.law=['p-pi','preview']",),
    "time-pressure": ("dispenser.metering='time-pressure'", "dispenser.needle.bore=0.84", "dispenser.syringe.fill=0.5"),
    "geometry": ("geometry.accuracy='C5'", "geometry.warming=3"),
}
FAULTS = {
    "encoder dropout": "axis='x', time=0.5, duration=0.004",
    "encoder glitch": "axis='x', time=0.5, counts=100, ticks=3",
    "encoder slip": "axis='x', time=0.5, counts=200",
    "stuck axis": "axis='y', time=0.5, duration=0.004",
    "slipping axis": "axis='y', time=0.5, offset=0.1",
    "open winding": "axis='x', time=0.5, duration=0.01",
    "bus sag": "time=0.5, duration=0.3, share=0.3",
    "lost packets": "time=0.5, ticks=5, drive='extrapolate'",
    "clogged nozzle": "time=0.5, duration=0.3, share=0.3",
    "dripping nozzle": "time=0.5, duration=0.3, flow=0.5",
    "air bubble": "time=0.5, volume=1.0",
}
STEPS = 200  # of an environment
RENAMED: dict[str, str] = {}  # from the name in OLD to that in NEW
REMOVED: tuple[str, ...] = ()  # names in OLD
UNLIKE = ("format", "sha256")  # the format's version, and the checksum of a file, which covers it


def probe_margins(folder: Path) -> None:
    """Write the margins of each built-in machine with torque drives, and of each built-in job."""
    from importlib.resources import files

    from gantrysim import Job, Machine, Servo
    from gantrysim.job.loading import builtin_jobs
    from gantrysim.servo.stability.margins import margins_of

    values = {}
    names = [file.name for file in files("gantrysim.models").iterdir() if file.name.endswith(".xml")]
    for name in sorted(file.removesuffix(".xml") for file in names):
        machine = Machine(name)
        values[name] = margins_of(machine, Servo.derive(machine.axes, mode="torque"))
    values |= {name: Job.load(name).margins for name in builtin_jobs()}
    content = {name: [asdict(margins) for margins in axes or ()] for name, axes in values.items()}
    (folder / "margins.json").write_text(json.dumps(content))


def probe_variants(folder: Path) -> None:
    """Write the records of runs with other drives, encoders, laws and machines, and with every fault."""
    from gantrysim import Job

    faults = {kind: (f"faults=[{{kind='{kind}', {values}}}]",) for kind, values in FAULTS.items()}
    for name, settings in (VARIANTS | faults).items():
        Job.load("softmc-arc", settings).run().save(folder / f"{name}.npz")
    for table in Path("examples/machines").glob("*.toml"):
        Job.load("softmc-arc", machine=str(table)).run().save(folder / f"{table.stem}.npz")


def probe_environments(folder: Path) -> None:
    """Write what each registered environment returns, alone and as a vector, for drawn actions."""
    import gymnasium

    import gantrysim.env  # noqa: F401

    for identity in [name for name in gymnasium.registry if name.startswith("gantrysim/")]:
        for kind, environment in (
            ("alone", gymnasium.make(identity)),
            ("vector", gymnasium.make_vec(identity, num_envs=3)),
        ):
            environment.action_space.seed(7)
            answers = [environment.reset(seed=11)]
            for _ in range(STEPS):
                answers.append(environment.step(environment.action_space.sample()))
                if kind == "alone" and any(answers[-1][2:4]):
                    answers.append(environment.reset())
            name = identity.removeprefix("gantrysim/")
            (folder / f"{name} {kind}.json").write_text(json.dumps(answers, default=lambda value: value.tolist()))


PROBES: dict[str, Callable[[Path], None]] = {
    "margins": probe_margins,
    "variants": probe_variants,
    "environments": probe_environments,
}


def written(checkout: Path, name: str, folder: Path) -> dict[str, Any]:
    """Do a piece of work in a checkout; return what it writes, by file and key."""
    folder.mkdir()
    if name in PROBES:
        command = [str(checkout / ".venv/bin/python"), __file__, "--probe", name, str(folder)]
    else:
        words = COMMANDS.get(name, ("run", name, "--no-video", "--no-report"))
        command = [str(checkout / ".venv/bin/gantrysim"), *words, "--out", str(folder)]
    done = subprocess.run(command, check=False, cwd=checkout, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{checkout}: {name} ends with status {done.returncode}\n{done.stderr[-2000:]}")
    values: dict[str, Any] = {"output": done.stdout.replace(str(folder), "")}
    for file in sorted(folder.rglob("*")):
        values |= {f"{file.name}: {key}": value for key, value in alike(content(file)).items()}
    return values


def alike(value: Any) -> Any:
    """Return a value without what is expected to differ."""
    if isinstance(value, dict):
        return {key: alike(item) for key, item in value.items() if key not in UNLIKE}
    return [alike(item) for item in value] if isinstance(value, list) else value


def content(file: Path) -> dict[str, Any]:
    """Return what a file of results holds, nothing of pictures and pages."""
    if file.suffix == ".npz":
        with np.load(file) as arrays:
            return {key: arrays[key].tolist() for key in arrays}
    if file.suffix == ".json":
        values = json.loads(file.read_text())
        return values if isinstance(values, dict) else {"values": values}
    if file.suffix == ".toml":
        return tomllib.loads(file.read_text())
    if file.suffix == ".csv":
        with file.open(newline="") as stream:
            heads, *rows = csv.reader(stream)
        return {head: [row[k] for row in rows] for k, head in enumerate(heads)}
    return {}


def renamed(key: str) -> str:
    """Return the name in NEW of a key of OLD."""
    for old, new in RENAMED.items():
        key = re.sub(rf"(?<![\w-]){re.escape(old)}(?![\w-])", new, key)
    return key


def removed(key: str) -> bool:
    return any(re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", key) for name in REMOVED)


def numbers(value: object) -> object:
    """Return the numbers of a value with all their digits, in order, without the words between them."""
    if isinstance(value, dict):
        return {key: numbers(item) for key, item in value.items()}
    if isinstance(value, list):
        return [numbers(item) for item in value]
    if isinstance(value, str):
        return re.findall(r"[-+]?\d[\d.]*(?:e[-+]?\d+)?|\bnan\b|\binf\b", value)
    return repr(value)


def first_difference(before: object, after: object) -> str:
    """Return the first difference of two values, with where it is in them."""
    if isinstance(before, list) and isinstance(after, list) and len(before) == len(after):
        k = next(k for k in range(len(before)) if before[k] != after[k])
        return f"[{k}]{first_difference(before[k], after[k])}"
    if isinstance(before, dict) and isinstance(after, dict):
        key = next(key for key in before | after if before.get(key) != after.get(key))
        return f"[{key}]{first_difference(before.get(key), after.get(key))}"
    return f" {str(before)[:300]} -> {str(after)[:300]}"


def compared(name: str, before: dict[str, Any], after: dict[str, Any]) -> bool:
    """Print how two results compare; return whether all numbers are equal."""
    before = {renamed(key): value for key, value in before.items() if not removed(key)}
    keys = list(before | after)
    unlike = [key for key in keys if numbers(before.get(key)) != numbers(after.get(key))]
    words = [key for key in keys if key not in unlike and repr(before.get(key)) != repr(after.get(key))]
    print(f"{name}: {len(keys) - len(unlike)} of {len(keys)} entries equal", flush=True)
    for key in unlike:
        print(f"    differs: {key}: {first_difference(numbers(before.get(key)), numbers(after.get(key)))}")
    if words:
        print(f"    equal but for words: {words}")
    return not unlike


def main(old: Path, new: Path, names: list[str]) -> int:
    """Compare; return the number of pieces of work whose numbers differ."""
    jobs = sorted(file.stem for file in (old / "gantrysim/jobs").glob("*.toml"))
    differ = 0
    with tempfile.TemporaryDirectory() as scratch:
        for name in names or [*jobs, *COMMANDS, *PROBES]:
            before = written(old, name, Path(scratch) / f"{name}-old")
            after = written(new, name, Path(scratch) / f"{name}-new")
            differ += not compared(name, before, after)
    return differ


if __name__ == "__main__":
    if sys.argv[1] == "--probe":
        PROBES[sys.argv[2]](Path(sys.argv[3]))
        sys.exit()
    folders = [Path(folder).resolve() for folder in sys.argv[1:3]]
    sys.exit(bool(main(folders[0], folders[1], sys.argv[3:])))
