"""Setpoints of every controller over programs that use each word of its language, in the folder programs."""

import tomllib
from pathlib import Path

import numpy as np

from gantrysim.job.programs import build

from support.drawings import arc, circle, dxf, group, line, polyline

FOLDER = Path(__file__).parent / "programs"
CONTROLLERS = {
    "linuxcnc": "linuxcnc.Program",
    "slicer": "slicer.Program",
    "fanuc": "fanuc.Program",
    "trio": "trio.Basic",
    "softmc": "softmc.Program",
    "stage": "stage.OutlineTrace",
    "drawings": "cad.Drawing",
}
PERIOD = 0.001
INSTANTS = 4  # between the first and the last tick


def dxf_text():
    """Each kind of entity that a drawing in DXF may have."""
    block = group((0, "BLOCK"), (8, "0"), (2, "TOOTH"), (70, 0), (10, 0.0), (20, 0.0), (30, 0.0), (3, "TOOTH"))
    block += line((0, 0), (4, 4)) + line((4, 4), (8, 0)) + group((0, "ENDBLK"), (8, "0"))
    insert = group((0, "INSERT"), (8, "WAY"), (2, "TOOTH"), (10, 60.0), (20, 5.0), (30, 0.0), (41, 2.0), (42, 2.0))
    insert += group((50, 90.0))
    ellipse = group(
        (0, "ELLIPSE"),
        (100, "AcDbEntity"),
        (8, "BEAD"),
        (100, "AcDbEllipse"),
        (10, 40.0),
        (20, 10.0),
        (30, 0.0),
        (11, 8.0),
        (21, 0.0),
        (31, 0.0),
    )
    ellipse += group((210, 0.0), (220, 0.0), (230, 1.0), (40, 0.5), (41, 0.0), (42, 3.141592653589793))
    spline = group(
        (0, "SPLINE"),
        (100, "AcDbEntity"),
        (8, "BEAD"),
        (100, "AcDbSpline"),
        (70, 8),
        (71, 3),
        (72, 8),
        (73, 4),
        (74, 0),
    )
    spline += group(*((40, value) for value in (0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0)))
    for x, y in ((0.0, 20.0), (5.0, 30.0), (15.0, 30.0), (20.0, 20.0)):
        spline += group((10, x), (20, y), (30, 0.0))
    entities = [
        line((0, 0), (20, 0), "BEAD"),
        line((20, 0), (20, 10), "BEAD"),
        circle((30.0, 10.0), 5.0, "WAY"),
        circle((10.0, 10.0), 3.0, "OTHER"),
        ellipse,
        spline,
        insert,
        group((0, "TEXT"), (8, "BEAD"), (10, 0.0), (20, 0.0), (30, 0.0), (40, 2.0), (1, "a mark")),
    ]
    # of an earlier version, without splines, the layers of newer entities are not read
    return dxf(*entities, blocks=block).replace("AC1009", "AC1015")


def dxf_bulges():
    return dxf(
        polyline([(0, 0, 0), (20, 0, 0.5), (20, 10, 0), (0, 10, -1)], closed=True), arc((30.0, 5.0), 5.0, 0, 180.0)
    )


def programs():
    """Arguments of every program, by dialect and name."""
    found = {}
    for dialect, controller in CONTROLLERS.items():
        content = tomllib.loads((FOLDER / f"{dialect}.toml").read_text(encoding="utf-8"))
        for name, table in content.items():
            found[f"{dialect} {name}"] = {"controller": controller, **table}
    drawing = found["drawings dxf"]
    drawing["text"] = dxf_text() if drawing.pop("dxf") else ""
    found["drawings dxf-bulges"] = {**found["drawings csv-lines"], "text": dxf_bulges()}
    return found


def switches(on):
    """Ticks at which a command goes on and off."""
    return np.flatnonzero(np.diff(on.astype(int), prepend=0, append=0)).tolist()


def answer(table):
    """What a program commands."""
    values = dict(table)
    controller = build(values.pop("controller"), values)
    setpoints = controller.setpoints(PERIOD)
    position = setpoints.position
    count = len(position)
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    ticks = np.linspace(0, count - 1, INSTANTS + 2).round().astype(int)[1:-1]
    later = np.minimum(ticks + 1, count - 1)
    requested = setpoints.requested
    found = {
        "axes": list(setpoints.axes),
        "ticks": count,
        "duration": controller.duration,
        "length": requested.length,
        "way": float(steps.sum()),
        "fastest": float(steps.max()) / PERIOD,
        "mean square speed": float(np.square(steps).mean()) / PERIOD**2,
        "end": position[-1],
        "high": position.max(axis=0),
        "on": switches(setpoints.dispense),
        "place": position[ticks],
        "velocity": (position[later] - position[ticks]) / PERIOD,
        "progress": None if setpoints.progress is None else setpoints.progress[ticks],
    }
    if setpoints.gates.size:
        found["gates"] = setpoints.gates
    for name, column in setpoints.material.items():
        found[name] = column[ticks]
    lines = getattr(controller, "line_at", None)
    if lines is not None:
        found["lines"] = [lines(PERIOD * tick) for tick in ticks.tolist()]
    printed = getattr(controller, "printed", ())
    if printed:
        found["printed"] = list(printed)
    found["notes"] = list(controller.notes)
    return found


CASES = {name: lambda table=table: answer(table) for name, table in programs().items()}
