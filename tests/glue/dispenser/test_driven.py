"""Driven dispensers against an independent ODE, closed forms and the conservation of volume."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import CubicSpline

from gantrysim import InputError
from gantrysim.controllers.gcode.slicer import Program
from gantrysim.glue.dispenser.command import Material
from gantrysim.glue.dispenser.dispenser import Dispenser
from gantrysim.glue.dispenser.driven import Motor
from gantrysim.glue.dispenser.needle import Needle
from gantrysim.glue.dispenser.piston import Piston
from gantrysim.glue.dispenser.volumetric import Pump
from gantrysim.job.job import Job

from support.soaked import examples, suite_runs

PERIOD = 1e-3
AREA = 0.8  # [mm²]
NEWTONIAN = Needle(bore=0.84, length=12.0, consistency=8.0, index=1.0)
ATMOSPHERE = 101.325  # [kPa]


def random_motion(seed, n=1200):
    """Return a command and a piecewise linear path speed, from rest to rest with a slow corner or two."""
    rng = np.random.default_rng(seed)
    knots = np.concatenate([[0.0], rng.uniform(5.0, 80.0, 10), [0.0]])
    speed = np.interp(np.arange(n) + 0.5, np.linspace(60, 800, knots.size), knots, 0.0, 0.0)
    on = np.zeros(n, bool)
    on[60:800] = True
    return on, np.where(on, speed, 0.0)


def needle_flow(needle):
    """Return the flow over pressure by quadrature of the shear rate over the wall stress (Rabinowitsch)."""
    radius = 0.5 * needle.inner

    def shear_rate(stress):
        return (max(stress - needle.yield_stress, 0.0) / needle.consistency) ** (1 / needle.index)

    def at(pressure):
        wall = 1e3 * pressure * radius / (2 * needle.length)
        if wall <= needle.yield_stress:
            return 0.0
        integral = quad(lambda s: s**2 * shear_rate(s), needle.yield_stress, wall, epsrel=1e-10)[0]
        return math.pi * radius**3 * integral / wall**3

    grid = np.concatenate([[0.0], np.geomspace(0.1, 3e4, 600)])
    grid = np.sort(np.append(grid, needle.yield_pressure * np.linspace(1.0, 1.5, 40)))
    spline = CubicSpline(np.unique(grid), [at(p) for p in np.unique(grid)])
    return lambda p: math.copysign(max(float(spline(abs(p))), 0.0), p)


def flow_by_ode(command, needle, compliance, leak=0.0, glue=0.0, modulus=math.inf):
    """Return the flow by solve_ivp: stored volume, volume displaced, and volume through the needle as its states."""
    through = needle_flow(needle)
    flow = np.zeros(command.size)
    gap = 0.0
    state = [0.0, 0.0, 0.0]
    for k, rate in enumerate(command):

        def slope(_, y, rate=rate):
            p = max(y[0] / (compliance + (glue - y[1]) / modulus), -ATMOSPHERE)
            out = through(p)
            return [rate - leak * p - out, rate, out]

        before = state[2]
        state = solve_ivp(slope, (0.0, PERIOD), state, "LSODA", rtol=1e-8, atol=1e-9).y[:, -1]
        laid = state[2] - before
        filled = max(min(gap, laid), 0.0) if laid > 0 else laid
        gap -= filled
        flow[k] = max(laid - filled, 0.0) / PERIOD
    return flow


FLUIDS = {
    "Newtonian": NEWTONIAN,
    "shear-thinning": Needle(bore=0.84, length=12.0, consistency=30.0, index=0.5),
    "yield stress": Needle(bore=0.84, length=12.0, consistency=40.0, index=0.6, yield_stress=120.0),
}


@pytest.mark.validates(
    "flow of a piston and of a pump with slip, over random speeds",
    "scipy's LSODA, needle by quadrature",
    "0.5 % of the largest flow, 0.1 % of the volume",
)
@pytest.mark.parametrize("seed", suite_runs([1, 2], 1))
@pytest.mark.parametrize("fluid", suite_runs(list(FLUIDS), 2))
@pytest.mark.parametrize("kind", ["piston", "volumetric"])
def test_the_flow_over_random_speeds_is_that_of_the_ode(kind, fluid, seed):
    needle = FLUIDS[fluid]
    on, speed = random_motion(seed)
    advance = 0.02 if seed == 2 else 0.0
    if kind == "piston":
        dispenser = Dispenser(
            area=AREA,
            kind=kind,
            needle=needle,
            advance=advance,
            piston=Piston(charge=5.0, compliance=0.02, bulk_modulus=300),
        )
        line = {"compliance": 0.02, "glue": 5000.0, "modulus": 3e5}
    else:
        dispenser = Dispenser(
            area=AREA, kind=kind, needle=needle, advance=advance, pump=Pump(leak=0.004, compliance=0.01)
        )
        line = {"compliance": 0.01, "leak": 0.004}
    request = AREA * speed
    command = request + advance * np.diff(request, prepend=0.0) / PERIOD
    expected = flow_by_ode(command, needle, **line)
    flow = dispenser.flows(on, speed, PERIOD)
    np.testing.assert_allclose(flow, expected, rtol=0, atol=0.005 * expected.max())
    assert flow.sum() == pytest.approx(expected.sum(), rel=1e-3)


@pytest.mark.parametrize("compliance", suite_runs([1e-6, 1e-4, 1e-3], 0))
def test_a_stiff_line_follows_its_motor(compliance):
    needle = FLUIDS["shear-thinning"]
    on, speed = random_motion(4, 900)
    piston = Piston(charge=math.inf, compliance=compliance)
    flow = Dispenser(area=AREA, kind="piston", needle=needle, piston=piston).flows(on, speed, PERIOD)
    expected = flow_by_ode(AREA * speed, needle, compliance)
    np.testing.assert_allclose(flow, expected, rtol=0, atol=0.005 * expected.max())


@examples(60)
@given(seed=st.integers(0, 10_000))
def test_no_more_flows_out_than_was_displaced_whatever_the_line(seed):
    rng = np.random.default_rng(seed)
    on, speed = random_motion(seed, 900)
    needle = Needle(
        bore=rng.uniform(0.1, 2.0),
        length=rng.uniform(1.0, 50.0),
        consistency=10 ** rng.uniform(-2, 3),
        index=rng.uniform(0.2, 1.8),
        yield_stress=rng.choice([0.0, 10 ** rng.uniform(-1, 3)]),
    )
    piston = Piston(
        plunger=rng.uniform(1.0, 20.0),
        charge=10 ** rng.uniform(-3, 1),
        compliance=10 ** rng.uniform(-6, 1),
        bulk_modulus=10 ** rng.uniform(0, 4),
        force=rng.choice([math.inf, 10 ** rng.uniform(0, 3)]),
    )
    dispenser = Dispenser(area=AREA, kind="piston", needle=needle, piston=piston, advance=rng.choice([0.0, 0.1]))
    flow = dispenser.flows(on, speed, PERIOD)
    pushed = np.maximum(dispenser.driven(on, speed, PERIOD, Material()).moved.rate, 0.0).sum()
    assert np.isfinite(flow).all()
    assert flow.min() >= 0
    assert flow.sum() <= pushed * (1 + 1e-6) + 1e-6


@pytest.mark.validates(
    "volume of a piston whose advance is its lag",
    "conservation of volume",
    "0.1 % with reversal; without it the clipped demand, 1e-6",
)
@pytest.mark.parametrize("lag", [0.02, 0.05, 0.1])
def test_an_advance_of_the_lag_adds_nothing_where_the_motor_reverses(lag):
    """A Newtonian glue has one lag, C / conductance."""
    on, speed = random_motion(3, 4000)
    piston = Piston(compliance=lag * NEWTONIAN.conductance, charge=math.inf)
    request = AREA * speed
    volume = request.sum() * PERIOD
    flows = {
        reverses: Dispenser(
            area=AREA, kind="piston", needle=NEWTONIAN, piston=piston, advance=lag, motor=Motor(reverses=reverses)
        ).flows(on, speed, PERIOD)
        for reverses in (True, False)
    }
    # the difference of the request is a step late, so that the end draws a little back into the needle
    assert flows[True].sum() * PERIOD == pytest.approx(volume, rel=1e-3)
    # the flow is late by one servo period, as the change of the request is known at its end
    assert np.abs(flows[True] - request).max() < 2 * np.abs(np.diff(request)).max()
    command = request + lag * np.diff(request, prepend=0.0) / PERIOD
    excess = np.maximum(-command, 0.0).sum() * PERIOD
    assert flows[False].sum() * PERIOD == pytest.approx(volume + excess, rel=1e-6)
    assert excess > 1.5e-3 * volume


def test_a_valve_says_what_the_clipped_advance_costs():
    on, speed = random_motion(3, 4000)
    valve = Dispenser(area=AREA, opening=0.05, closing=0.05, advance=0.05)
    volume = AREA * speed.sum() * PERIOD
    excess = valve.flows(on, speed, PERIOD).sum() * PERIOD - volume
    (note,) = valve.notes(on, speed, PERIOD)
    assert f"adds {excess:.3g} mm³, {100 * excess / volume:.3g} % to the program's volume" in note
    assert Dispenser(area=AREA, opening=0.05, closing=0.05).notes(on, speed, PERIOD) == ()


def test_a_job_s_notes_tell_what_its_advance_costs():
    job = Job.load(
        "slicer-square",
        {"dispenser.advance": 0.1, "dispenser.opening": 0.1, "dispenser.closing": 0.1, "simulation.settle": 2.0},
    )
    run = job.follow()
    excess = 100 * (run.flow.sum() / run.flow_demand.sum() - 1)
    assert excess > 5
    assert f"{excess:.3g} % to the program's volume" in job.notes[-1]


def test_a_pump_s_slip_is_the_leak_times_the_pressure():
    on = np.ones(2000, bool)
    speed = np.full(2000, 20.0)
    pump = Pump(leak=0.01, compliance=0.01)
    flow = Dispenser(area=AREA, kind="volumetric", needle=NEWTONIAN, pump=pump).flows(on, speed, PERIOD)
    conductance = NEWTONIAN.conductance
    assert flow[-1] == pytest.approx(AREA * 20 * conductance / (conductance + 0.01), rel=1e-9)


def test_a_motor_stalls_at_its_pressure_and_says_so_like_a_fault():
    on = np.ones(3000, bool)
    on[2000:] = False
    speed = np.where(on, 50.0, 0.0)
    limit = 0.5 * NEWTONIAN.pressure(AREA * 50)
    force = 5.0 + float(limit) * math.pi * 16**2 / 4 / 1e3
    piston = Piston(force=force, seal_friction=5.0, charge=math.inf, compliance=0.02)
    dispenser = Dispenser(area=AREA, kind="piston", needle=NEWTONIAN, piston=piston)
    flow = dispenser.flows(on, speed, PERIOD)
    assert flow.max() == pytest.approx(0.5 * AREA * 50, rel=1e-9)
    (note,) = dispenser.notes(on, speed, PERIOD)
    assert note.startswith("FAULT of the dispenser: its motor stalls at t = ")
    lost = (AREA * speed - flow).sum() * PERIOD
    assert f"{lost:.3g} mm³ of its stroke are lost" in note


def test_a_pump_s_torque_limits_its_pressure():
    """The work of a turn is torque times 2 pi, and pressure times displacement."""
    assert Pump(displacement=50.0, torque=0.1).limit == pytest.approx(2 * math.pi * 0.1 / 50e-9 / 1e3)


def test_a_motor_that_follows_e_makes_up_for_its_limits_and_one_that_follows_a_speed_does_not():
    on = np.zeros(1500, bool)
    on[100:600] = True
    speed = np.where(on, 50.0, 0.0)
    needle = NEWTONIAN
    motor = Motor(top_acceleration=200.0 / (math.pi * 64))  # 200 mm³/s²
    piston = Piston(charge=math.inf)
    by_speed = Dispenser(area=AREA, kind="piston", needle=needle, piston=piston, motor=motor)
    result = by_speed.driven(on, speed, PERIOD, Material())
    rate = result.moved.rate
    # a ramp up, the flow, and the same ramp down
    assert np.abs(np.diff(rate)).max() == pytest.approx(200 * PERIOD)
    assert rate.sum() * PERIOD == pytest.approx(AREA * speed.sum() * PERIOD, rel=1e-9)
    assert result.moved.behind == pytest.approx(0.5 * 40**2 / 200, rel=0.01)
    e = np.concatenate([[0.0], np.cumsum(AREA * speed[:-1] * PERIOD)]) / piston.unit
    by_e = Dispenser(kind="piston", needle=needle, piston=piston, motor=motor)
    moved = by_e.driven(on, speed, PERIOD, Material(e)).moved
    assert moved.rate.sum() * PERIOD == pytest.approx(AREA * speed.sum() * PERIOD, rel=1e-6)
    assert np.abs(np.diff(moved.rate)).max() <= 200 * PERIOD * (1 + 1e-9)
    assert moved.rate.max() > 40.0  # it catches up
    (note,) = by_e.notes(on, speed, PERIOD, Material(e))
    assert f"falls behind its command by up to {moved.behind:.3g} mm³" in note
    assert moved.behind == pytest.approx(0.5 * 40**2 / 200, rel=0.01)


def test_steps_of_a_motor_are_whole():
    on, speed = random_motion(5)
    dispenser = Dispenser(area=AREA, kind="piston", needle=NEWTONIAN, piston=Piston(), motor=Motor(step=1e-4))
    moved = np.cumsum(dispenser.driven(on, speed, PERIOD, Material()).moved.rate) * PERIOD
    steps = moved / (1e-4 * math.pi * 64)
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert moved[-1] == pytest.approx(AREA * speed.sum() * PERIOD, abs=0.5e-4 * math.pi * 64)


def test_a_retraction_draws_glue_back_which_is_replaced_before_more_is_laid():
    text = "M83\nG1 X20 E2 F1200\nG1 E-0.5 F600\nG4 P500\nG0 X40\nG1 E0.5 F600\nG1 X60 E2 F1200\nG1 E-0.5 F600"
    points = Program(text=text).setpoints(PERIOD).hold(1.0)
    material = Material(points.extrusion, points.extruder)
    unit = math.pi * 1.75**2 / 4
    piston = Piston(plunger=1.75, charge=math.inf, compliance=0.002)
    dispenser = Dispenser(kind="piston", needle=NEWTONIAN, piston=piston)
    flow = dispenser.flows(points.dispense, np.zeros(len(points.time)), PERIOD, material)
    # the last retraction leaves a gap in the needle of what was pulled back, less what was under pressure
    laid = flow.sum() * PERIOD
    assert laid == pytest.approx(4.0 * unit, rel=5e-3)
    x = points.position[:, 0]
    assert not flow[(x > 25) & (x < 39)].any()
    assert (flow >= 0).all()
    # without a reversing motor glue goes on flowing into the travel
    stiff = Dispenser(kind="piston", needle=NEWTONIAN, piston=piston, motor=Motor(reverses=False))
    oozing = stiff.flows(points.dispense, np.zeros(len(points.time)), PERIOD, material)
    assert oozing.sum() * PERIOD == pytest.approx(4.0 * unit, rel=1e-3)


def test_the_program_s_advance_takes_the_lag_off_an_extruder():
    """Corners slow the path down: with an advance of its lag the flow follows the speed there."""
    unit = math.pi * 1.75**2 / 4
    lag = 0.05
    piston = Piston(plunger=1.75, charge=math.inf, compliance=lag * NEWTONIAN.conductance)
    dispenser = Dispenser(kind="piston", needle=NEWTONIAN, piston=piston)
    square = "M83\nM204 S1000\nM205 X5 Y5\nG1 X40 E2 F3000\nG1 Y40 E2\nG1 X0 E2\nG1 Y0 E2"
    worst = {}
    for advance in (0.0, lag):
        points = Program(text=f"M900 K{advance}\n{square}").setpoints(PERIOD).hold(1.0)
        material = Material(points.extrusion, points.extruder)
        speed = np.zeros(len(points.time))
        flow = dispenser.flows(points.dispense, speed, PERIOD, material)
        demand = dispenser.flow_demand(points.dispense, speed, PERIOD, material)
        worst[advance] = np.abs(flow - demand).max() / demand.max()
        assert flow.sum() * PERIOD == pytest.approx(8 * unit, rel=1e-6)
    assert worst[0.0] > 0.3
    assert worst[lag] < 0.02


def test_a_plunger_ends_with_its_glue():
    on = np.ones(20_000, bool)
    speed = np.full(20_000, 50.0)
    piston = Piston(charge=0.05)
    dispenser = Dispenser(area=AREA, kind="piston", needle=NEWTONIAN, piston=piston)
    assert dispenser.flows(on, speed, PERIOD).sum() * PERIOD == pytest.approx(50.0, rel=1e-6)
    (note,) = dispenser.notes(on, speed, PERIOD)
    assert note == "the dispenser's plunger reaches its end at t = 1.25 s"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"kind": "gear"}, "kind of dispenser"),
        ({"kind": "piston"}, "dispenser of kind piston: needs a needle with its glue"),
        ({"motor": Motor()}, "dispenser.motor with kind = valve: must be with kind = volumetric or piston"),
        ({"kind": "piston", "needle": NEWTONIAN, "pump": Pump()}, "dispenser.pump with kind = piston"),
        ({"kind": "piston", "needle": NEWTONIAN, "opening": 0.1}, "dispenser.opening with kind = piston"),
    ],
)
def test_values_of_another_kind_are_refused(arguments, text):
    with pytest.raises(InputError, match=text):
        Dispenser(**arguments)


@pytest.mark.parametrize(
    ("kind", "arguments", "text"),
    [
        (
            Piston,
            {"force": 5.0, "seal_friction": 6.0},
            "5 N: must be above its seal_friction, 6 N",
        ),
        (Piston, {"plunger": 0.0}, "plunger of the piston = 0 mm: must be greater than 0"),
        (Pump, {"compliance": -1.0}, "compliance of the pump = -1 mm³/kPa: must be greater than 0"),
        (Motor, {"top_speed": 0.0}, "top_speed of the dispenser's motor = 0: must be greater than 0"),
    ],
)
def test_bad_values_are_refused(kind, arguments, text):
    with pytest.raises(InputError, match=text):
        kind(**arguments)


def test_a_motor_turns_back_no_faster_than_forwards():
    """A closing with an advance pulls back what was under pressure, at the motor's top speed."""
    on = np.zeros(600, bool)
    on[100:300] = True
    piston = Piston(charge=math.inf)
    motor = Motor(top_speed=60.0 / piston.unit)  # 60 mm³/s
    dispenser = Dispenser(area=AREA, kind="piston", needle=NEWTONIAN, piston=piston, motor=motor, advance=0.1)
    rate = dispenser.driven(on, np.where(on, 50.0, 0.0), PERIOD, Material()).moved.rate
    assert rate.max() == pytest.approx(60.0)
    assert rate.min() == pytest.approx(-60.0)


def test_what_flows_after_the_stop_is_stored_in_the_glue_that_is_left():
    """x = (C0 + V / B) p, with p = Q / C of the needle: 80 of 100 mm³ are displaced by then."""
    on = np.zeros(9000, bool)
    on[:2000] = True
    piston = Piston(charge=0.1, compliance=0.02, bulk_modulus=1.0)
    dispenser = Dispenser(area=AREA, kind="piston", needle=NEWTONIAN, piston=piston)
    flow = dispenser.flows(on, np.where(on, 50.0, 0.0), PERIOD)
    compliance = 0.02 + (100.0 - 80.0) / 1e3
    stored = compliance * flow[1999] / NEWTONIAN.conductance
    assert flow.sum() * PERIOD == pytest.approx(80.0, rel=1e-6)
    assert flow[2000:].sum() * PERIOD == pytest.approx(stored, rel=0.01)


def test_a_pump_s_slip_shortens_its_lag():
    """Of a Newtonian glue dx / (g p + Q), with x = C0 p, is C0 / (g + C) at every flow."""
    drive = Dispenser(area=AREA, kind="volumetric", needle=NEWTONIAN, pump=Pump(leak=0.05, compliance=0.01)).drive
    lag = 0.01 / (0.05 + NEWTONIAN.conductance)
    assert drive.lags(16.0) == pytest.approx((lag, lag), rel=1e-6)


def test_a_pump_that_stalls_leaks_and_drives_the_flow_of_its_limit():
    """Half the pressure of the flow is all that its torque holds: C p through the needle, g p back."""
    on = np.ones(3000, bool)
    limit = 0.5 * float(NEWTONIAN.pressure(AREA * 50))
    pump = Pump(displacement=50.0, torque=limit * 50.0 / (2e6 * math.pi), leak=0.02, compliance=0.01)
    dispenser = Dispenser(area=AREA, kind="volumetric", needle=NEWTONIAN, pump=pump)
    result = dispenser.driven(on, np.full(3000, 50.0), PERIOD, Material())
    assert result.out.pressure[-1] == pytest.approx(limit)
    assert result.out.flow[-1] == pytest.approx(NEWTONIAN.conductance * limit)
    assert result.out.lost[-1] == pytest.approx((AREA * 50 - (NEWTONIAN.conductance + 0.02) * limit) * PERIOD)
