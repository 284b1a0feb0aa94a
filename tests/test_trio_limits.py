"""The Move Spiral within its controller's limits, against that controller stepped servo tick by servo tick.

Here the virtual axes move tick by tick, `DPOS_real += ratio * dDPOS_virtual` with a ratio of 16 fractional bits,
and a program acts at the ticks: nothing of the controller under test is used.
"""

import cmath
import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gantrysim.controllers.trio import MoveSpiral
from gantrysim.errors import InputError

POSITION = 1e-9  # of setpoints against the stepped controller, after some ten thousand ticks [mm]
RELATIVE = 1e-9
SPEED = 1e-6  # relative, of the path where no limit bites
# Stepped in whole ticks the virtual speed changes at ticks alone: its way differs by dv dt / 2 in a tick, and by
# V_max dt / 2 in all; seen by the real axes, at x V_max <= V, by half a tick's way. Held to a fifth more.
STEPPED = 0.6  # of a tick's way
TABLE = 5e-4  # what the note's figures leave open
WHOLE_MS = 0.001
NEVER_BELOW = 2.0**-16


def note(**changed):
    """The example of the note: D = 120 mm, 4 turns, thickness 10 mm, V = 100 mm/s, T = 0.1 s."""
    return MoveSpiral(**{"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, **changed})


def end_of(spiral):
    return complex(*spiral.generated.position(spiral.generated.length)[0, :2])


def places(setpoints):
    return setpoints.position[:, :2] @ [1, 1j]


@dataclass
class Controller:
    """The controller, servo tick by servo tick.

    `exact` has the virtual axis reach SPEED, and begin to brake, within a tick; without it the speed of a whole tick
    is that at its end, as a controller of whole ticks has it.
    """

    diameter: float
    turns: int
    thickness: float
    speed: float
    servo_period: float
    loop_period: float = 0.1
    interpreter_time: float = 0.0
    start: tuple = (0.0, 0.0)
    clockwise: bool = True
    acceleration: float = math.inf
    deceleration: float | None = None
    wait_resolution: float = 0.0
    ratio_bits: int | None = None
    as_published: bool = False
    exact: bool = True
    ratios: list = field(default_factory=list)
    due: list = field(default_factory=list)  # times at which the program is ready for each pass

    def run(self):
        dt, radius = self.servo_period, self.diameter / 2
        inner = self.diameter - 2 * self.turns * self.thickness
        change = (1 - inner / self.diameter) / (math.pi * self.diameter * self.turns / self.speed / self.loop_period)
        length = math.pi * self.diameter * (4 if self.as_published else self.turns)
        sense = -1 if self.clockwise else 1
        self.brake = self.acceleration if self.deceleration is None else self.deceleration
        self.way, self.velocity, self.stop = 0.0, 0.0, None
        place, x, awake, tick, halted = complex(*self.start), 1.0, 0.0, 0, False
        self.places, self.speeds, self.ways = [place], [0.0], [0.0]
        while self.way < length * (1 - 1e-12):
            while awake <= tick * dt * (1 + 1e-9) and not halted:
                if abs(x - change) < 1e-12 or (not self.as_published and x - change < 2**-16):
                    halted = True  # SPEED = V / 0 stops the listing; the corrected loop keeps its last x
                    break
                x -= change
                self.ratios.append(x)
                self.due.append(awake)
                wait = max(self.loop_period * x, 0.0)
                if self.wait_resolution:
                    wait = math.floor(round(wait / self.wait_resolution, 6)) * self.wait_resolution
                wait += self.interpreter_time
                awake += wait if wait > 0 else dt
            before = self.way
            self.step(dt, self.speed / abs(x), length)
            self.way = min(self.way, length)
            ratio = x if self.ratio_bits is None else round(x * 2**self.ratio_bits) / 2**self.ratio_bits
            circle = [sense * radius * cmath.exp(1j * sense * s / radius) for s in (before, self.way)]
            place += ratio * (circle[1] - circle[0])
            tick += 1
            self.places.append(place)
            self.speeds.append(self.velocity)
            self.ways.append(self.way)
        return self

    def step(self, dt, target, length):
        if not self.exact:
            self.step_whole(dt, target, length)
            return
        if self.stop is None:
            way, velocity = self.towards(dt, target)
            if velocity**2 <= 2 * self.brake * (length - way) and way < length:
                self.way, self.velocity = way, velocity
                return
            if math.isinf(self.brake):
                self.way = length
                return
            low, high = 0.0, dt  # the moment from which DECEL just suffices, by halving
            for _ in range(80):
                middle = 0.5 * (low + high)
                way, velocity = self.towards(middle, target)
                low, high = (middle, high) if velocity**2 <= 2 * self.brake * (length - way) else (low, middle)
            way, velocity = self.towards(low, target)
            velocity = min(velocity, math.sqrt(2 * self.brake * max(length - way, 0.0)))
            self.stop = low + velocity / self.brake
        self.stop -= dt
        self.way = length - 0.5 * self.brake * max(self.stop, 0.0) ** 2
        self.velocity = self.brake * max(self.stop, 0.0)

    def towards(self, dt, target):
        """Way and speed after a time at the SPEED `target`, in closed form."""
        v = self.velocity
        rate = self.acceleration if target > v else self.brake
        ramp = 0.0 if math.isinf(rate) else min(dt, abs(target - v) / rate)
        reached = target if ramp < dt or target == v else v + math.copysign(rate * ramp, target - v)
        return self.way + 0.5 * (v + reached) * ramp + reached * (dt - ramp), reached

    def step_whole(self, dt, target, length):
        low, high = self.velocity - self.brake * dt, self.velocity + self.acceleration * dt
        left = max(length - self.way, 0.0)
        # the largest speed v with v dt + v^2 / 2 d no more than is left
        stops = self.brake * (math.sqrt(dt**2 + 2 * left / self.brake) - dt)
        self.velocity = max(min(target, high, max(stops, low)), 1e-3 * self.brake * dt)
        self.way += self.velocity * dt


@st.composite
def jobs(draw, accelerated=True):
    """Arguments of a spiral that its controller's limits shape, without its ratio ever falling to zero."""
    diameter = draw(st.floats(20, 60))
    turns = draw(st.integers(1, 4))
    speed = draw(st.floats(30, 200))
    servo_period = draw(st.sampled_from([0.0005, 0.001, 0.002]))
    period = max(math.pi * diameter * turns / speed / draw(st.floats(15, 200)), 4 * servo_period)
    job = {
        "diameter": diameter,
        "turns": turns,
        "thickness": diameter * (1 - draw(st.floats(0.35, 0.95))) / (2 * turns),
        "speed": speed,
        "servo_period": servo_period,
        "loop_period": period,
        "interpreter_time": period * draw(st.sampled_from([0.0, 0.013, 0.1])),
        "start": draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50))),
        "clockwise": draw(st.booleans()),
        "wait_resolution": draw(st.sampled_from([0.0, WHOLE_MS])) if period > 20 * WHOLE_MS else 0.0,
        "ratio_bits": draw(st.sampled_from([None, 16])),
    }
    if accelerated:
        job["acceleration"] = speed / draw(st.floats(0.01, 0.3))
        job["deceleration"] = draw(st.sampled_from([None, 0.3, 2.0, math.inf]))
        if job["deceleration"] is not None:
            job["deceleration"] *= job["acceleration"]
    return job


def built(job):
    try:
        return MoveSpiral(**job)
    except InputError:
        assume(False)


@given(jobs(accelerated=False))
@settings(max_examples=60, deadline=None)
def test_setpoints_are_the_stepped_controllers_without_accel(job):
    spiral, stepped = built(job), Controller(**job).run()
    commanded = places(spiral.setpoints(job["servo_period"]))
    assert np.abs(len(commanded) - len(stepped.places)) <= 1  # the end may round either way
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=POSITION)
    assert spiral.ratios == pytest.approx(np.array(stepped.ratios), abs=RELATIVE)


@given(jobs())
@settings(max_examples=80, deadline=None)
def test_setpoints_are_the_stepped_controllers_with_the_exact_law_within_a_tick(job):
    spiral, stepped = built(job), Controller(**job).run()
    assume(stepped.ratios[-1] > 1e-3)
    commanded = places(spiral.setpoints(job["servo_period"]))
    assert np.abs(len(commanded) - len(stepped.places)) <= 1
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=POSITION)
    time = np.arange(n) * job["servo_period"]
    if math.isfinite(spiral.deceleration or 0):  # else the speed may jump to zero within the last tick
        assert spiral.passes.law.position(time) == pytest.approx(np.array(stepped.ways)[:n], abs=POSITION)
        assert spiral.passes.law.velocity(time) == pytest.approx(np.array(stepped.speeds)[:n], abs=1e-6)


@pytest.mark.parametrize("servo_period", [0.0005, 0.001, 0.002])
@pytest.mark.parametrize(("acceleration", "deceleration"), [(1000, None), (120, None), (1000, 300), (300, 1000)])
def test_a_controller_of_whole_ticks_is_met_to_half_a_ticks_way(servo_period, acceleration, deceleration):
    """Its virtual speed is changed at ticks alone, so that it agrees to the first order in the servo period."""
    job = {"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, "servo_period": servo_period}
    job |= {"acceleration": acceleration, "deceleration": deceleration}
    spiral, stepped = MoveSpiral(**job), Controller(**job, exact=False).run()
    commanded = places(spiral.setpoints(servo_period))
    n = min(len(commanded), len(stepped.places)) - 1
    error = np.abs(commanded[:n] - np.array(stepped.places)[:n]).max()
    assert 0.3 * 100 * servo_period <= error <= STEPPED * 100 * servo_period
    assert commanded[-1] == pytest.approx(stepped.places[-1], abs=STEPPED * 100 * servo_period)
    lag = np.abs(spiral.passes.law.position(np.arange(n) * servo_period) - np.array(stepped.ways)[:n]).max()
    assert lag <= STEPPED * max(stepped.speeds) * servo_period


@pytest.mark.parametrize(("acceleration", "end", "places"), [(1000, 40.02 - 0.14j, 0.005), (120, 43.8 - 4.7j, 0.05)])
def test_the_notes_ends_at_finite_accel(acceleration, end, places):
    found = end_of(note(acceleration=acceleration))
    assert found.real == pytest.approx(end.real, abs=places)
    assert found.imag == pytest.approx(end.imag, abs=places)
    # without the limit it ends where the table of loop periods says
    assert end_of(note()) == pytest.approx(40.0001 - 0.0036j, abs=1e-4)


def test_the_virtual_speed_must_rise_by_the_notes_figure_at_a_third():
    """The law is dv/dt = V change / (T x^3); over a pass it is V change / (T x_k^2 x_k+1)."""
    spiral = note(loop_period=1e-3)
    x, time = spiral.passes.ratio, spiral.passes.time
    rise = np.diff(spiral.passes.law.velocity(time)) / np.diff(time)
    law = 100 * spiral.change / (1e-3 * x**3)
    assert rise == pytest.approx(law[:-1], rel=2e-4)  # change / x, the difference of x_k and x_k+1
    assert law[-1] == pytest.approx(119.4, abs=0.05)
    assert rise[-1] == pytest.approx(119.4, abs=0.1)


@pytest.mark.parametrize("acceleration", [30.0, 60.0, 100.0])
def test_the_speed_is_reached_within_a_pass_where_the_need_is_below_accel(acceleration):
    passes = note(acceleration=acceleration, deceleration=math.inf).passes
    x = passes.ratio
    need = 100 * 0.004420971 / (0.1 * x[:-2] * x[1:-1] ** 2)  # within pass k, from V / x_k-1 to V / x_k
    lack = 100 / x[1:-1] - passes.law.velocity(passes.time[2:] - 1e-9)
    caught_up = int(np.flatnonzero(lack < 1e-6)[0])  # after the start from rest
    enough = need[caught_up:] < acceleration
    assert 20 < enough.sum() < enough.size - 5
    assert np.array_equal(lack[caught_up:] < 1e-6, enough)


def accelerations(law, n=40001):
    """Slopes of the virtual speed by finite differences within phases' ends."""
    t = np.unique(np.concatenate([np.linspace(0, law.duration, n), law.time]))
    t = t[np.diff(t, prepend=-1) > 1e-9]
    return np.diff(law.velocity(t)) / np.diff(t), t


@given(jobs())
@settings(max_examples=60, deadline=None)
def test_virtual_speed_is_continuous_within_accel_and_decel_and_ends_at_rest_at_the_end(job):
    spiral = built({**job, "deceleration": job["deceleration"] if job["deceleration"] != math.inf else None})
    law = spiral.passes.law
    slope, t = accelerations(law)
    up = spiral.acceleration
    down = up if spiral.deceleration is None else spiral.deceleration
    noise = 1e-9 * law.velocity(t).max() / np.diff(t).min()
    assert slope.max() <= up + noise
    assert slope.min() >= -down - noise
    assert law.velocity(0.0) == 0
    assert law.velocity(law.duration) == pytest.approx(0, abs=1e-6)
    assert np.all(law.velocity([-1e-3, law.duration + 1e-3]) == 0)
    # v dt adds up to the way (the trapezoid's rule is exact within phases), which ends with the circles
    way = np.sum(0.5 * (law.velocity(t)[1:] + law.velocity(t)[:-1]) * np.diff(t))
    assert way == pytest.approx(law.length, rel=1e-8)
    assert law.length == pytest.approx(math.pi * spiral.diameter * spiral.turns, rel=1e-12)
    turned = abs(spiral.generated.heading(spiral.generated.length)[0] - 0.5 * math.pi)
    assert turned == pytest.approx(2 * math.pi * spiral.turns, rel=1e-9)
    assert np.all(np.diff(law.position(t)) >= 0)


@pytest.mark.parametrize("limit", ["acceleration", "deceleration"])
def test_a_limit_alone_bites_and_the_other_end_is_free(limit):
    law = note(**{"acceleration": math.inf, "deceleration": math.inf, limit: 400.0}).passes.law
    assert law.velocity(0.0) == (0.0 if limit == "acceleration" else pytest.approx(100 / note().ratios[0]))
    last = law.velocity(law.duration)
    assert last == pytest.approx(0, abs=1e-6) if limit == "deceleration" else last > 290
    slope, _ = accelerations(law)
    if limit == "acceleration":
        assert slope.max() == pytest.approx(400, rel=1e-6)
        assert slope.min() >= -1e-3
    else:
        assert slope.min() == pytest.approx(-400, rel=1e-6)
        assert law.velocity(law.duration - 0.1) == pytest.approx(40, rel=1e-6)


def test_decel_other_than_accel_is_what_brakes():
    for deceleration in (200.0, 1000.0, 5000.0):
        law = note(acceleration=1000, deceleration=deceleration).passes.law
        slope, _ = accelerations(law)
        assert slope.max() == pytest.approx(1000, rel=1e-6)
        assert slope.min() == pytest.approx(-deceleration, rel=1e-6)
        assert law.velocity(law.duration - 0.01) == pytest.approx(0.01 * deceleration, rel=1e-6)
    same, default = note(acceleration=700, deceleration=700), note(acceleration=700)
    assert np.array_equal(same.passes.way, default.passes.way)


@pytest.mark.parametrize("deceleration", np.geomspace(100, 3000, 60))
def test_a_speed_that_could_not_be_braked_any_more_is_not_taken_up(deceleration):
    """Without ACCEL a command jumps the speed, but for the last one to no more than DECEL can stop."""
    law = note(loop_period=1.0, deceleration=deceleration).passes.law
    t = np.linspace(0, law.duration, 4001)
    assert np.all(law.velocity(t) ** 2 <= 2 * deceleration * (law.length - law.position(t)) * (1 + 1e-9) + 1e-3)
    assert law.velocity(law.duration - 1e-3) == pytest.approx(1e-3 * deceleration, rel=1e-6)


def test_braking_curls_the_tail_in():
    """x goes on falling with time while the circles end more slowly: the longer the braking the further in."""
    ends = [end_of(note(deceleration=deceleration)) for deceleration in (math.inf, 3000.0, 1000.0, 300.0)]
    x = [note(deceleration=deceleration).ratios[-1] for deceleration in (math.inf, 3000.0, 1000.0, 300.0)]
    assert np.all(np.diff(x) < 0)
    assert np.all(np.diff([end.imag for end in ends]) < 0)


def test_x_is_held_above_the_least_ratio_while_the_axes_brake():
    spiral = note(thickness=14, deceleration=100.0)
    x, law = spiral.ratios, spiral.passes.law
    assert NEVER_BELOW <= x[-1] < x[-2]
    assert x[-1] - spiral.change < NEVER_BELOW  # the next would fall below
    assert law.duration > spiral.passes.time[-1] + 2 * 0.1 * x[-1]  # so that the last pass lasts, with x held
    assert law.length == pytest.approx(math.pi * 480)
    assert law.velocity(law.duration) == pytest.approx(0, abs=1e-6)
    # and tick by tick
    job = {"diameter": 120, "turns": 4, "thickness": 14, "speed": 100, "deceleration": 100.0, "servo_period": 1e-3}
    stepped = Controller(**job).run()
    commanded = places(MoveSpiral(**job).setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=POSITION)


LEAST = r"must be at least 2\^-16, the least that CONNECT can hold; "


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {"thickness": 14.9, "loop_period": 1.0},
            r"ratio x = -0\.05396 on pass 16 of 16: "
            + LEAST
            + r"inner_diameter 0\.8 mm is too small for loop_period 1 s, "
            r"use fewer turns, a smaller thickness or a shorter loop_period",
        ),
        (
            {"acceleration": 6, "deceleration": math.inf},
            r"ratio x = -0\.00356 on pass 227 of 151: "
            + LEAST
            + r"the virtual axes are late, use a greater acceleration, fewer turns or a smaller thickness",
        ),
        (
            {"loop_period": 0.001, "wait_resolution": WHOLE_MS},
            r"ratio x = -2\.356e-05 on pass 22620 of 15080: "
            + LEAST
            + r"the virtual axes are late, use a loop_period longer against wait_resolution, "
            r"fewer turns or a smaller thickness",
        ),
        (
            {"height": 4000, "mhelical_mode": 0, "turns": 5},
            r"ratio x = -0\.00356 on pass 227 of 189: "
            + LEAST
            + r"the virtual axes are late, use mhelical_mode 1, fewer turns or a smaller thickness",
        ),
    ],
)
def test_a_ratio_that_falls_below_before_braking_names_the_remedies_that_help(changed, said):
    with pytest.raises(InputError, match=f"^{said}$"):
        note(**changed)


@pytest.mark.parametrize(
    ("changed", "remedy"),
    [
        ({"thickness": 14.9, "loop_period": 1.0}, {"loop_period": 0.01}),
        ({"acceleration": 6, "deceleration": math.inf}, {"acceleration": 100}),
        ({"loop_period": 0.001, "wait_resolution": WHOLE_MS}, {"loop_period": 0.1}),
        ({"height": 4000, "mhelical_mode": 0, "turns": 5}, {"mhelical_mode": 1}),
    ],
)
def test_the_remedies_help(changed, remedy):
    assert note(**{**changed, **remedy}).ratios[-1] > 0


def test_wa_waits_whole_milliseconds_cut_off():
    free, cut = note(), note(wait_resolution=WHOLE_MS)
    waits = np.diff(cut.passes.time)
    assert np.round(waits / WHOLE_MS) * WHOLE_MS == pytest.approx(waits, abs=1e-9)
    lost = 0.1 * cut.ratios[:-1] - waits
    assert np.all((lost > -1e-9) & (lost < WHOLE_MS))
    assert lost.max() > 0.9 * WHOLE_MS
    # a shorter pass turns the circle by less while x falls as ever: the pitch is thickness T x / floor(T x)
    step = np.diff(cut.ratios * 60) / np.diff(cut.passes.way[:-1]) * 2 * math.pi * 60
    assert -step == pytest.approx(10 * 0.1 * cut.ratios[:-1] / waits, rel=RELATIVE)
    assert cut.ratios.size > free.ratios.size
    assert end_of(cut).real > end_of(free).real + 0.1


def test_a_whole_number_of_milliseconds_loses_nothing():
    """x falls by 1/64 a pass and T = 64 ms: every wait is a whole number of milliseconds."""
    speed = math.pi * 120**2 / (2 * 30 * 0.064 * 64)
    changed = {"thickness": 30, "speed": speed, "turns": 1, "loop_period": 0.064}
    free, cut = note(**changed), note(**changed, wait_resolution=WHOLE_MS)
    assert free.change == pytest.approx(1 / 64)
    assert cut.passes.time == pytest.approx(free.passes.time, abs=1e-9)
    assert end_of(cut) == pytest.approx(end_of(free), abs=1e-6)


@given(jobs(accelerated=False), st.sampled_from([8, 12, 16, 20]))
@settings(max_examples=40, deadline=None)
def test_ratio_bits_cost_at_most_half_a_bit_of_every_radius(job, bits):
    job.pop("ratio_bits")
    job |= {"servo_period": 0.0, "wait_resolution": 0.0}
    exact, held = built(job), built({**job, "ratio_bits": bits})
    half = 2.0 ** -(bits + 1)
    assert np.array_equal(held.passes.ratio, exact.passes.ratio)
    assert np.abs(held.passes.connected - exact.passes.connected).max() <= half
    assert np.all(held.passes.connected * 2**bits == np.round(held.passes.connected * 2**bits))
    radii = [1 / np.abs(spiral.generated.parameters()["curvature"]) for spiral in (held, exact)]
    assert np.abs(radii[0] - radii[1]).max() <= half * exact.radius * (1 + 1e-9) + 1e-9
    # the places differ by no more than half a bit of the way of the virtual axes
    assert abs(end_of(held) - end_of(exact)) <= half * exact.virtual_length + 1e-9
    assert held.duration == exact.duration


def test_ratio_bits_show():
    assert abs(end_of(note(ratio_bits=8)) - end_of(note())) > 1e-3
    assert 0 < abs(end_of(note(ratio_bits=16)) - end_of(note())) < 60 * 2**-16


@given(jobs(accelerated=False))
@settings(max_examples=40, deadline=None)
def test_commands_take_effect_at_the_next_servo_tick(job):
    ticked, free = built(job), built({**job, "servo_period": 0.0})
    n = min(ticked.ratios.size, free.ratios.size)
    late = ticked.passes.time[:n] - free.passes.time[:n]
    assert np.all((late >= -1e-9) & (late < job["servo_period"]))
    ticks = ticked.passes.time / job["servo_period"]
    assert ticks == pytest.approx(np.round(ticks), abs=1e-6)


def test_the_servo_period_shows_and_vanishes():
    exact = end_of(note())
    errors = [abs(end_of(note(servo_period=period)) - exact) for period in (0.002, 0.0005, 1e-5)]
    assert errors[0] > 1e-3
    assert errors[2] < 1e-3
    assert errors[2] < errors[0]


def test_a_wait_cut_to_nothing_takes_a_servo_tick():
    """T x falls below a millisecond long before the end; the program then makes a pass a tick."""
    job = {"diameter": 120, "turns": 1, "thickness": 59.9, "speed": 100, "loop_period": 0.02, "servo_period": 5e-4}
    spiral = MoveSpiral(**job, wait_resolution=WHOLE_MS, acceleration=3000)
    waits = np.diff(spiral.passes.time)
    short = 0.02 * spiral.ratios[:-1] < WHOLE_MS
    assert short.sum() >= 5
    assert waits[short] == pytest.approx(np.full(short.sum(), 5e-4), abs=1e-9)
    stepped = Controller(**job, wait_resolution=WHOLE_MS, acceleration=3000).run()
    assert places(spiral.setpoints(5e-4))[:-1] == pytest.approx(np.array(stepped.places)[:-1], abs=POSITION)


def test_interpreter_time_adds_to_the_wait_that_is_left():
    """With WA cut to whole ms a pass lasts floor(100 x) ms + d."""
    d = 0.0004
    spiral = note(wait_resolution=WHOLE_MS, interpreter_time=d)
    expected = np.floor(100 * spiral.ratios[:-1] + 1e-6) * WHOLE_MS + d
    assert np.diff(spiral.passes.time) == pytest.approx(expected, abs=1e-9)
    # half a millisecond is lost on the average: d of as much makes up for it
    lone, both = (abs(end_of(note(**c)).real - 40) for c in ({"interpreter_time": d}, {"wait_resolution": WHOLE_MS}))
    assert abs(end_of(spiral).real - 40) < 0.5 * min(lone, both)


@given(jobs(accelerated=False))
@settings(max_examples=40, deadline=None)
def test_path_speed_of_the_setpoints_is_constant_where_no_limit_bites(job):
    """Where the ratio is exact; x times SPEED = V / x is V."""
    spiral = built({**job, "ratio_bits": None})
    setpoints = spiral.setpoints(job["servo_period"])
    chord = np.abs(np.diff(places(setpoints)))[:-1]
    arc = job["speed"] * job["servo_period"]
    at = np.searchsorted(spiral.passes.time, setpoints.time[:-2] + 0.5 * job["servo_period"]) - 1
    radius = spiral.radius * spiral.ratios[at]
    chord_of_arc = 2 * radius * np.sin(0.5 * arc / radius)
    assert chord == pytest.approx(chord_of_arc, rel=SPEED)


def test_path_speed_is_v_but_for_the_ramps_with_accel():
    setpoints = note(acceleration=2000, servo_period=1e-3).setpoints(1e-3)
    speed = np.abs(np.diff(places(setpoints))) / 1e-3
    assert speed.max() <= 100 * (1 + 1e-6)
    assert speed[:10].max() < 20
    assert speed[-10:].max() < 20
    # but for the ramps, and those after every command, the speed is V
    full = np.isclose(speed, 100, rtol=1e-4)
    assert full[60:-200].mean() > 0.85


@given(jobs())
@settings(max_examples=30, deadline=None)
def test_real_speed_is_the_ratio_times_the_virtual_speed(job):
    passes = built(job).passes
    law = passes.connect(passes.connected * np.diff(passes.way))
    t = np.linspace(0, law.duration, 2003)[1:-1]
    at = np.searchsorted(passes.time, t, side="right") - 1
    inside = np.abs(t - passes.time[at]) > 1e-6
    assert law.velocity(t)[inside] == pytest.approx((passes.connected[at] * passes.law.velocity(t))[inside], rel=1e-6)
    # and the way's derivative
    whole = inside & (at == np.searchsorted(passes.time, t + 1e-6, side="right") - 1)
    slope = (law.position(t + 1e-6) - law.position(t)) / 1e-6
    assert slope[whole] == pytest.approx(law.velocity(t)[whole], abs=1e-3 + 1e-4 * job["speed"])
    assert np.all(law.velocity([-1.0, law.duration + 1.0]) == 0)


def test_setpoints_of_another_period_than_the_servo_period_are_refused():
    said = (
        r"^servo_period = 0\.001 s of the controller: must be that of the servo, 0\.0005 s; "
        r"or 0 s for a program that is not bound to its ticks$"
    )
    with pytest.raises(InputError, match=said):
        note(servo_period=1e-3).setpoints(5e-4)
    assert note(servo_period=1e-3).setpoints(1e-3).period == 1e-3
    assert note().setpoints(5e-4).period == 5e-4


NO_LOOP = "where loop_period is 0 s, the limit of a loop that takes no time"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"acceleration": 100}, f"acceleration = 100 mm/s²: must be inf mm/s² {NO_LOOP}"),
        ({"deceleration": 50}, f"deceleration = 50 mm/s²: must be inf mm/s² {NO_LOOP}"),
        ({"wait_resolution": 0.001}, f"wait_resolution = 0.001 s: must be 0 s {NO_LOOP}"),
        ({"servo_period": 0.001}, f"servo_period = 0.001 s: must be 0 s {NO_LOOP}"),
        ({"interpreter_time": 0.01}, f"interpreter_time = 0.01 s: must be 0 s {NO_LOOP}"),
        ({"ratio_bits": 16}, f"ratio_bits = 16: must be none {NO_LOOP}"),
        ({"as_published": True}, "as_published = true: must have a loop_period greater than 0 s"),
        ({"height": 10, "mhelical_mode": 0}, "mhelical_mode = 0: must have a loop_period greater than 0 s"),
    ],
)
def test_the_continuous_limit_has_no_limits(changed, said):
    with pytest.raises(InputError) as error:
        note(loop_period=0, **changed)
    assert str(error.value) == said
    assert note(loop_period=0, acceleration=math.inf, deceleration=math.inf).duration == pytest.approx(
        10.0531, abs=5e-5
    )


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"acceleration": 0}, "acceleration = 0 mm/s²: must be greater than 0 mm/s²"),
        ({"acceleration": math.nan}, "acceleration = nan mm/s²: must be finite"),
        ({"acceleration": -math.inf}, "acceleration = -inf mm/s²: must be finite"),
        ({"deceleration": -5}, "deceleration = -5 mm/s²: must be greater than 0 mm/s²"),
        ({"wait_resolution": -0.001}, "wait_resolution = -0.001 s: must be at least 0 s"),
        ({"servo_period": math.nan}, "servo_period = nan s: must be finite"),
        ({"ratio_bits": 7}, "ratio_bits = 7: must be at least 8"),
        ({"ratio_bits": 16.5}, "ratio_bits = 16.5: must be a whole number"),
        ({"ratio_bits": 53}, "ratio_bits = 53: must be at most 52, or none for an exact ratio"),
        ({"height": math.inf}, "height = inf mm: must be finite"),
        ({"mhelical_mode": 2}, "mhelical_mode = 2: must be 0 (SPEED in space) or 1 (of the circle)"),
    ],
)
def test_a_limit_out_of_its_bound_is_named(changed, said):
    with pytest.raises(InputError) as error:
        note(**changed)
    assert str(error.value) == said


def published(**changed):
    return note(as_published=True, **changed)


def by_events(spiral, times):
    """The published program between ticks, its axes as complex numbers: literally 4 circles, no guard."""
    radius, sense = spiral.radius, -1 if spiral.clockwise else 1
    length, time, way, x = 4 * math.pi * spiral.diameter, 0.0, 0.0, 1.0
    begun, travelled, ratio = [0.0], [0.0], []
    while way < length * (1 - 1e-12):
        x = 1 - (len(ratio) + 1) * spiral.change
        if abs(x) < 1e-12:
            break
        ratio.append(x)
        lasting = max(spiral.loop_period * x, 0.0) + spiral.interpreter_time or spiral.loop_period
        way, time = min(way + spiral.speed / abs(x) * lasting, length), time + lasting
        begun.append(time)
        travelled.append(way)
    if travelled[-1] < length * (1 - 1e-12):  # the program has stopped; the axes go on
        begun[-1], travelled[-1] = math.inf, length
    found = []
    for t in times:
        place = 0j
        for k, x in enumerate(ratio):
            if t <= begun[k]:
                break
            ways = travelled[k], min(travelled[k] + spiral.speed / abs(x) * (t - begun[k]), travelled[k + 1])
            circle = [sense * radius * cmath.exp(1j * sense * s / radius) for s in ways]
            place += x * (circle[1] - circle[0])
        found.append(place)
    return np.array(found)


def halting(passes=40):
    """A program whose ratio falls to zero exactly on a pass, with 1.5 circles of its literal four still to run."""
    loop_period = math.pi * 120**2 / (2 * 20 * 100 * passes)
    return {"turns": 3, "thickness": 20, "loop_period": loop_period}


PROGRAMS = {
    "four": {},
    "three": {"turns": 3},
    "one": {"turns": 1, "thickness": 12},
    "backwards": {"turns": 2, "thickness": 29, "interpreter_time": 0.01},
    "counter-clockwise": {"turns": 3, "thickness": 18.5, "clockwise": False, "interpreter_time": 0.01},
    "halting": halting(),
}


@pytest.mark.parametrize("changed", PROGRAMS.values(), ids=PROGRAMS)
def test_the_published_program_between_ticks(changed):
    spiral = published(**changed)
    setpoints = spiral.setpoints(0.01)
    expected = by_events(spiral, setpoints.time[:-1])
    assert places(setpoints)[:-1] == pytest.approx(expected, abs=1e-8)
    assert places(setpoints)[-1] == pytest.approx(by_events(spiral, [1e3])[0], abs=1e-8)


@pytest.mark.parametrize(
    "limited",
    [
        {},
        {"acceleration": 2000.0, "wait_resolution": WHOLE_MS, "ratio_bits": 16},
    ],
    ids=["free", "limited"],
)
@pytest.mark.parametrize("changed", PROGRAMS.values(), ids=PROGRAMS)
def test_the_published_program_tick_by_tick(changed, limited):
    job = {"diameter": 120, "thickness": 10, "turns": 4, "speed": 100, "servo_period": 1e-3, **changed, **limited}
    stepped = Controller(**job, as_published=True).run()
    spiral = MoveSpiral(**job, as_published=True)
    commanded = places(spiral.setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert abs(len(commanded) - len(stepped.places)) <= 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=1e-8)
    assert spiral.ratios == pytest.approx(np.array(stepped.ratios), abs=RELATIVE)
    if "thickness" in changed and limited:  # too thick for four circles
        assert spiral.passes.halted or np.sum(spiral.ratios < 0) > 10 or changed["turns"] == 1


def test_virtual_axes_slow_down_with_decel_behind_a_ratio_of_zero():
    """SPEED = V / |x| falls again there; tick by tick, and DECEL is what it takes."""
    job = {"diameter": 120, "thickness": 29, "turns": 2, "speed": 100, "servo_period": 1e-3, "interpreter_time": 0.02}
    job |= {"acceleration": 500.0, "deceleration": 2000.0, "as_published": True}
    stepped, spiral = Controller(**job).run(), MoveSpiral(**job)
    commanded = places(spiral.setpoints(1e-3))
    n = min(len(commanded), len(stepped.places)) - 1
    assert commanded[:n] == pytest.approx(np.array(stepped.places)[:n], abs=1e-8)
    assert spiral.passes.law.velocity(np.arange(n) * 1e-3) == pytest.approx(np.array(stepped.speeds)[:n], abs=1e-6)
    assert np.diff(stepped.speeds[: n - 200]).min() == pytest.approx(-2.0, rel=1e-6)  # before the last braking


def test_the_published_program_runs_four_circles_whatever_the_turns():
    for turns in (1, 2, 3, 4, 5):
        path = published(turns=turns).generated
        turned = path.heading(0)[0] - path.heading(path.length)[0]
        assert turned == pytest.approx(8 * math.pi, abs=1e-9)
        assert published(turns=turns).circles == 4
        assert note(turns=turns).circles == turns


def test_with_four_turns_and_no_bad_ratio_the_published_program_is_the_corrected_one():
    for changed in ({}, {"acceleration": 1000, "servo_period": 1e-3, "wait_resolution": WHOLE_MS, "ratio_bits": 16}):
        ours, theirs = note(**changed), published(**changed)
        assert np.array_equal(ours.setpoints(1e-3).position, theirs.setpoints(1e-3).position)
        assert ours.notes == ()


def test_a_negative_ratio_runs_the_real_axes_backwards():
    """The real velocity is x times the virtual one."""
    spiral = published(turns=2, thickness=20)
    first = int(np.flatnonzero(spiral.ratios < 0)[0])
    path, passes = spiral.generated, spiral.passes
    for k in (first - 3, first):
        real = passes.connect(np.abs(passes.connected) * np.diff(passes.way)).real
        tangent = complex(*path.tangent(real[k] + 1e-6)[0, :2])
        virtual = 1j * cmath.exp(-1j * passes.way[k] / 60)
        assert tangent == pytest.approx(np.sign(spiral.ratios[k]) * virtual, abs=1e-4)


def test_defaults_are_the_method_without_limits():
    free = note(
        acceleration=math.inf,
        deceleration=math.inf,
        wait_resolution=0,
        ratio_bits=None,
        servo_period=0,
        as_published=False,
        height=0,
        mhelical_mode=1,
    )
    assert np.array_equal(free.setpoints(1e-3).position, note().setpoints(1e-3).position)
    assert free.duration == note().duration == pytest.approx(10.0197, abs=5e-5)
    assert free.notes == note().notes == ()
    assert free.axes == ("x", "y")
    ends = np.cumsum(note().ratios * 0.1)
    assert note().passes.time == pytest.approx(np.concatenate([[0], ends[:-1]]), abs=1e-9)


BASE = (
    "listing: a BASE statement names an axis that does not exist; no controller runs it, "
    "so the virtual axes are taken here"
)
COUNTER = "listing: the turn counter is compared with a literal 4, not with the number of turns: "
GUARD = "listing: the guard lets x = 0 and negative x pass"
COMMA = "listing: a trailing comma in the first MOVECIRC is a syntax error; it is left out here"
HELIX = "listing: MHELIX is no command of the controller; MHELICAL is taken here"


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (
            {},
            (BASE, COUNTER + "with 4 turns nothing changes", GUARD + ": here x ends at 0.3324, nothing changes", COMMA),
        ),
        (
            {"turns": 3, "height": 30},
            (
                BASE,
                COUNTER + "4 circles are run instead of 3",
                GUARD + ": here x ends at 0.3324, nothing changes",
                COMMA,
                HELIX,
            ),
        ),
        (
            {"turns": 2, "thickness": 20},
            (
                BASE,
                COUNTER + "4 circles are run instead of 2",
                GUARD + ": from pass 114, at 5.605 s, the real axes run backwards, down to x = -0.007981, "
                "and WA of a negative time does not wait",
                COMMA,
            ),
        ),
        (
            halting(),
            (
                BASE,
                COUNTER + "4 circles are run instead of 3",
                GUARD + ": x is 0 on pass 40, SPEED = V / x divides by zero, the program stops there "
                "and the axes run on with x = 0.025",
                COMMA,
            ),
        ),
    ],
)
def test_the_differences_of_the_listing_are_said_in_full(changed, said):
    assert published(**changed).notes == said


def test_a_first_ratio_of_zero_is_refused_even_as_published():
    with pytest.raises(InputError, match=r"^ratio x = 0 on pass 1 of \d+: must be at least 2\^-16"):
        published(**halting(1))


@pytest.mark.parametrize("passes", [2000])
def test_a_published_program_that_runs_backwards_without_end_is_refused(monkeypatch, passes):
    """SPEED = V / |x| falls as x falls on, so that what is left of the circles takes e^233 passes."""
    for module in ("loop", "spiral"):
        monkeypatch.setattr(f"gantrysim.controllers.trio.{module}.MAX_PASSES", passes)
    with pytest.raises(InputError) as error:
        published(turns=1, thickness=50, interpreter_time=0.001)
    change = 2 * 50 * 100 * 0.1 / (math.pi * 120**2)
    assert str(error.value).startswith(f"ratio x = {1 - passes * change:.4g} at ")
    assert str(error.value).endswith(
        f" s: the circles must end within {passes} passes; use a smaller thickness or a greater acceleration"
    )


def test_an_accel_so_small_that_the_loop_would_never_end_is_refused(monkeypatch):
    for module in ("loop", "spiral"):
        monkeypatch.setattr(f"gantrysim.controllers.trio.{module}.MAX_PASSES", 2000)
    with pytest.raises(InputError, match=r"^ratio x = 0\.99\d+ at .* s: the circles must end within 2000 passes; use "):
        note(thickness=1e-4, acceleration=1e-3)
