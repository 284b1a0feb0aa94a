"""Contributing, README and architecture name what is there, and what they say of extending the package holds."""

import ast
import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

import pytest

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


def imported_rooms(room):
    """Rooms that the modules of a room import."""
    rooms = set()
    for file in (PACKAGE / room).rglob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("gantrysim."):
                rooms.add(node.module.split(".")[1])
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

FAULT = '''

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
'''

EFFECT = """\
    for worn in (fault for fault in acting if isinstance(fault, WornNozzle)):
        flow = flow * (1 + (worn.factor - 1) * _overlap(worn, edges))
"""

JOB = """
name = "straight"
machine = "xy"

[program]
controller = "straight.Line"
length = 4.0

[dispenser]
flow = 2.0
"""

WORN = """
[[faults]]
kind = "worn nozzle"
time = 0.05
duration = 0.1
factor = 1.5
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
    "faults": [str(fault) for fault in runs[1].injected],
}))
"""


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


def test_a_controller_and_a_fault_are_added_as_the_architecture_says(fresh, tmp_path):
    """In a copy with the compiled code of the package, whose tick neither of the two changes."""
    copy = shutil.copytree(PACKAGE, tmp_path / "gantrysim", copy_function=_copied_if_there)
    architecture = " ".join(PAGES["docs/architecture.md"].split())
    assert "**A motion controller** is a folder in `controllers/`" in architecture
    (copy / "controllers" / "straight").mkdir()
    (copy / "controllers" / "straight" / "__init__.py").write_text(CONTROLLER, encoding="utf-8")
    registry = "PROGRAMS: dict[str, type[Controller]] = {\n"
    entry = '    "straight.Line": straight.Line,\n'
    edited(copy / "job" / "programs.py", registry, f"from gantrysim.controllers import straight\n{registry}{entry}")

    assert "**A fault on purpose** is a frozen dataclass in `faults/drive.py` or `faults/nozzle.py`" in architecture
    imported = "from gantrysim.faults.nozzle import WornNozzle\n"
    kinds = "AnyFault: TypeAlias = (\n"
    last_of_flow = "    return flow\n\n\ndef _overlap("
    append(copy / "faults" / "nozzle.py", FAULT)
    append(copy / "faults" / "__init__.py", imported)
    edited(copy / "faults" / "kinds.py", kinds, f"{imported}{kinds}    WornNozzle |\n")
    edited(copy / "engine" / "injection.py", "_SEIZED = ", f"{imported}_SEIZED = ")
    edited(copy / "engine" / "injection.py", last_of_flow, f"{EFFECT}{last_of_flow}")

    whole, worn = tmp_path / "whole.toml", tmp_path / "worn.toml"
    whole.write_text(JOB, encoding="utf-8")
    worn.write_text(JOB + WORN, encoding="utf-8")
    done = fresh.run(RUN, tmp_path, tmp_path, whole, worn)
    assert (done.status, done.error) == (0, "")
    shown = json.loads(done.output)
    assert Path(shown["package"]).parent == copy
    assert shown["end"] == pytest.approx([4.0, 4.0])
    assert shown["faults"] == ["worn nozzle at t = 0.0500 s: 1.5 times the flow for 0.1 s"]
    plain, more = shown["flow"]
    assert max(plain) > 0
    factors = [1.5 if 0.0495 < time < 0.1495 else 1.0 for time in shown["time"]]
    assert more == pytest.approx([flow * factor for flow, factor in zip(plain, factors, strict=True)])


def test_the_readme_names_every_room():
    missing = [room for room in ROOMS - {"jobs"} if f"[`{room}/`](gantrysim/{room})" not in PAGES["README.md"]]
    assert missing == []


def test_hooks_are_local_and_those_of_the_check():
    """A hook from elsewhere would bring another version of the tools, and needs the network."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    check = (ROOT / "scripts" / "test.sh").read_text(encoding="utf-8")
    assert re.findall(r"repo: (.*)", text) == ["local"]
    names = re.findall(r" name: (.*)", text)
    assert names == ["ruff check", "ruff format --check", "mypy"]
    for name in names:
        assert re.search(rf"^{name}\b", check, flags=re.MULTILINE), name
