"""The error budget: parts that add up, for links with known errors."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import Job, Servo, simulate
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.engine.simulate import perfect_follower
from gantrysim.metrics.analysis import Analysis
from gantrysim.metrics.budget import CORNER, DESCRIPTIONS, GEOMETRY, LINKS, Budget
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Coil, Line
from gantrysim.paths.spirals import Involute
from gantrysim.record.run_file import Fault
from gantrysim.record.setpoints import Setpoints

from support.jobs import job_run
from support.links import record
from support.runs import PERIOD, plain
from support.soaked import examples, of_jobs

SUM = 1e-12  # of the parts against the whole [mm]
EXACT = 1e-9  # [mm]
SECOND_ORDER = 0.02  # of kappa l^2 / 2, relative
DEFLECTION = 0.01  # of a steady circle, relative
UNIFORM = 0.1  # rms of rounding to counts against q / sqrt(12), relative

INVOLUTE = Involute(60, 10, 4)
CIRCLE = ArcChain((40.0, 0.0), math.pi / 2, [1 / 40], [2 * math.pi * 40])
CONE = Chain([Coil((0, 0, 0), (40, 10), 0.3, 8 * math.pi, 24)])


def budget(run):
    return Budget(Analysis(run))


def inner(path, count=2001, edge=1.0):
    """Arc lengths without the path's ends, where an error along the path is a distance from the end."""
    return np.linspace(edge, path.length - edge, count)


def wave(s, amplitude, count):
    return amplitude * np.sin(2 * np.pi * count * np.linspace(0, 1, len(s)))[:, None]


@pytest.mark.parametrize("path", [INVOLUTE, CIRCLE, CONE], ids=["involute", "circle", "cone"])
def test_errors_along_the_normal_are_attributed_to_their_links(path):
    """Exactly, as the normal of a plane curve and of its parallels is the same."""
    s = inner(path)
    normal = path.normal(s)
    sizes = {"commanded": 0.3, "encoder": 0.05, "motor": 0.002, "nozzle": 0.01}
    offsets = {name: wave(s, size, k + 2) for k, (name, size) in enumerate(sizes.items())}
    found = budget(record(path, s, **{name: offset * normal for name, offset in offsets.items()}))
    exact = EXACT if path is not CONE else 2e-4  # a conical spiral's normal plane turns about its tangent
    for link, offset in zip(LINKS, offsets.values(), strict=True):
        assert found.parts[link].lateral == pytest.approx(offset[:, 0], abs=exact)
        assert found.parts[link].vertical == pytest.approx(np.zeros(len(s)), abs=exact)
    assert found.lag == pytest.approx(np.zeros(len(s)), abs=1e3 * exact)


@pytest.mark.parametrize("path", [INVOLUTE, CONE], ids=["involute", "cone"])
def test_errors_along_the_binormal_are_vertical(path):
    s = inner(path)
    up = np.cross(path.tangent(s), path.normal(s))
    found = budget(record(path, s, encoder=wave(s, 0.02, 3) * up, nozzle=-0.005 * up))
    exact = EXACT if path is INVOLUTE else 2e-5  # the binormal of a path that climbs turns with it
    assert found.parts["servo"].vertical == pytest.approx(wave(s, 0.02, 3)[:, 0], abs=exact)
    assert found.parts["structure"].vertical == pytest.approx(np.full(len(s), -0.005), abs=exact)
    assert found.parts["servo"].lateral == pytest.approx(np.zeros(len(s)), abs=exact)
    assert found.values.contour.max == pytest.approx(0.025, abs=exact)


def test_a_lag_along_the_path_is_no_error_normal_to_it():
    s, lag = inner(INVOLUTE), 0.4
    behind = INVOLUTE.position(s - lag) - INVOLUTE.position(s)
    found = budget(record(INVOLUTE, s, encoder=behind))
    assert found.lag == pytest.approx(np.full(len(s), lag), abs=EXACT)
    for part in found.parts.values():
        assert part.size.max() < EXACT
    assert found.values.lag.rms == pytest.approx(lag, abs=EXACT)


@pytest.mark.parametrize("lag", [0.1, 0.2, 0.8])
@pytest.mark.validates(
    "a part of the budget",
    "displacement along the normal, second order curvature × lag² / 2",
    "2 % of it",
)
def test_the_remainder_of_the_linear_identity_is_of_second_order(lag):
    """Off a circle of radius R along the tangent by l a point lies R - sqrt(R^2 + l^2) to the left: -kappa l^2 / 2."""
    s = inner(CIRCLE)
    tangent = CIRCLE.tangent(s)
    found = budget(record(CIRCLE, s, encoder=-lag * tangent))
    linear = np.zeros(len(s))  # the displacement has no share along the normal
    remainder = found.parts["servo"].lateral - linear
    assert remainder == pytest.approx(np.full(len(s), 40 - math.hypot(40, lag)), abs=EXACT)
    assert remainder == pytest.approx(np.full(len(s), -(lag**2) / 80), rel=SECOND_ORDER)


@given(st.floats(0, 2 * math.pi), st.floats(0.01, 0.4), st.sampled_from(["involute", "circle", "cone"]))
@examples(30)
def test_a_part_is_the_displacement_along_the_normal_but_for_second_order(direction, size, name):
    path = {"involute": INVOLUTE, "circle": CIRCLE, "cone": CONE}[name]
    s = inner(path, 301)
    normal, tangent = path.normal(s), path.tangent(s)
    up = np.cross(tangent, normal)
    remainders = []
    for scale in (size, 0.5 * size):
        shift = scale * (math.cos(direction) * tangent + math.sin(direction) * (normal + up) / math.sqrt(2))
        part = budget(record(path, s, encoder=shift)).parts["servo"]
        linear = np.stack([np.sum(shift * normal, axis=1), np.sum(shift * up, axis=1)])
        remainders.append(np.hypot(*(np.stack([part.lateral, part.vertical]) - linear)))
        curvature = np.linalg.norm(np.gradient(tangent, s, axis=0), axis=1)
        assert np.all(remainders[-1] <= 1.5 * curvature * scale**2 + EXACT)
    assert np.all(remainders[1] <= 0.3 * remainders[0] + EXACT)  # a quarter, but for the third order


@pytest.mark.validates(
    "sum of the parts of the error budget, every job",
    "contour error",
    "1e-12 mm",
)
@pytest.mark.parametrize("name", of_jobs("an225", "delta-arc", "fanuc-conical", "stage-outline"))
def test_the_parts_of_every_job_add_up(name):
    run = job_run(name)
    analysis = Analysis(run)
    found = Budget(analysis)
    lateral = sum(part.lateral for part in found.parts.values())
    vertical = sum(part.vertical for part in found.parts.values())
    assert lateral == pytest.approx(analysis.nozzle.lateral, abs=SUM)
    # the nozzle's offset from its foot is normal to the path, but at ends and corners
    along = np.einsum("ij,ij->i", analysis.nozzle.offset, run.requested.tangent(analysis.nozzle.s))
    smooth = np.abs(along) < EXACT
    assert smooth.mean() > 0.97
    size = np.hypot(lateral, vertical)
    assert size[smooth] == pytest.approx(analysis.nozzle.distance[smooth], abs=2 * EXACT)
    values = found.values
    assert sum(part.share for part in values.parts.values()) == pytest.approx(1.0, abs=1e-9)
    assert list(values.parts) == list(LINKS)
    # reports show both: the budget's and the distances of the nozzle and of the command
    for error, part in (
        (analysis.values.contour, values.contour),
        (analysis.values.program, values.parts[LINKS[0]]),
    ):
        assert (part.rms, part.max) == pytest.approx((error.rms, error.max), abs=EXACT)
    if name != "delta-arc":  # its counts are of arms
        assert values.parts["encoder"].rms == pytest.approx(1e-3 / math.sqrt(12), rel=0.6)


@pytest.mark.validates(
    "encoder part of ideal and of real links",
    "0; counts / √12",
    "exact; 10 %",
)
def test_ideal_links_have_zero_parts_and_real_ones_do_not(rigid, xy):
    continuous, stepped = MoveSpiral(120, 4, 10, 100, loop_period=0), MoveSpiral(120, 4, 10, 100)
    machine = rigid()
    exact = budget(simulate(machine, plain(machine), continuous.setpoints(PERIOD))).parts
    assert exact["program"].size.max() < EXACT
    assert not exact["encoder"].size.any()
    assert exact["structure"].size.max() < EXACT
    assert exact["servo"].size.max() > 1e-3

    counted = budget(simulate(machine, Servo.derive(machine.axes, PERIOD), stepped.setpoints(PERIOD))).parts
    assert counted["program"].size.max() > 0.1
    assert counted["structure"].size.max() < EXACT
    measured = np.sqrt(np.mean(counted["encoder"].lateral ** 2))
    assert measured == pytest.approx(machine.axes[0].resolution / math.sqrt(12), rel=UNIFORM)
    assert (
        budget(simulate(xy, Servo.derive(xy.axes, PERIOD), stepped.setpoints(PERIOD))).parts["structure"].size.max()
        > 1e-4
    )

    followed = budget(perfect_follower(machine, stepped.setpoints(PERIOD))).parts
    assert followed["program"].size.max() > 0.1
    for link in LINKS[1:]:
        assert not followed[link].size.any()


@pytest.mark.validates(
    "structure part on a circle",
    "centrifugal force / stiffness",
    "1 %",
)
def test_structure_is_the_centrifugal_deflection_behind_the_motors(xy):
    """On a circle of radius R every axis' load is pushed outward by m v^2 / (R k) of the normal's share along it."""
    radius, speed = 40.0, 600.0
    path = ArcChain((radius, 0.0), math.pi / 2, [1 / radius], [6 * math.pi * radius])
    run = simulate(xy, plain(xy, integral_time=0.03), Setpoints.along(path, speed, PERIOD))
    mass = np.array([xy.model.body(body).subtreemass[0] for body in ("carriage", "bridge")])
    stiffness = np.array([xy.model.joint(flex).stiffness[0] for flex in ("x_flex", "y_flex")])
    analysis = Analysis(run)
    steady = analysis.nozzle.s > path.length / 3
    normal = path.normal(analysis.nozzle.s[steady])[:, :2]
    lateral = Budget(analysis).parts["structure"].lateral[steady]
    found = np.linalg.lstsq(normal**2, lateral, rcond=None)[0]
    assert -found == pytest.approx(mass * speed**2 / radius / stiffness, rel=DEFLECTION)  # kg mm/s2 / (N/m) is mm


def test_servo_by_axis_is_the_following_error_along_the_normal_on_a_gantry(xy):
    run = simulate(xy, Servo.derive(xy.axes, PERIOD), MoveSpiral(120, 4, 10, 100).setpoints(PERIOD))
    found = budget(run)
    normal = run.requested.normal(found.analysis.commanded.s)
    error = (run.encoder - run.commanded)[found.analysis.ticks]
    for a, part in enumerate(found.servo_by_axis(xy).values()):
        assert part.lateral == pytest.approx(error[:, a] * normal[:, a], abs=EXACT)
        assert np.abs(part.vertical).max() < EXACT


@pytest.mark.parametrize("name", ["fanuc-conical", "softmc-helical", "stage-outline"])
def test_servo_by_axis_adds_up_but_for_second_order(name):
    job = Job.load(name)
    found = budget(job.run())
    parts = found.servo_by_axis(job.built_machine)
    assert list(parts) == list(job.built_machine.axis_names)
    lag = found.analysis.commanded.s - found.analysis.encoder.s
    curvature = np.abs(found.analysis.run.requested.curvature(found.analysis.commanded.s))
    size = found.parts["servo"].size + np.abs(lag)
    smooth = (np.abs(found.lag) < 0.02) & (size < 0.03)  # off the corners
    assert smooth.mean() > 0.93
    for direction in ("lateral", "vertical"):
        whole = sum(getattr(part, direction) for part in parts.values())
        rest = np.abs(getattr(found.parts["servo"], direction) - whole)[smooth]
        # but at the joints of a helix' pieces, where the climb jumps
        assert np.mean(rest <= ((curvature + 0.02) * size**2)[smooth] + EXACT) > 0.99
    assert all(part.size.max() > 1e-5 for axis, part in parts.items() if axis != "r")
    assert "r" not in parts or parts["r"].size.max() < EXACT  # it turns the nozzle about its own tip


def test_a_link_that_offsets_another_has_a_negative_share():
    s = inner(INVOLUTE)
    normal = INVOLUTE.normal(s)
    values = budget(record(INVOLUTE, s, commanded=0.3 * normal, encoder=-0.1 * normal)).values
    assert values.contour.rms == pytest.approx(0.2, abs=EXACT)
    assert values.parts["program"].share == pytest.approx(1.5)
    assert values.parts["servo"].share == pytest.approx(-0.5)
    assert values.parts["structure"].share == 0
    # of parts that have nothing to do with each other each has its own mean square
    mixed = budget(record(INVOLUTE, s, commanded=wave(s, 0.3, 40) * normal, nozzle=wave(s, 0.4, 90) * normal)).values
    assert mixed.parts["program"].share == pytest.approx(0.36, abs=1e-3)
    assert mixed.parts["structure"].share == pytest.approx(0.64, abs=1e-3)
    nothing = budget(record(INVOLUTE, s)).values
    assert [part.share for part in nothing.parts.values()] == [0, 0, 0, 0]


def test_a_budget_prints_as_the_table_of_its_links():
    s = inner(INVOLUTE)
    normal = INVOLUTE.normal(s)
    run = record(INVOLUTE, s, commanded=0.3 * normal, encoder=-0.1 * normal, nozzle=-0.00001 * normal)
    title, header, *rows = str(Budget(run)).splitlines()
    assert title == "error normal to the requested path [µm]"
    assert header.split() == ["link", "rms", "95", "%", "max", "share"]
    assert [row.split(maxsplit=6) for row in rows] == [
        ["program", "300.0", "300.0", "300.0", "150.0", "%", "requested path to commanded"],
        ["servo", "100.0", "100.0", "100.0", "−50.0", "%", "commanded to encoder"],
        ["encoder", "0", "0", "0", "0", "%", "encoder to motor"],
        ["structure", "0", "0", "0", "0", "%", "motor to nozzle"],
        ["contour", "200.0", "200.0", "200.0", "100.0", "%", "requested path to nozzle"],
    ]
    assert max(map(len, rows)) < 80
    assert list(DESCRIPTIONS) == [*LINKS[:-1], GEOMETRY, LINKS[-1], CORNER, "contour"]
    # rows that few runs have
    assert DESCRIPTIONS[GEOMETRY] == "motor to true axes"
    assert DESCRIPTIONS[CORNER] == "change of leg of the path"
    frame = Budget(run).to_frame()
    assert list(frame.index) == [row.split()[0] for row in rows]
    assert list(frame.columns) == ["rms_um", "p95_um", "max_um", "share_percent"]
    assert frame.loc["servo"].tolist() == pytest.approx([100.0, 100.0, 100.0, -50.0], rel=1e-3)
    faulted = replace(run, fault=Fault("travel", "x", 1.0, 2.0, 1.0, "mm"))
    assert str(Budget(faulted)).startswith("error normal to the requested path [µm], until the fault\n")


def test_values_of_a_part_locate_its_maximum():
    s = inner(INVOLUTE, 4001)
    normal = INVOLUTE.normal(s)
    size = np.linspace(0.01, 0.02, len(s))[:, None]
    size[3000] = 0.05
    part = budget(record(INVOLUTE, s, commanded=0.1 * normal, encoder=size * normal)).values.parts["servo"]
    assert part.max == pytest.approx(0.05, abs=EXACT)
    assert part.p95 == pytest.approx(0.0195, abs=1e-5)
    assert part.s == pytest.approx(s[3000], abs=1e-6)
    assert part.time == pytest.approx(3000 * PERIOD)
    assert part.point == pytest.approx(tuple(INVOLUTE.position(s[3000])[0]), abs=1e-6)


def test_the_time_of_a_maximum_is_that_of_the_record(xy):
    """Of a run whose dispenser opens late and closes between: ticks of the analysis are not those of the record."""
    run = job_run("softmc-arc")
    budget = Budget(run)
    assert budget.analysis.ticks[0] > 100
    for part in (*budget.values.parts.values(), budget.values.contour):
        if part.rms > 1e-6:
            at = np.searchsorted(run.time, part.time)
            assert run.time[at] == part.time
            assert run.dispense[at]
    error = np.full(len(run.time), -1.0)
    error[budget.analysis.ticks] = budget.contour.size
    assert budget.values.contour.time == run.time[error.argmax()]


@pytest.mark.parametrize("clockwise", [True, False])
def test_turns_of_a_spiral(clockwise):
    path = Involute(60, 10, 4, clockwise=clockwise)
    s = np.linspace(0, path.length, 8001)
    ends = np.array([2 * np.pi * k * (60 - 5 * k) for k in range(5)])  # R phi - a phi^2 / 2
    turn = np.searchsorted(ends[1:-1], s, side="right")
    found = budget(record(path, s, commanded=0.01 * (turn + 1)[:, None] * path.normal(s)))
    values = found.values
    assert [turn.turn for turn in values.turns] == [1, 2, 3, 4]
    for k, turn in enumerate(values.turns):
        assert turn.parts["program"].rms == pytest.approx(0.01 * (k + 1), rel=1e-2)
        assert turn.parts["contour"].max == pytest.approx(0.01 * (k + 1), rel=1e-2)
        assert turn.parts["servo"].max < EXACT
        assert turn.s == pytest.approx((ends[k], ends[k + 1]), abs=0.2)


@pytest.mark.parametrize(("turns", "counted"), [(2.995, 3), (3.005, 3), (3.05, 4)])
def test_a_rest_of_a_turn_belongs_to_the_last(turns, counted):
    path = Involute(60, 10, turns)
    found = budget(record(path, np.linspace(0, path.length, 4001)))
    assert [turn.turn for turn in found.values.turns] == list(range(1, counted + 1))
    assert found.values.turns[-1].s[1] == pytest.approx(path.length, abs=EXACT)


def test_turns_are_those_of_the_stretch_that_turns_furthest_one_way():
    path = ArcChain((0, 0), 0.0, [0.0, 1 / 20, 0.0, -1 / 30], [50, 2.5 * 2 * math.pi * 20, 30, math.pi * 30])
    s = inner(path, 5001)
    found = budget(record(path, s, encoder=0.01 * path.normal(s)))
    assert [turn.name for turn in found.values.turns] == ["turn 1", "turn 2", "turn 3", "after"]
    assert found.turn[0] == 0  # a straight lead-in goes with the turning after it
    assert found.turn[-1] == -1
    assert found.values.turns[0].s[1] == pytest.approx(50 + 40 * math.pi, abs=0.2)


CORNERED = Chain(
    [Coil((0, 0, 0), (40, 40), 0, np.pi), Line((-40, 0, 0), (-30, 0, 0)), Coil((0, 0, 0), (30, 30), np.pi, np.pi)]
)


@pytest.mark.parametrize(
    "path", [CIRCLE, ArcChain((0, 0), 0.0, [0.0], [50.0]), CORNERED], ids=["circle", "line", "corners"]
)
def test_a_path_of_one_turn_or_none_has_no_values_by_turn(path):
    assert budget(record(path, np.linspace(0, path.length, 1001))).values.turns == ()
