"""The "Move Spiral" method of AN-225 against its own event loop, in closed form.

The loop: lower x by `change`, set the virtual speed to V / x, wait T x (and d, the time the interpreter
needs). CONNECT(x) makes the real axes follow x times the movement of the virtual circle.
"""

import cmath
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import metrics
from gantrysim.base.errors import InputError
from gantrysim.controllers.trio import MoveSpiral
from gantrysim.controllers.trio.loop import Loop
from gantrysim.paths.spirals import Involute

from support.soaked import examples, suite_runs

POSITION = 1e-8  # after up to some thousand passes [mm]
RELATIVE = 1e-10
FIRST_ORDER = 0.05  # of the ratio 2 by which half the loop period lowers the error
PITCH_SECOND_ORDER = 0.02  # the part of the pitch's shrinkage that the formula of first order leaves


def note(**changed):
    """The example of the note: D = 120 mm, 4 turns, thickness 10 mm, V = 100 mm/s, T = 0.1 s."""
    return MoveSpiral(**{"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, **changed})


@st.composite
def jobs(draw, interpreter=False):
    """Arguments of a spiral of at least 12 passes whose ratio stays above zero."""
    diameter = draw(st.floats(20, 300))
    turns = draw(st.integers(1, 8))
    inner = draw(st.floats(0.1, 0.95))
    speed = draw(st.floats(1, 500))
    period = math.pi * diameter * turns / speed / draw(st.floats(12, 400))
    return {
        "diameter": diameter,
        "turns": turns,
        "thickness": diameter * (1 - inner) / (2 * turns),
        "speed": speed,
        "loop_period": period,
        "interpreter_time": period * draw(st.floats(0, 0.2)) if interpreter else 0.0,
        "start": draw(st.tuples(st.floats(-50, 50), st.floats(-50, 50))),
        "clockwise": draw(st.booleans()),
    }


class EventLoop:
    """The loop of the note, run: one entry per pass of time, ratio, virtual angle and real position."""

    def __init__(
        self,
        diameter,
        turns,
        thickness,
        speed,
        loop_period=0.1,
        interpreter_time=0.0,
        start=(0.0, 0.0),
        clockwise=True,
    ):
        self.speed, self.radius, self.sense = speed, diameter / 2, -1 if clockwise else 1
        inner = diameter - 2 * turns * thickness
        virtual_time = math.pi * diameter * turns / speed
        self.change = (1 - inner / diameter) / (virtual_time / loop_period)
        total = 2 * math.pi * turns
        time, x, phi, place = 0.0, 1.0, 0.0, complex(*start)
        self.times, self.ratios, self.angles, self.places = [time], [], [phi], [place]
        while phi < total * (1 - 1e-12):
            x -= self.change
            wait = loop_period * x + interpreter_time
            if phi + speed / x / self.radius * wait > total:  # the last circle ends within this pass
                wait = (total - phi) * self.radius * x / speed
            before, phi = phi, phi + speed / x / self.radius * wait
            place += x * (self.circle(phi) - self.circle(before))
            time += wait
            self.times.append(time)
            self.ratios.append(x)
            self.angles.append(phi)
            self.places.append(place)

    def circle(self, phi):
        """The virtual axes: first towards +y, centre at +x where clockwise."""
        return self.sense * self.radius * (cmath.exp(1j * self.sense * phi) - 1)

    def place(self, time):
        """The real axes at a time within the motion."""
        k = min(int(np.searchsorted(self.times, time, side="right")) - 1, len(self.ratios) - 1)
        x = self.ratios[k]
        phi = self.angles[k] + self.speed / x / self.radius * (time - self.times[k])
        return self.places[k] + x * (self.circle(phi) - self.circle(self.angles[k]))

    @property
    def length(self):
        return sum(x * self.radius * angle for x, angle in zip(self.ratios, np.diff(self.angles), strict=True))


def end_of(path):
    return path.position(path.length)[0]


def trace_of(spiral, period=0.001):
    position = spiral.setpoints(period).position
    return np.column_stack([position, np.zeros(len(position))])


@pytest.mark.validates(
    "spiral of the loop method: end point, time, length, passes",
    "table of AN-225",
    "its digits",
)
def test_the_notes_first_table():
    spiral = note()
    assert spiral.radius == 60
    assert spiral.inner_diameter == 40
    assert spiral.virtual_length == pytest.approx(1507.964, abs=5e-4)
    assert spiral.virtual_time == pytest.approx(15.0796, abs=5e-5)
    assert spiral.change == pytest.approx(0.004420971, abs=5e-10)


def test_the_continuous_limit():
    spiral = note(loop_period=0)
    path = spiral.requested
    assert spiral.generated is path
    assert spiral.ratios.size == 0
    assert path.length == pytest.approx(1005.310, abs=5e-4)
    assert spiral.duration == pytest.approx(10.0531, abs=5e-5)
    assert end_of(path) == pytest.approx([40, 0, 0], abs=POSITION)
    true_centre = np.array([60, 1.5915, 0])
    assert path.centre == pytest.approx(true_centre, abs=5e-5)
    assert np.linalg.norm(path.position(0)[0] - true_centre) == pytest.approx(60.0211, abs=5e-5)
    assert np.linalg.norm(end_of(path) - true_centre) == pytest.approx(20.0632, abs=5e-5)


def test_virtual_speed_at_the_end_of_the_continuous_limit():
    path = note(loop_period=0).requested
    ratio = 1 / abs(path.curvature(path.length)[0]) / 60
    assert 100 / ratio == pytest.approx(300, abs=1e-6)


@pytest.mark.parametrize(
    ("loop_period", "degrees", "step", "loops", "last", "end", "time", "length"),
    [
        (0.01, 0.955, 0.0265, 1508, 0.3333, (40.0000, -0.0000), 10.0498, 1004.976),
        (0.1, 9.549, 0.2653, 151, 0.3324, (40.0001, -0.0036), 10.0197, 1001.973),
        (1.0, 95.493, 2.6526, 16, 0.2926, (39.9599, -0.1649), 9.7181, 971.814),
    ],
)
def test_the_notes_table_of_loop_periods(loop_period, degrees, step, loops, last, end, time, length):
    spiral = note(loop_period=loop_period)
    arcs = spiral.generated.parameters()
    radii = 1 / np.abs(arcs["curvature"])
    angles = np.degrees(np.abs(arcs["curvature"]) * arcs["lengths"])
    assert angles[:-1] == pytest.approx(np.full(loops - 1, degrees), abs=5e-4)
    assert 0 < angles[-1] <= angles[0]
    assert radii[0] == pytest.approx(60 - step, abs=5e-5)
    assert -np.diff(radii) == pytest.approx(np.full(loops - 1, step), abs=5e-5)
    assert spiral.ratios.size == loops
    assert spiral.ratios[-1] == pytest.approx(last, abs=5e-5)
    assert end_of(spiral.generated) == pytest.approx([*end, 0], abs=5e-5)
    assert spiral.duration == pytest.approx(time, abs=5e-5)
    assert spiral.generated.length == pytest.approx(length, abs=5e-4)


@pytest.mark.parametrize(("interpreter_time", "end_x"), [(0.001, 39.360), (0.005, 37.108)])
def test_interpreter_time_moves_the_end(interpreter_time, end_x):
    spiral = note(interpreter_time=interpreter_time)
    assert end_of(spiral.generated)[0] == pytest.approx(end_x, abs=5e-4)


@pytest.mark.parametrize("interpreter_time", suite_runs([0.001, 0.005], 0))
def test_interpreter_time_shrinks_the_local_pitch(interpreter_time):
    """To first order thickness / (1 + d / (T x)), with x half a turn on: between the two turns."""
    spiral = note(interpreter_time=interpreter_time)
    spacing = metrics.spacing(spiral.generated, trace_of(spiral)[::4])
    radius = 1 / np.abs(spiral.generated.curvature(spacing.s)) - 0.5 * spacing.distance
    pitch = 10 / (1 + interpreter_time / (0.1 * radius / 60))
    assert np.all(np.abs(spacing.distance - pitch) <= PITCH_SECOND_ORDER * (10 - pitch))
    # it shrinks towards the centre
    per_turn = [spacing.distance[(spacing.turn >= turn) & (spacing.turn < turn + 1)].mean() for turn in range(3)]
    assert per_turn[0] > per_turn[1] > per_turn[2]


@given(jobs(interpreter=True))
@examples(50)
def test_generated_path_is_that_of_the_event_loop(job):
    spiral, loop = MoveSpiral(**job), EventLoop(**job)
    assert spiral.change == pytest.approx(loop.change, rel=RELATIVE)
    assert spiral.ratios == pytest.approx(np.array(loop.ratios), abs=RELATIVE)
    assert spiral.generated.length == pytest.approx(loop.length, rel=RELATIVE)
    assert spiral.duration == pytest.approx(loop.times[-1], rel=RELATIVE)
    joints = np.concatenate([[0], np.cumsum(np.diff(loop.times) * job["speed"])])
    places = spiral.generated.position(joints)[:, :2] @ [1, 1j]
    assert places == pytest.approx(np.array(loop.places), abs=POSITION)
    sense = -1 if job["clockwise"] else 1
    headings = spiral.generated.heading(joints)
    assert headings == pytest.approx(0.5 * math.pi + sense * np.array(loop.angles), abs=RELATIVE * 1e3)


@given(jobs(interpreter=True), st.floats(20, 300))
@examples(50)
def test_setpoints_are_the_event_loop_seen_at_the_servo_period(job, ticks):
    spiral, loop = MoveSpiral(**job), EventLoop(**job)
    setpoints = spiral.setpoints(loop.times[-1] / ticks)
    places = np.array([loop.place(time) for time in setpoints.time[:-1]])
    assert setpoints.position[:-1] @ [1, 1j] == pytest.approx(places, abs=POSITION)
    assert setpoints.position[0] == pytest.approx(job["start"], abs=POSITION)
    end = loop.places[-1]
    # the last period may be forgiven 1e-9 of its length
    assert setpoints.position[-1] == pytest.approx([end.real, end.imag], abs=POSITION + 2e-9 * loop.length / ticks)
    assert setpoints.requested is spiral.requested


@given(jobs(), st.floats(20, 2000))
@examples(50)
def test_path_speed_of_the_setpoints_is_constant_but_for_the_last(job, ticks):
    spiral = MoveSpiral(**job)
    setpoints = spiral.setpoints(spiral.duration / ticks)
    chords = np.linalg.norm(np.diff(setpoints.position, axis=0), axis=1)
    arc = job["speed"] * setpoints.period
    # a chord over the arc of the smallest radius is the shortest
    half = arc / (2 * spiral.ratios[-1] * spiral.radius)
    shortest = arc * (math.sin(half) / half if half < math.pi / 2 else 0)
    assert np.all(chords[:-1] <= arc + POSITION)
    assert np.all(chords[:-1] >= shortest - POSITION)
    assert 0 <= chords[-1] <= arc + POSITION


@given(jobs(interpreter=True))
@examples(50)
def test_ratio_falls_by_the_change_and_stays_positive(job):
    spiral = MoveSpiral(**job)
    assert spiral.ratios[0] == pytest.approx(1 - spiral.change, abs=RELATIVE)
    assert np.diff(spiral.ratios) == pytest.approx(np.full(spiral.ratios.size - 1, -spiral.change), abs=RELATIVE)
    assert np.all(spiral.ratios > 0)
    assert np.all(np.abs(spiral.generated.curvature(np.linspace(0, spiral.generated.length, 50))) > 0)
    turned = np.abs(spiral.generated.heading(spiral.generated.length)[0] - 0.5 * math.pi)
    assert turned == pytest.approx(2 * math.pi * job["turns"], abs=1e-9)


@given(jobs(), st.integers(1, 8))
@examples(50)
def test_change_does_not_depend_on_the_number_of_turns(job, turns):
    job["thickness"] = job["diameter"] * 0.05
    job["loop_period"] = 0.01 * math.pi * job["diameter"] / job["speed"]  # a hundredth of a circle
    change = MoveSpiral(**job).change
    assert MoveSpiral(**{**job, "turns": turns}).change == change
    assert change == pytest.approx(0.01 * 0.1, rel=RELATIVE)


@given(jobs())
@examples(50)
def test_generated_path_is_shorter_by_half_a_radius_step_a_radian(job):
    """Each pass runs at its end radius. Of the last pass only the fraction f of its arc is run."""
    spiral = MoveSpiral(**job)
    passes = spiral.virtual_time / job["loop_period"]
    f = passes - (spiral.ratios.size - 1)
    arc = job["speed"] * job["loop_period"] / spiral.radius
    lost = spiral.radius * arc * spiral.change * 0.5 * (spiral.ratios.size - 1 + f * (2 - f))
    assert spiral.requested.length - spiral.generated.length == pytest.approx(lost, abs=POSITION)
    assert spiral.generated.length < spiral.requested.length


@given(jobs())
@examples(50)
def test_counter_clockwise_is_mirrored_and_the_start_only_moves(job):
    there = MoveSpiral(**job).generated
    back = MoveSpiral(**{**job, "start": (0, 0), "clockwise": not job["clockwise"]}).generated
    s = np.linspace(0, there.length, 40)
    assert there.position(s) == pytest.approx(back.position(s) * [-1, 1, 1] + [*job["start"], 0], abs=POSITION)


@pytest.mark.parametrize("turns", [1, 2, 3, 5])
def test_the_number_of_circles_is_the_number_of_turns(turns):
    """The listing compares its counter with a literal 4."""
    for loop_period in (0, 0.1):
        path = note(turns=turns, loop_period=loop_period).generated
        assert path.heading(0)[0] - path.heading(path.length)[0] == pytest.approx(2 * math.pi * turns, abs=1e-9)
        assert end_of(path)[0] == pytest.approx(10 * turns, abs=0.01)


def test_first_motion_is_towards_y_with_the_centre_at_x():
    for clockwise, side in ((True, 1), (False, -1)):
        spiral = note(clockwise=clockwise)
        assert spiral.generated.tangent(0)[0] == pytest.approx([0, 1, 0], abs=1e-12)
        assert spiral.requested.centre[0] == pytest.approx(60 * side, abs=POSITION)


def test_requested_path_is_the_involute_of_pitch_thickness():
    spiral = note(start=(3, 4), clockwise=False)
    assert isinstance(spiral.requested, Involute)
    assert spiral.requested.parameters() == Involute(60, 10, 4, (3, 4), 0.5 * math.pi, False).parameters()


def test_started_at_minus_a_the_spiral_is_centred_on_the_virtual_circle():
    a = 10 / (2 * math.pi)
    centred = note(start=(0, -a))
    assert centred.requested.centre == pytest.approx([60, 0, 0], abs=POSITION)
    assert note().requested.centre == pytest.approx([60, a, 0], abs=POSITION)


@pytest.mark.parametrize("loop_period", [0.1, 0.05, 0.025])
def test_program_error_falls_with_the_loop_period_at_first_order(loop_period):
    def error(spiral):
        s = np.linspace(0, spiral.generated.length, 5001)
        return spiral.requested.project(spiral.generated.position(s)).distance.max()

    coarse, fine = error(note(loop_period=loop_period)), error(note(loop_period=loop_period / 2))
    assert coarse / fine == pytest.approx(2, rel=FIRST_ORDER)


def test_equal_loops_run_once(monkeypatch):
    runs = []
    run = Loop.run
    monkeypatch.setattr(Loop, "run", lambda self: runs.append(self) or run(self))
    spiral = note(loop_period=0.0765)
    assert note(loop_period=0.0765, start=(3.0, 4.0), clockwise=False).passes is spiral.passes
    assert len(runs) == 1
    assert note(loop_period=0.0764).passes is not spiral.passes
    assert len(runs) == 2
    with pytest.raises(ValueError, match="read-only"):
        spiral.ratios[0] = 1.0
    many = [note(loop_period=spiral.virtual_time / 10_001) for _ in range(2)]  # too many to be kept
    assert len(runs) == 4
    assert many[0].ratios.tolist() == many[1].ratios.tolist()


@pytest.mark.parametrize("passes", [12, 100, 151, 1000])
def test_a_whole_number_of_passes_has_no_empty_pass(passes):
    spiral = note(loop_period=note().virtual_time / passes)
    assert spiral.ratios.size == passes
    lengths = spiral.generated.parameters()["lengths"] / spiral.ratios
    assert lengths == pytest.approx(np.full(passes, lengths[0]), rel=1e-9)


def test_interpreter_time_makes_the_passes_fewer():
    assert note(interpreter_time=0.005).ratios.size < note().ratios.size
    assert np.array_equal(
        note(interpreter_time=0.005).ratios, note().ratios[: note(interpreter_time=0.005).ratios.size]
    )


def test_inner_diameter_zero_is_reached_in_the_continuous_limit_alone():
    assert end_of(note(diameter=80, loop_period=0).generated) == pytest.approx([40, 0, 0], abs=1e-6)
    with pytest.raises(InputError, match=r"ratio x = -[\d.e-]+ on pass \d+ of \d+: must be at least 2\^-16"):
        note(diameter=80)


def test_ratio_that_would_fall_to_zero_names_the_pass_and_the_remedies():
    text = (
        r"ratio x = -[\d.]+ on pass 14 of 14: must be at least 2\^-16, the resolution of CONNECT; "
        r"inner_diameter 4 mm is too small for loop_period 1 s, "
        r"use fewer turns, a smaller thickness or a shorter loop_period"
    )
    with pytest.raises(InputError, match=text):
        note(diameter=104, thickness=12.5, loop_period=1)
    assert note(diameter=104, thickness=12.5, loop_period=0.1).ratios[-1] > 0


@pytest.mark.parametrize("passes", [15, 30, 39, 41, 43])
def test_ratio_of_exactly_zero_on_the_last_pass_is_an_error(passes):
    with pytest.raises(InputError, match=r"must be at least 2\^-16"):
        note(diameter=80, loop_period=math.pi * 80 * 4 / 100 / passes)


def test_ratio_is_at_least_one_bit_of_its_sixteen():
    def last_ratio(bits):
        inner = 2.0**-bits
        return note(thickness=15 * (1 - inner), loop_period=note().virtual_time / 100).ratios[-1]

    assert last_ratio(15) == pytest.approx(2**-15, rel=1e-6)
    with pytest.raises(InputError, match=r"ratio x = 7\.629e-06 on pass 100 of 100"):
        last_ratio(17)


def test_inner_diameter_below_zero_names_its_value_and_the_alternatives():
    text = (
        r"inner_diameter = -20 mm \(diameter 120 - 2 x turns 7 x thickness 10\): must be at least 0 mm; "
        r"use turns at most 5 or thickness below 8\.57143 mm"
    )
    with pytest.raises(InputError, match=text):
        note(turns=7)
    assert note(turns=5).inner_diameter == 20  # what the message offers does run
    assert note(turns=6, loop_period=0).inner_diameter == 0
    assert note(turns=7, thickness=120 / 14, loop_period=0).inner_diameter == pytest.approx(0, abs=1e-12)


def test_a_thickness_above_the_radius_suggests_no_turns():
    with pytest.raises(InputError, match=r"inner_diameter = -40 mm .*; use thickness below 60 mm"):
        note(turns=1, thickness=80)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"diameter": math.nan}, "diameter = nan mm: must be finite"),
        ({"diameter": 0}, "diameter = 0 mm: must be greater than 0 mm"),
        ({"diameter": "wide"}, "diameter = 'wide': must be a number"),
        ({"turns": 0}, "turns = 0: must be at least 1"),
        ({"turns": 3.5}, "turns = 3.5: must be a whole number"),
        ({"turns": math.nan}, "turns = nan: must be finite"),
        ({"thickness": 0}, "thickness = 0 mm: must be greater than 0 mm"),
        ({"thickness": -10}, "thickness = -10 mm: must be greater than 0 mm"),
        ({"thickness": math.inf}, "thickness = inf mm: must be finite"),
        ({"speed": -5}, "speed = -5 mm/s: must be greater than 0 mm/s"),
        ({"speed": math.nan}, "speed = nan mm/s: must be finite"),
        ({"loop_period": -0.1}, "loop_period = -0.1 s: must be at least 0 s"),
        ({"loop_period": math.nan}, "loop_period = nan s: must be finite"),
        ({"interpreter_time": -0.001}, "interpreter_time = -0.001 s: must be at least 0 s"),
        ({"interpreter_time": math.inf}, "interpreter_time = inf s: must be finite"),
        ({"start": (0, math.nan)}, "start y = nan mm: must be finite"),
        (
            {"loop_period": 0, "interpreter_time": 0.001},
            "interpreter_time = 0.001 s: must be 0 s where loop_period is 0 s",
        ),
        (
            {"loop_period": 1e-6},
            r"loop_period = 1e-06 s: makes 15079645 passes, at most 2000000 are run; "
            r"use 0 s for the continuous limit or at least 7.54e-06 s",
        ),
    ],
)
def test_a_value_out_of_its_bound_is_named(changed, text):
    with pytest.raises(InputError, match=f"^{text}"):
        note(**changed)


def test_an_inner_diameter_of_zero_may_be_rounded():
    assert MoveSpiral(0.6, 3, 0.1, 1, 0).inner_diameter == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("start", [(0, 0, 0), (0,), 3])
def test_start_of_other_than_two_coordinates_is_an_input_error(start):
    with pytest.raises(InputError, match="start"):
        note(start=start)


def test_whole_turns_given_as_a_float_are_whole():
    assert note(turns=4.0).turns == 4
    assert isinstance(note(turns=4.0).turns, int)


@pytest.mark.parametrize("period", [0, -0.001, math.nan])
def test_servo_period_out_of_its_bound_is_named(period):
    with pytest.raises(InputError, match=rf"^period = {period:g} s: must be"):
        note().setpoints(period)
