"""Memory of a large program, per line and per tick, and that its blocks are the whole."""

import math
import tracemalloc

import numpy as np
import pytest

from gantrysim import Machine
from gantrysim.base import memory
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.job.plan import plan_of
from gantrysim.job.program_place import _box, _heights

LINES = 20_000
PER_FEED = 330.0  # [B] beside the plan, at the peak of finding the extruder's course
PER_LINE = 700.0  # [B] at the peak of planning; a million lines with interpreter and libraries are within 1 GB
PER_TICK = 16.0  # [B]; a position of three axes alone has 24


def rings(lines):
    """Rings of short lines as slicers write them, 0.4 mm each, with a dry move between them."""
    text = ["M83", "G1 Z0.3 F600"]
    ring = 0
    while len(text) < lines:
        radius = 20 + 15 * math.sin(0.37 * ring)
        count = int(2 * math.pi * radius / 0.4)
        text.append(f"G1 X{radius:.3f} Y0 F9000")
        turn = 2 * math.pi / count
        for k in range(1, count + 1):
            bulge = radius + 0.5 * math.sin(9 * k * turn)
            x = bulge * math.cos(k * turn)
            y = bulge * math.sin(k * turn)
            text.append(f"G1 X{x:.3f} Y{y:.3f} E0.0133{' F1800' if k == 1 else ''}")
        ring += 1
    return "\n".join(text[:lines])


@pytest.fixture(scope="module")
def measured():
    """A large program, its setpoints, and the memory that planning and setpoints took at their peaks [B]."""
    Program(text=rings(50)).setpoints(1e-3)  # compiled, imported
    program = Program(text=rings(LINES))
    tracemalloc.start()
    _ = program.plan
    planning = tracemalloc.get_traced_memory()[1]
    plan = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    # of a program that is run, not of one that is only checked
    _ = program.extrusion
    feeding = tracemalloc.get_traced_memory()[1] - plan
    before = tracemalloc.get_traced_memory()[0]
    tracemalloc.reset_peak()
    setpoints = program.setpoints(1e-3)
    sending = tracemalloc.get_traced_memory()[1] - before
    tracemalloc.stop()
    return program, setpoints, planning, sending, feeding


def test_planning_takes_few_bytes_per_line(measured):
    _, _, planning, _, feeding = measured
    assert planning < PER_LINE * LINES
    assert feeding < PER_FEED * LINES


def test_the_setpoints_of_a_long_program_do_not_fill_the_memory(measured):
    _, setpoints, _, sending, _ = measured
    ticks = len(setpoints.position)
    assert ticks > memory.LONG_RUN
    assert sending < PER_TICK * ticks


def test_the_blocks_are_the_whole(measured):
    program, setpoints, _, _, _ = measured
    time = np.arange(len(setpoints.position)) * 1e-3
    time[-1] = program.duration
    place, dispense, progress = program.plan.at(time)
    assert np.array_equal(setpoints.position, place[:, : len(setpoints.axes)])
    assert np.array_equal(setpoints.dispense, dispense)
    assert np.array_equal(setpoints.progress, progress)
    assert np.array_equal(program.lines(1e-3), program.plan.lines(time))
    held = setpoints.wait(0.25).hold(0.5)
    before = np.repeat(place[:1], 250, axis=0)
    after = np.repeat(place[-1:], 500, axis=0)
    assert np.array_equal(held.position, np.concatenate([before, place, after]))
    assert np.array_equal(held.dispense, np.pad(dispense, (250, 500)))
    # what check prints, from all setpoints at once
    plan = plan_of(Machine("xyz"), "slicer", setpoints, program)
    ways = np.linalg.norm(np.diff(place, axis=0), axis=1)
    assert plan.way == pytest.approx(ways.sum(), rel=1e-12)
    assert plan.glue == pytest.approx(ways[dispense[:-1]].sum(), rel=1e-12)
    assert plan.box == pytest.approx(np.array([place.min(axis=0), place.max(axis=0)]), abs=1e-9)
    assert plan.speeds["x"].largest == pytest.approx(np.abs(np.diff(place[:, 0])).max() / 1e-3, rel=1e-9)
    # and what places the program
    assert _box(setpoints)["x"] == (place[:, 0].min(), place[:, 0].max())
    assert tuple(_heights(setpoints)) == (0.3, 0.3, 0.0)
