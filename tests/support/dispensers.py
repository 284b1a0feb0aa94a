"""Measurements of dispensers that are made up without gantrysim: own formulas, quadrature and SciPy's integration."""

import math
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

FLUIDS = ("newtonian", "shear-thinning", "yield stress")
KINDS = ("valve", "jet", "volumetric", "piston")


class Dataset(NamedTuple):
    """Measurements as a table in text, and what is true of the dispenser.

    Attributes:
        text: comma-separated.
        truth: by key of a job.
    """

    text: str
    truth: dict[str, float]


class Fluid(NamedTuple):
    """Glue with the shear stress tau_y + K rate^n [Pa, Pa·s^n]."""

    consistency: float
    index: float
    yield_stress: float

    def rate(self, excess):
        """Shear rate under a stress that exceeds the yield stress by so much [1/s]."""
        return (excess / self.consistency) ** (1 / self.index)


@cache
def tube_flow(fluid, bore, length, pressure):
    """Flow through a tube [mm³/s] by the integral over its section; sizes in mm, pressure in kPa."""
    radius = 0.5e-3 * bore
    wall = 1e3 * pressure * radius / (2e-3 * length)
    if wall <= fluid.yield_stress:
        return 0.0
    # from the yield surface outwards, over the stress beyond the yield stress: where the wall's is a rounding above it,
    # the integrand would have no digits left after a subtraction
    tau_y = fluid.yield_stress
    integral = quad(lambda excess: (tau_y + excess) ** 2 * fluid.rate(excess), 0.0, wall - tau_y, epsrel=1e-10)[0]
    return 1e9 * math.pi * radius**3 / wall**3 * integral


def tube_pressure(fluid, bore, length, flow):
    """Pressure for a flow, the inverse of `tube_flow` [kPa]."""
    low = fluid.yield_stress * 4 * length / bore * 1e-3
    high = max(2 * low, 1.0)
    while tube_flow(fluid, bore, length, high) < flow:
        high *= 2
    return brentq(lambda p: tube_flow(fluid, bore, length, p) - flow, low, high, rtol=1e-12)


def random_fluid(name, rng):
    if name == "newtonian":
        return Fluid(rng.uniform(0.5, 20.0), 1.0, 0.0)
    if name == "shear-thinning":
        return Fluid(rng.uniform(20.0, 150.0), rng.uniform(0.4, 0.7), 0.0)
    return Fluid(rng.uniform(10.0, 60.0), rng.uniform(0.5, 0.8), rng.uniform(80.0, 250.0))


def bead_width(area, gap, angle, face):
    """Width of a bead's section: a segment of a circle, cut at the gap by the face of the needle."""
    theta = math.radians(angle)
    segment = theta - math.sin(theta) * math.cos(theta)  # area over radius squared
    radius = math.sqrt(area / segment)
    if radius * (1 - math.cos(theta)) <= gap:
        return 2 * radius * math.sin(theta)
    at_gap = gap / (1 - math.cos(theta))
    flat = (area - segment * at_gap**2) / gap
    if flat > face:
        at_gap = math.sqrt((area - face * gap) / segment)
        flat = face
    return 2 * at_gap * math.sin(theta) + flat


def table(rows):
    """Comma-separated text of rows, which are dicts by head; empty cells where a row has none."""
    heads = list(dict.fromkeys(head for row in rows for head in row))
    lines = [",".join(heads)]
    lines += [",".join(row.get(head, "") for head in heads) for row in rows]
    return "\n".join(lines) + "\n"


def noisy(rng, value, share, digits):
    return f"{value * (1 + share * rng.standard_normal()):.{digits}f}"


def first_order(times, switched_on, switched_off, lag):
    """State of a lag from rest towards 1, (n,): on and off at two times, with one time constant for each."""
    opening, closing = lag

    def change(t, y):
        target = 1.0 if switched_on <= t < switched_off else 0.0
        return (target - y) / (opening if target > y[0] else closing)

    stops = [0.0, switched_on, switched_off, times[-1]]
    states = np.zeros(times.size)
    y = 0.0
    for begin, end in pairwise(stops):
        inside = (times >= begin) & (times <= end)
        solution = solve_ivp(
            change, (begin, end - 1e-12), [y], t_eval=np.clip(times[inside], begin, end - 1e-12), rtol=1e-9, atol=1e-12
        )
        states[inside] = solution.y[0]
        y = float(solve_ivp(change, (begin, end - 1e-12), [y], rtol=1e-9, atol=1e-12).y[0, -1])
    return states


def valve_data(fluid, rng):
    """A time-pressure valve: weighings, dots, a record of the flow, and beads."""
    bore, length, outer = [(0.84, 25.4, 1.27), (0.61, 12.7, 0.91), (0.51, 12.7, 0.82)][rng.integers(3)]
    density = rng.uniform(1.0, 1.6)
    rates = (20.0, 400.0) if fluid.yield_stress == 0 else (3.0, 400.0)
    stress = [fluid.yield_stress + fluid.consistency * rate**fluid.index for rate in rates]
    ends = [4e-3 * length / bore * s for s in stress]
    pressures = np.round(np.geomspace(*ends, 10), 1)
    opening, closing = rng.uniform(0.01, 0.05, 2)
    dead, closing_dead = rng.uniform(0.004, 0.02, 2)
    angle = rng.uniform(40.0, 85.0)
    common = {"density [g/cm3]": f"{density:.6f}", "bore [mm]": f"{bore}", "length [mm]": f"{length}"}
    common["outer [mm]"] = f"{outer}"
    rows = []
    for pressure in pressures.tolist():
        flow = tube_flow(fluid, bore, length, pressure)
        time = round(min(max(100.0 / flow, 5.0), 120.0))
        mass = noisy(rng, density * flow * time, 0.01, 1)
        rows.append({**common, "pressure [kPa]": f"{pressure}", "time [s]": f"{time}", "mass [mg]": mass})
    pressure = float(pressures[7])
    flow = tube_flow(fluid, bore, length, pressure)

    def flow_at(share):
        return tube_flow(fluid, bore, length, round(pressure * share, 9)) if share > 0 else 0.0

    shares = np.linspace(0, 1, 401)
    curve = np.array([flow_at(float(share)) for share in shares])

    def flows(state):
        return np.interp(state, shares, curve)

    fine = np.linspace(0, 1.6, 16001)
    for open_for in (0.05, 0.08, 0.12, 0.2, 0.3, 0.5):
        state = first_order(fine, 0.1 + dead, 0.1 + open_for + closing_dead, (opening, closing))
        volume = float(np.trapezoid(flows(state), fine))
        mass = noisy(rng, density * volume * 20, 0.01, 2)
        dots = {"open time [ms]": f"{1e3 * open_for:.0f}", "dots": "20", "mass [mg]": mass}
        rows.append({**common, "pressure [kPa]": f"{pressure}", **dots})
    times = np.arange(0, 1.2, 0.004)
    # between two rows, of which the later one has the new command
    state = first_order(times, 0.302 + 0.004 * (rng.random() - 0.5) + dead, 0.802 + closing_dead, (opening, closing))
    for time, value in zip(times.tolist(), flows(state).tolist(), strict=True):
        reading = value + 0.01 * flow * rng.standard_normal()
        command = "1" if 0.302 < time < 0.802 else "0"
        record = {"time [s]": f"{time:.4f}", "command": command, "flow [mm3/s]": f"{reading:.5f}"}
        rows.append({**common, "pressure [kPa]": f"{pressure}", **record})
    gap = round(0.8 * bore, 2)
    for area in (0.5, 0.8, 1.2, 1.8, 2.5):
        speed = flow / (area * bore * gap)
        width = bead_width(flow / round(speed, 3), gap, angle, outer)
        bead = {"speed [mm/s]": f"{speed:.3f}", "gap [mm]": f"{gap}", "width [mm]": noisy(rng, width, 0.01, 3)}
        rows.append({**common, "pressure [kPa]": f"{pressure}", **bead})
    truth = {
        "needle.consistency": fluid.consistency,
        "needle.index": fluid.index,
        "needle.yield_stress": fluid.yield_stress,
        "dead_time": dead,
        "closing_dead_time": closing_dead,
        "opening": opening,
        "closing": closing,
        "contact_angle": angle,
    }
    return Dataset(table(rows), truth)


def jet_data(fluid, rng):
    """A jet: weighings of counted drops, whatever the glue."""
    drop = rng.uniform(0.005, 0.1)
    density = rng.uniform(1.0, 1.6)
    counts = (200, 400, 600, 800, 1000)
    rows = [
        {
            "density [g/cm3]": f"{density:.6f}",
            "drops": f"{count}",
            "mass [mg]": noisy(rng, density * drop * count, 0.01, 2),
        }
        for count in counts
    ]
    return Dataset(table(rows), {"jet.drop": drop})


def driven_data(fluid, rng, kind):
    """A pump with slip, or a piston: weighings with a pressure gauge at several speeds, and a record of steps."""
    is_pump = kind == "volumetric"
    density = rng.uniform(1.0, 1.6)
    bore = float(rng.choice([0.61, 0.84]))
    lengths = (12.7, 38.1) if is_pump else (25.4,)
    displacement = rng.uniform(5.0, 40.0)  # of a revolution, or a millimetre
    plunger = 2 * math.sqrt(displacement / math.pi)
    usual = bore**3 * math.pi / 32 * 60.0  # flow at a wall rate of 60 1/s
    back = tube_pressure(fluid, bore, lengths[-1], usual)
    leak = float(rng.uniform(0.03, 0.15)) * usual / back if is_pump else 0.0
    rows = []

    def settled(speed, length):
        def excess(flow):
            return flow + leak * tube_pressure(fluid, bore, length, flow) - displacement * speed

        flow = brentq(excess, 1e-9 * displacement * speed, displacement * speed, rtol=1e-12)
        return flow, tube_pressure(fluid, bore, length, flow)

    common = {"density [g/cm3]": f"{density:.6f}", "bore [mm]": f"{bore}"}
    driver = "pump speed [rpm]" if is_pump else "plunger speed [mm/s]"
    factor = 60.0 if is_pump else 1.0
    for length in lengths:
        for share in np.geomspace(0.05, 5.0, 7).tolist():
            speed = round(share * usual / displacement * factor, 4) / factor
            flow, pressure = settled(speed, length)
            time = round(max(200.0 / flow, 5.0))
            reading = {"time [s]": f"{time}", "mass [mg]": noisy(rng, density * flow * time, 0.01, 1)}
            reading["pressure [kPa]"] = noisy(rng, pressure, 0.01, 2)
            rows.append({**common, "length [mm]": f"{length}", driver: f"{speed * factor:.4f}", **reading})
    length = lengths[0]
    speed = round(usual / displacement * factor, 4) / factor
    flow, pressure = settled(speed, length)
    lag = rng.uniform(0.05, 0.2)
    compliance = lag * flow / pressure
    grid = np.linspace(0, 1.6 * pressure, 401)
    curve = np.array([tube_flow(fluid, bore, length, round(float(p), 9)) for p in grid])

    def change(_, p, rate):
        return (rate - leak * p - np.interp(p, grid, curve)) / compliance

    times = np.arange(0, 3.0, 0.01)
    states = np.zeros(times.size)
    level = 0.0
    for begin, end, rate in ((0.0, 0.245, 0.0), (0.245, 1.745, displacement * speed), (1.745, 3.0, 0.0)):
        inside = (times >= begin) & (times < end)
        ends = np.append(times[inside], end)
        solution = solve_ivp(change, (begin, end), [level], "RK45", ends, args=(rate,), rtol=1e-8, max_step=0.01)
        states[inside] = solution.y[0, :-1]
        level = float(solution.y[0, -1])
    for time, value in zip(times.tolist(), np.interp(states, grid, curve).tolist(), strict=True):
        reading = value + 0.01 * flow * rng.standard_normal()
        is_on = 0.245 < time < 1.745
        record = {"time [s]": f"{time:.4f}", driver: f"{speed * factor * is_on:.4f}", "flow [mm3/s]": f"{reading:.5f}"}
        rows.append({**common, "length [mm]": f"{length}", **record})
    truth = {
        "needle.consistency": fluid.consistency,
        "needle.index": fluid.index,
        "needle.yield_stress": fluid.yield_stress,
    }
    if is_pump:
        truth |= {"pump.displacement": displacement, "pump.leak": leak, "pump.compliance": compliance}
    else:
        truth |= {"piston.plunger": plunger, "piston.compliance": compliance}
    return Dataset(table(rows), truth)


def dispenser_data(kind, fluid, seed):
    """Measurements of a dispenser of a kind with a glue, the same for the same seed."""
    rng = np.random.default_rng([KINDS.index(kind), FLUIDS.index(fluid), seed])
    glue = random_fluid(fluid, rng)
    if kind == "valve":
        return valve_data(glue, rng)
    if kind == "jet":
        return jet_data(glue, rng)
    return driven_data(glue, rng, kind)
