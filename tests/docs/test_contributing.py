"""Contributing, README and architecture name what is there, and what they say of extending the package holds."""

import ast
import csv
import json
import re
import shutil
import tomllib
from contextlib import suppress
from pathlib import Path

import pytest

from support.syntax import nodes_of

ROOT = Path(__file__).parent.parent.parent
PACKAGE = ROOT / "gantrysim"
PAGES = {
    name: (ROOT / name).read_text(encoding="utf-8") for name in ("CONTRIBUTING.md", "README.md", "docs/architecture.md")
}
ROOMS = {init.parent.name for init in PACKAGE.glob("*/__init__.py")}
FILE = re.compile(r"[\w./-]*\w\.(?:css|html|lark|md|py|pyi|sh|toml|txt|xml|yaml)|[\w.-]+/(?:[\w.-]+/?)*")
FENCED = re.compile(r"^```.*?^```$", flags=re.DOTALL | re.MULTILINE)


def passages(page):
    """Rows of tables, items of lists and paragraphs: in each, a file may be named after its folder."""
    return re.split(r"\n\n|\n(?=[|-])", FENCED.sub("", page))


def named(passage):
    """Files and folders in a passage, without the texts of its links."""
    passage = re.sub(r"\[[^\]]*\]\([^)]*\)", "", passage)
    return [text for text in re.findall(r"`([^`\n]+)`", passage) if FILE.fullmatch(text)]


@pytest.mark.parametrize("name", PAGES)
def test_paths_that_are_named_exist(name):
    paths = 0
    for passage in passages(PAGES[name]):
        texts = named(passage)
        # a file without its folder lies in one that is named beside it
        folders = [PACKAGE / text if text.endswith("/") else (PACKAGE / text).parent for text in texts if "/" in text]
        for text in texts:
            paths += 1
            assert (
                (ROOT / text).exists()
                or (PACKAGE / text).exists()
                or any(list(folder.rglob(text)) for folder in folders if folder != PACKAGE)
            ), text
        for link in re.findall(r"\]\(([^)#]+)", passage):
            paths += 1
            assert ((ROOT / name).parent / link).exists(), link
    assert paths > 20


@pytest.mark.parametrize("name", PAGES)
def test_names_in_rooms_exist(name):
    for text in re.findall(r"`([a-z_]+(?:\.\w+)+)`", PAGES[name]):
        room, module, *names = text.split(".")
        if room not in ROOMS or FILE.fullmatch(text):
            continue
        file = PACKAGE / room / f"{module}.py"
        source = file.read_text(encoding="utf-8") if file.exists() else (PACKAGE / room / "__init__.py").read_text()
        for word in names if file.exists() else [module]:
            assert re.search(rf"\b{word}\b", source), text


def test_the_architecture_s_table_holds_every_room_once():
    rows = re.findall(r"^\| (`\w+/`(?:, `\w+/`)*) \|", PAGES["docs/architecture.md"], flags=re.MULTILINE)
    rooms = [room for row in rows for room in re.findall(r"`(\w+)/`", row)]
    assert sorted(rooms) == sorted(ROOMS - {"jobs", "models"})


def named_exceptions():
    """Imports that the contract of the rooms names as exceptions, in its own words."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    return set(next(found for found in contracts if found["type"] == "layers")["ignore_imports"])


def imported_rooms(room):
    """Rooms that the modules of a room import, but for the named exceptions."""
    rooms = set()
    exceptions = named_exceptions()
    for file in (PACKAGE / room).rglob("*.py"):
        module = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts)
        for node in nodes_of(file.read_text(encoding="utf-8")):
            imported = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
            if imported.startswith("gantrysim.") and f"{module} -> {imported}" not in exceptions:
                rooms.add(imported.split(".")[1])
    return rooms - {room}


def test_the_rooms_import_what_the_architecture_s_table_says():
    """A room also imports what lies below those that it names; rooms of one row may import each other."""
    above = {}
    for cell, listed in re.findall(r"^\| (`\w+/`.*?) \|.*\| ([^|]+) \|$", PAGES["docs/architecture.md"], re.MULTILINE):
        rooms = re.findall(r"`(\w+)/`", cell)
        names = set(above) if listed in ("all above", "everything") else set(re.findall(r"\w+", listed)) - {"nothing"}
        assert names <= set(above), f"{rooms} import rooms that stand below: {names - set(above)}"
        reached = names.union(rooms, *(above[name] for name in names))
        for room in rooms:
            assert imported_rooms(room) <= reached, room
            above[room] = reached
    assert set(above) == ROOMS - {"jobs", "models"}


def test_modules_that_use_the_factors_of_si_are_listed():
    _, _, listed = PAGES["docs/architecture.md"].partition("Values are converted wherever")
    listed = listed.partition("## One place each")[0]
    factors = re.compile(r"^from gantrysim\.(?:machine\.axis|design\.mjcf) import .*\b(?:PER_SI|M)\b", re.MULTILINE)
    using = [file for file in PACKAGE.rglob("*.py") if factors.search(file.read_text(encoding="utf-8"))]
    assert len(using) > 5
    for file in using:
        assert f"`{file.name}`" in listed or any(
            f"{place.relative_to(PACKAGE).as_posix()}{end}`" in listed
            for place, end in ((file, ""), (file.parent, "/"))
        ), file


CONTROLLER = '''"""A straight line."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from gantrysim.controllers.controller import Controller
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints


@dataclass(frozen=True)
class Line(Controller):
    """Moves along x at a constant speed.

    Args:
        length: of the line [mm].
        speed: path speed [mm/s].
    """

    length: float
    speed: float = 20.0

    @property
    def requested(self) -> ArcChain:
        return ArcChain((0.0, 0.0), 0.0, [0.0], [self.length])

    @property
    def duration(self) -> float:
        return self.length / self.speed

    @property
    def axes(self) -> tuple[str, ...]:
        return ("x", "y")

    def with_speeds(self, change: Callable[[float], float]) -> dict[str, Any]:
        return {"speed": change(self.speed)}

    def setpoints(self, period: float) -> Setpoints:
        return Setpoints.along(self.requested, self.speed, period)
'''

# for the end of a file: with the imports that the file may have already
FAULT = '''

from dataclasses import dataclass
from typing import Literal

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import at_least
from gantrysim.faults.fault import Lasting


@dataclass(frozen=True, kw_only=True)
class WornNozzle(Lasting):
    """The nozzle's bore is worn, and lets more glue through.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        factor: flow, relative to that of a new nozzle.
    """

    factor: float
    kind: Literal["worn nozzle"] = "worn nozzle"

    def _check(self) -> None:
        at_least("factor", self.factor, 1)

    @property
    def magnitude(self) -> str:
        return f"{self.factor:g} times the flow {self._span}"

    def flow_left(self, flow: Floats, valve: Floats, edges: Floats) -> Floats:
        return flow * (1 + (self.factor - 1) * self._shares(edges))
'''

TICK_FAULT = '''

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from gantrysim.faults.fault import REPORT, FaultAxis, Lasting, acts_at_tick


def read_too_far(row: Any, fault: Any) -> None:
    """Report a position that is too large by a distance."""
    if acts_at_tick(row, fault):
        row.seen[fault.axis] += fault.value


@dataclass(frozen=True, kw_only=True)
class DirtyScale(Lasting):
    """Dirt on the scale.

    Attributes:
        time: time at which it begins [s].
        duration: its length, by default until the end [s].
        axis: name of the axis.
        offset: by which it reads too far [mm or deg].
    """

    stages = ((REPORT, read_too_far),)

    axis: str
    offset: float
    kind: Literal["dirty scale"] = "dirty scale"

    @property
    def magnitude(self) -> str:
        return f"{self.offset:g} mm or deg too far {self._span}"

    def tick_value(self, axis: FaultAxis, axes: Sequence[FaultAxis]) -> float:
        return self.offset
'''

LAW = '''"""A constant torque, as against gravity."""

from __future__ import annotations

from typing import Any

from gantrysim.servo.laws.law import FEEDFORWARD, Law, LawDesign
from gantrysim.servo.gains import Parameter


def tick(row: Any, laws: Any) -> None:
    """Add the torque to the feed-forward."""
    for axis in range(row.axes):
        row.feedforward[axis] += laws[axis].bias_torque


class Bias(Law):
    """The law as one of the ladder. It has no linear model: it does not answer to a position."""

    name = "bias"
    meaning = "constant torque"
    parameters = (Parameter("bias_torque", "N·m", "torque that the law bias adds"),)
    stages = ((FEEDFORWARD, tick),)

    def derived(self, design: LawDesign) -> dict[str, float]:
        return {"bias_torque": 0.01}


BIAS = Bias()
'''

JOB = """
name = "straight"
machine = "xy"

[program]
controller = "straight.Line"
length = 4.0

[dispenser]
flow = 2.0
"""

CIRCLE = """
name = "circle"
machine = "xy"

[program]
controller = "fanuc.Program"
start = [0.0, 10.0, 0.0]
acceleration = 2000.0
program = '''
%
O0001
N10 G17 G21 G90
N20 G02 X0 Y10 I0 J-10 F6000
N30 M30
%
'''

[dispenser]
flow = 300.0

[simulation]
settle = 0.05
"""

WORN = """
[[faults]]
kind = "worn nozzle"
time = 0.05
duration = 0.1
factor = 1.5
"""

DIRTY = """
[[faults]]
kind = "dirty scale"
time = 0.05
axis = "x"
offset = 0.25
"""

BIASED = """
[servo]
law = ["pid", "bias"]
bias_torque = 0.02
"""

RUN = """
import json, sys
sys.path.insert(0, sys.argv[1])
import gantrysim
runs = [gantrysim.Job.load(file).run() for file in sys.argv[2:]]
print(json.dumps({
    "package": gantrysim.__file__,
    "end": [float(run.commanded[-1, 0]) for run in runs],
    "time": runs[0].time.tolist(),
    "flow": [run.flow.tolist() for run in runs],
    "encoder": [(run.encoder[:, 0] - run.motor[:, 0]).tolist() for run in runs],
    "demand": [run.demand[0].tolist() for run in runs],
    "faults": [str(fault) for run in runs for fault in run.injected],
}))
"""


STUDY = '''"""The pace study: duration and contour error over the path speed."""

from __future__ import annotations

from dataclasses import dataclass

from gantrysim.report.document import Table
from gantrysim.study.cases import Case, Row
from gantrysim.study.study import Report, Rounds, Study


@dataclass(frozen=True)
class PaceStudy(Study):
    """Duration and contour error at shares of the programmed speed.

    Args:
        shares: of the programmed speed.
    """

    shares: tuple[float, ...] = (0.5, 1.0)

    name = "pace"

    def rounds(self) -> Rounds:
        controller = self.job.controller
        cases = []
        for share in self.shares:
            arguments = controller.arguments_at(share * controller.programmed_speed)
            overrides = {f"program.{key}": value for key, value in arguments.items()}
            cases.append(Case.of(self.job, overrides, share=share))
        yield cases

    def report(self, rows: list[Row]) -> Report:
        table = Table(["share", "contour rms [µm]"], [[row["share"], row["contour_rms_um"]] for row in rows])
        return Report("How does the error grow with the speed?", f"{len(rows)} speeds.", table=table)
'''

COMMAND = '''

@study_app.command()
def pace(job: JobArgument = "an225", out: Out = None, workers: Workers = None) -> None:
    """Compare the contour error at shares of the programmed speed."""
    from gantrysim.job.job import Job
    from gantrysim.study.pace import PaceStudy

    carry_out(PaceStudy(Job.load(job)), out, workers, None)
'''

RUN_STUDY = """
import sys
import tomllib
sys.path.insert(0, sys.argv[1])
sys.argv = ["gantrysim", "study", "pace", sys.argv[2], "--out", sys.argv[3], "--workers", "1"]
from gantrysim.cli.start import main
main()
"""

TASK = '''"""FeedForward-v0: velocity feed-forward set at every decision."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.decision import Entry
from gantrysim.env.decision import Outcome
from gantrysim.env.scalar import PathEnv
from gantrysim.env.settings import PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.servo.gains import GAIN_NAMES


class FeedForwardBatch(EpisodeBatch):
    """Places in which episodes run whose velocity feed-forward the agent sets; arguments as of `EpisodeBatch`."""

    def _entries(self) -> list[Entry]:
        return [Entry("contour_rms", 0.0, 10.0, "tolerances", "RMS contour error of the last interval")]

    def _actions(self) -> list[Entry]:
        return [Entry("velocity_ff", -1.0, 1.0, "nominal", "change of the velocity feed-forward")]

    def observations(self) -> NDArray[np.float32]:
        return np.clip(self.measured.contour_rms[:, None] / self.settings.tolerance, 0.0, 10.0).astype(np.float32)

    def _act(self, places: Sequence[int]) -> None:
        nominal = np.array(self.source.servo.per_axis("velocity_ff"))
        self._gains[places, : self._axes, GAIN_NAMES.index("velocity_ff")] = nominal * (1 + self._action[places])

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        faulty, ended, _ = self._ends(advanced)
        return Outcome(-self.measured.contour_rms, terminated=faulty, truncated=ended, info={}, final={})


class FeedForwardEnv(PathEnv):
    """Set the velocity feed-forward while the nozzle follows a path."""

    settings_type = PathSettings

    @staticmethod
    def batch(settings: PathSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return FeedForwardBatch(settings, places, threads, ahead)


class FeedForwardVectorEnv(PathVectorEnv):
    """Several `FeedForwardEnv` in one."""

    single = FeedForwardEnv
'''

RUN_TASK = """
import json, sys
sys.path.insert(0, sys.argv[1])
import gymnasium, gantrysim.env
envs = gymnasium.make_vec("gantrysim/FeedForward-v0", num_envs=2, turns=1, diameter=40.0, thickness=6.0, spread=None)
envs.reset(seed=1)
rewards = 0.0
for _ in range(8):
    _, reward, terminated, truncated, _ = envs.step(envs.action_space.low * [[0.0], [1.0]])
    rewards = rewards + reward
env = gymnasium.make("gantrysim/FeedForward-v0", turns=1, diameter=40.0, thickness=6.0, spread=None)
env.reset(seed=1)
alone = sum(env.step(0 * env.action_space.low)[1] for _ in range(8))
print(json.dumps({"package": gantrysim.__file__, "vector": rewards.tolist(), "scalar": alone}))
"""


def touched(copy):
    """Files of a copy of the package that are new or changed."""
    return {
        file.relative_to(copy).as_posix()
        for file in copy.rglob("*.py*")
        if "__pycache__" not in file.parts
        and (
            not (PACKAGE / file.relative_to(copy)).exists()
            or file.read_bytes() != (PACKAGE / file.relative_to(copy)).read_bytes()
        )
    }


def append(file, text):
    file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")


def edited(file, old, new):
    text = file.read_text(encoding="utf-8")
    assert text.count(old) == 1, (file, old)
    file.write_text(text.replace(old, new), encoding="utf-8")


def _copied_if_there(source, target):
    """Copy a file, but for one that goes meanwhile: other tests write compiled code beside it under passing names."""
    with suppress(FileNotFoundError):
        shutil.copy2(source, target)


@pytest.fixture(scope="module")
def extended(tmp_path_factory):
    """A copy of the package with all additions: what it is compiled of is compiled anew, so there is one for all.

    Returns:
        The copy, and the files that are new or changed by each addition.
    """
    copy = shutil.copytree(PACKAGE, tmp_path_factory.mktemp("extended") / "gantrysim", copy_function=_copied_if_there)
    by_addition = {}
    before = set()
    for addition in (add_study, add_task, add_controller_law_and_faults):
        addition(copy)
        after = touched(copy)
        by_addition[addition] = after - before
        before = after
    return copy, by_addition


def add_controller_law_and_faults(copy):
    (copy / "controllers" / "straight").mkdir()
    (copy / "controllers" / "straight" / "__init__.py").write_text(CONTROLLER, encoding="utf-8")
    registry = "PROGRAMS = Programs(\n    {\n"
    entry = '        "straight.Line": ("controllers.straight", "Line"),\n'
    edited(copy / "job" / "programs.py", registry, f"{registry}{entry}")

    for part, fault in (("dispenser", FAULT), ("encoder", TICK_FAULT)):
        with (copy / "faults" / f"{part}.py").open("a", encoding="utf-8") as file:
            file.write(fault)
    imported = "from gantrysim.faults.dispenser import WornNozzle\nfrom gantrysim.faults.encoder import DirtyScale\n"
    kinds = "AnyFault: TypeAlias = (\n"
    edited(copy / "faults" / "__init__.py", kinds, f"{imported}{kinds}    WornNozzle | DirtyScale |\n")

    (copy / "servo" / "laws" / "bias.py").write_text(LAW, encoding="utf-8")
    laws = "LAWS: tuple[Law, ...] = ("
    imported = "from gantrysim.servo.laws.bias import BIAS\n"
    edited(copy / "servo" / "laws" / "__init__.py", laws, f"{imported}{laws}BIAS, ")


@pytest.mark.soak
def test_a_controller_a_law_and_faults_are_added_as_the_architecture_says(fresh, extended, tmp_path):
    """Each is its folder, its file or its class, and its line in a list."""
    copy, _ = extended
    architecture = " ".join(PAGES["docs/architecture.md"].split())
    assert "**A motion controller** is a folder in `controllers/`" in architecture
    assert "in the file of `faults/` that has the faults of its part of the machine" in architecture
    assert "**A law** is a file in `servo/laws/`" in architecture
    jobs = {"whole": JOB, "worn": JOB + WORN, "dirty": JOB + DIRTY, "biased": JOB + BIASED}
    for name, text in jobs.items():
        (tmp_path / f"{name}.toml").write_text(text, encoding="utf-8")
    done = fresh.run(RUN, tmp_path, copy.parent, *(tmp_path / f"{name}.toml" for name in jobs))
    assert (done.status, done.error) == (0, "")
    shown = json.loads(done.output)
    assert Path(shown["package"]).parent == copy
    assert shown["end"] == pytest.approx([4.0] * 4)
    assert shown["faults"] == [
        "worn nozzle at t = 0.0500 s: 1.5 times the flow for 0.1 s",
        "dirty scale on axis x at t = 0.0500 s: 0.25 mm or deg too far until the end",
    ]
    time = shown["time"]
    plain, worn, _, _ = shown["flow"]
    assert max(plain) > 0
    for moment, flow, worn_flow in zip(time, plain, worn, strict=True):
        assert worn_flow == pytest.approx(flow * (1.5 if 0.05 <= moment < 0.15 - 1e-9 else 1.0), rel=1e-9)
    counted, _, dirty, _ = shown["encoder"]
    for moment, sound, wrong in zip(time, counted, dirty, strict=True):
        offset = 0.25 if moment >= 0.05 - 1e-9 else 0.0
        assert wrong - offset == pytest.approx(0.0, abs=0.001)  # a count
        assert sound == pytest.approx(0.0, abs=0.001)
    at_rest, _, _, biased = shown["demand"]
    assert biased == pytest.approx([torque + 0.02 for torque in at_rest], abs=1e-12)


def add_study(copy):
    (copy / "study" / "pace.py").write_text(STUDY, encoding="utf-8")
    append(copy / "cli" / "study.py", COMMAND)


@pytest.mark.soak
def test_a_study_is_a_file_and_its_command(fresh, extended, tmp_path):
    copy, files = extended
    architecture = " ".join(PAGES["docs/architecture.md"].split())
    assert "**A study** is a file in `study/`" in architecture
    assert "| a study | 2 | its file in `study/`, its command in `cli/study.py`;" in PAGES["CONTRIBUTING.md"]
    assert files[add_study] == {"study/pace.py", "cli/study.py"}
    job = tmp_path / "circle.toml"
    job.write_text(CIRCLE, encoding="utf-8")
    done = fresh.run(RUN_STUDY, tmp_path, copy.parent, job, tmp_path / "out")
    assert done.status in (0, None), done.error
    assert "2 speeds." in done.output
    assert {file.name for file in (tmp_path / "out").iterdir()} >= {
        "study.csv",
        "study.toml",
        "job.toml",
        "report.html",
    }
    with (tmp_path / "out" / "study.csv").open(encoding="utf-8", newline="") as stream:
        slow, fast = csv.DictReader(stream)
    assert 1.8 < float(slow["duration_s"]) / float(fast["duration_s"]) < 2  # less than twice: the ramps are shorter


def add_task(copy):
    (copy / "env" / "feed_forward.py").write_text(TASK, encoding="utf-8")
    edited(copy / "env" / "registry.py", "TASKS = {\n", 'TASKS = {\n    "FeedForward-v0": "feed_forward",\n')


@pytest.mark.soak
def test_an_environment_task_is_a_file_and_its_line(fresh, extended, tmp_path):
    copy, files = extended
    architecture = " ".join(PAGES["docs/architecture.md"].split())
    assert "**A task for learning** is a file in `env/`" in architecture
    assert "| an environment task | 2 | its file in `env/`, its line in `env/registry.py`;" in PAGES["CONTRIBUTING.md"]
    assert files[add_task] == {"env/feed_forward.py", "env/registry.py"}
    done = fresh.run(RUN_TASK, tmp_path, copy.parent)
    assert (done.status, done.error) == (0, "")
    shown = json.loads(done.output)
    assert Path(shown["package"]).parent == copy
    nominal, without = shown["vector"]
    assert shown["scalar"] == nominal
    assert without < 1.5 * nominal < 0  # a reward is a loss: without feed-forward the nozzle cuts the turns


def test_hooks_are_local_and_those_of_the_check():
    """A hook from elsewhere would bring another version of the tools, and needs the network."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    check = (ROOT / "scripts" / "test.sh").read_text(encoding="utf-8")
    assert re.findall(r"repo: (.*)", text) == ["local"]
    names = re.findall(r" name: (.*)", text)
    assert names == ["ruff check", "ruff format --check", "mypy"]
    for name in names:
        assert re.search(rf"^{name}\b", check, flags=re.MULTILINE), name
