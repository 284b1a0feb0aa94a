"""The ladder of laws in the servo tick: against laws in plain Python, linear theory, and one another."""

# ruff: noqa: N806 - numbers bear the letters of the laws

import dataclasses
import math

import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from gantrysim import InputError, Job, Machine, Servo, simulate, simulate_batch
from gantrysim.engine.laws import law_entries, law_stages
from gantrysim.engine.learning import run_and_learn
from gantrysim.engine.simulation import Simulation
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.stability.margins import margins_of

from support.runs import PERIOD, ramp, smooth
from support.soaked import suite_runs

SAME = 1e-9  # of two computations of one law [N·m]
NEAR = 0.03  # distance from a margin at which a kick grows or decays, relative
FINE = 1.25e-5  # physics step where motion is held against linear theory [s]
LINEAR = 0.02  # of an error that linear theory foresees, relative to the largest


@pytest.fixture(scope="module")
def frictionless():
    return Machine("xy").perturbed(Perturbation(friction=1e-15))


def curve(duration=0.4, wait=0.1, size=1.0):
    """A way round a half circle and back a little, at rest before and after."""
    u = np.concatenate([np.zeros(round(wait / PERIOD)), smooth(duration), np.ones(round(wait / PERIOD))])
    angle = np.pi * u
    position = 30 * size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    position[:, 0] += 4 * size * np.sin(2 * angle)
    return Setpoints(PERIOD, ("x", "y"), position, np.zeros(len(u), bool), ramp(50.0).requested)


def by_hand(servo, names):
    """The laws in plain Python, by other recursions than those of the tick."""
    T, n, past, told = servo.period, servo.axes, [], []
    state = {"speed": np.zeros(n), "sum": np.zeros(n), "bristle": np.zeros(n), "across": None, "tangent": None}
    kp, ki, kd = (np.array(servo.per_axis(name)) for name in ("kp", "ki", "kd"))
    Q = [butter(2, 2 * T * f) if f else None for f in servo.per_axis("observer_bandwidth")]
    raw, smoothed = [], []

    def law(tick):
        past.append(tick.measured)
        v, error = tick.demand_velocity, tick.error
        change = v - tick.measured_velocity
        if "contour" in names:
            if np.any(v):
                state["tangent"] = v / np.linalg.norm(v)
            t = state["tangent"]
            across = np.zeros(n) if t is None else (np.eye(n) - np.outer(t, t)) @ error
            before = across if state["across"] is None else state["across"]
            state["across"] = across if t is not None else np.zeros(n)
            gain = np.array(servo.per_axis("contour_gain"))
            error, change = error + gain * across, change + gain * (state["across"] - before) / T
        if "p-pi" in names:
            speed_error = kp / kd * error + v - tick.measured_velocity
            state["speed"] += T * speed_error
            torque = kd * speed_error + kd * ki / kp * state["speed"]
        else:
            state["sum"] += T * error
            torque = kp * error + ki * state["sum"] + kd * change
        torque += (
            np.array(servo.per_axis("velocity_ff")) * v
            + np.array(servo.per_axis("acceleration_ff")) * tick.demand_acceleration
        )
        rub = np.zeros(n)
        if "friction" in names:
            for a in range(n):
                fc, fs, vs, stiffness = (
                    servo.per_axis(f"friction_{name}")[a] for name in ("torque", "static", "speed", "stiffness")
                )
                level = fc + (fs - fc) * math.exp(-((v[a] / vs) ** 2))
                z, travel = state["bristle"][a], v[a] * T
                if travel:
                    decay = math.exp(-stiffness * abs(travel) / level)
                    z = z * decay + math.copysign(level, travel) * (1 - decay)
                state["bristle"][a] = rub[a] = z
            torque = torque + rub
        if "observer" in names:
            # positions fitted by a parabola, the torques by where they act
            y = [*[past[0]] * 2, *past][-3:]
            acted = np.array(servo.per_axis("observer_inertia")) * (y[0] - 2 * y[1] + y[2]) / T**2
            acted += np.array(servo.per_axis("observer_viscous")) * (y[2] - y[1]) / T
            for a in range(n):
                late = servo.delay / T + servo.feedback_delay + servo.laws.parameters[a].observer_lag / T
                for j, u in enumerate(reversed(told), 1):
                    acted[a] -= pulse(j - late) * u[a]
            raw.append(acted)
            seen = np.array(raw)
            out = np.zeros(n)
            for a in range(n):
                b, c = Q[a]
                terms = sum(b[k] * seen[-1 - k, a] for k in range(min(3, len(seen))))
                terms -= sum(c[k] * smoothed[-k][a] for k in range(1, min(3, len(smoothed) + 1)))
                out[a] = terms
            smoothed.append(out)
            torque = torque - out
        told.append(np.clip(torque, -np.array(servo.per_axis("torque_limit")), servo.per_axis("torque_limit")) - rub)
        return torque

    return law


def pulse(age):
    """Share in a second difference of a torque held for a period that began `age` periods ago (quadratic B-spline)."""
    x = abs(age - 1.5)
    if x < 0.5:
        return 0.75 - x**2
    return 0.5 * (1.5 - x) ** 2 if x < 1.5 else 0.0


@pytest.mark.parametrize(
    "names",
    suite_runs(
        [
            ["p-pi"],
            ["pid", "friction"],
            ["pid", "observer"],
            ["pid", "contour"],
            ["p-pi", "friction", "observer", "contour"],
        ],
        0,
        2,
        4,
    ),
    ids="+".join,
)
@pytest.mark.first
def test_the_tick_computes_the_laws(xy, names):
    late = {"delay": 2.5e-4} if "observer" in names else {}
    servo = Servo.derive(xy.axes, law=names, notch_frequency=0.0, integral_time=0.1, **late)
    compiled = simulate(xy, servo, curve())
    by_python = simulate(xy, servo, curve(), law=by_hand(servo, names))
    assert compiled.fault is None
    np.testing.assert_allclose(by_python.demand, compiled.demand, rtol=0, atol=SAME)
    plain = simulate(xy, dataclasses.replace(Servo.derive(xy.axes, notch_frequency=0.0, integral_time=0.1)), curve())
    assert np.abs(plain.demand - compiled.demand).max() > 1e-3


def test_pid_alone_needs_no_entries(xy):
    for law in ("pid", "pd"):
        servo = Servo.derive(xy.axes, law=law)
        assert law_entries(servo) is None
        assert law_stages(servo, None, None) == []


def kicked(machine, servo, factor):
    """Whether a kick grows where the motors give a multiple of their torque."""
    strong = machine.perturbed(Perturbation(friction=1e-15, motor_constant=factor))
    position = np.zeros((900, 2))
    position[1:] = 1e-6
    setpoints = dataclasses.replace(curve(), position=position, dispense=np.zeros(900, bool))
    run = simulate(strong, servo, setpoints, physics_step=FINE)
    error = np.abs(run.commanded - run.motor)
    return run.fault is not None or np.any(error[-60:].max(axis=0) > error[400:460].max(axis=0))


@pytest.mark.parametrize("law", suite_runs(["p-pi", "observer"], 0))
def test_margins_are_those_of_the_loop_with_its_law(xy, law):
    """The gain margin is where a kick begins to grow."""
    given = {"law": law, "resolution": 0.0, "notch_frequency": 0.0, "frequency": 10.0, "integral_time": 0.01}
    servo = Servo.derive(xy.axes, feedforward=0.0, **given)
    if law == "observer":
        servo = servo.with_values(observer_bandwidth=(150.0, 150.0))
    gain = min(margins.gain for margins in margins_of(xy, servo))
    plain = Servo.derive(xy.axes, feedforward=0.0, **{**given, "law": "pid"})
    assert gain < (1 - 1.5 * NEAR) * min(margins.gain for margins in margins_of(xy, plain))
    assert not kicked(xy, servo, gain * (1 - NEAR))
    assert kicked(xy, servo, gain * (1 + NEAR))


def test_an_observer_takes_a_constant_disturbance_away_where_pd_does_not(rigid):
    """Under a constant force F, here of a tilted machine, PD rests at F / kp."""

    def tilt(spec):
        spec.option.gravity = [0.5, 0, 0]

    machine = rigid().edited(tilt)
    force = 0.5 * 1e-3 * machine.axes[0].scale * machine.physics.body("carriage").mass[0]  # N·m at the motor, mm/rad
    still = dataclasses.replace(curve(), position=np.zeros((900, 2)), dispense=np.zeros(900, bool))
    ends = {}
    for law in ("pd", ["pd", "observer"]):
        servo = Servo.derive(machine.axes, law=law, resolution=0.0)
        ends[str(law)] = simulate(machine, servo, still).encoder[-1, 0]
    assert ends["pd"] == pytest.approx(force / servo.gains[0].kp, rel=1e-3)
    assert abs(ends["['pd', 'observer']"]) < 1e-4 * ends["pd"]


def without_phase(values, bandwidth):
    """Butterworth of second order, forwards and backwards over values at rest at both ends."""
    padded = np.pad(values, ((600, 600), (0, 0)), "edge")
    return filtfilt(*butter(2, 2 * PERIOD * bandwidth), padded, axis=0, padlen=0)[600:-600]


@pytest.mark.parametrize("given", [{}, {"law": ["p-pi"], "delay": 5e-4, "feedback_delay": 1}, {"feedback": "load"}])
def test_preview_makes_the_encoders_read_their_filtered_setpoints(frictionless, given):
    law = [*given.get("law", []), "preview"]
    given = {**given, "law": law, "preview_bandwidth": 40.0, "resolution": 0.0, "integral_time": 0.1}
    servo = Servo.derive(frictionless.axes, **given)
    setpoints = curve(0.2, size=0.4)
    plain = simulate(frictionless, servo.with_values(law=servo.laws.names[:1], preview_bandwidth=0.0), setpoints)
    run = simulate(frictionless, servo, setpoints, physics_step=FINE)
    wanted = without_phase(setpoints.position, 40.0)
    before = np.abs(plain.encoder - wanted).max()
    assert np.abs(setpoints.position - wanted).max() > 4e-3
    assert np.abs(run.encoder - wanted).max() < 0.1 * before
    assert np.abs(run.encoder - wanted).max() < 5e-4


def test_learning_takes_away_of_a_linear_machine_s_error_what_q_passes(frictionless):
    """e after j repeats is (1 - Q)^j e before the first."""
    servo = Servo.derive(
        frictionless.axes, law="learning", feedforward=0.0, resolution=0.0, learning_bandwidth=30.0, learning_repeats=3
    )
    setpoints = curve(0.2, size=0.4)
    from gantrysim.engine.advance import Stepper

    traces = []

    def run(simulations):
        done = []
        for one in simulations:
            stepper = Stepper(one)
            stepper.advance()
            done.append(stepper.run)
        return done

    simulation = Simulation.of(frictionless, servo, setpoints, physics_step=FINE)
    run_and_learn([simulation], run, lambda _, __, error: traces.append(error))
    assert len(traces) == 4
    expected = traces[0]
    for seen in traces[1:4]:
        expected = expected - without_phase(expected, 30.0)
        np.testing.assert_allclose(seen, expected, atol=LINEAR * np.abs(traces[0]).max())
    assert np.abs(traces[1]).max() < 0.2 * np.abs(traces[0]).max()


def strong(servo, factor):
    """The servo with a model of motors that are weaker by a factor than the machine's."""
    weak = tuple(dataclasses.replace(motion, B=motion.B / factor) for motion in servo.laws.motions)
    return servo.with_values(motions=weak)


def test_learning_with_a_wrong_model_ends_no_worse_than_it_begins(frictionless):
    """With a model four times too weak every step is four times too large: the error would grow threefold a repeat."""
    given = {"law": "learning", "feedforward": 0.0, "learning_repeats": 6, "torque_limit": 1e3}
    servo = strong(Servo.derive(frictionless.axes, **given), 4.0)
    plain = simulate(frictionless, servo.with_values(law=("pid",), learning_bandwidth=0.0), curve(0.2, size=0.4))
    run = simulate(frictionless, servo, curve(0.2, size=0.4))
    before, after = (np.sqrt(np.mean((one.commanded - one.encoder) ** 2)) for one in (plain, run))
    assert run.fault is None
    assert after < before


@pytest.mark.parametrize("given", [{"feedback": "load"}, {"current_bandwidth": 1000.0}], ids=["load", "current loop"])
def test_learning_knows_the_drives(xy, given):
    setpoints = curve(0.2, size=0.4)
    servo = Servo.derive(xy.axes, law="learning", integral_time=0.03, learning_repeats=3, **given)
    run = simulate(xy, servo, setpoints)
    plain = simulate(xy, servo.with_values(law=("pid",), learning_bandwidth=0.0), setpoints)
    before, after = (np.sqrt(np.mean((one.commanded - one.encoder) ** 2)) for one in (plain, run))
    assert run.fault is None
    assert after < 0.5 * before


def test_a_fault_in_the_first_run_leaves_nothing_to_learn(xy):
    servo = Servo.derive(xy.axes, law="learning", following_error_limit=1e-3)
    run = simulate(xy, servo, curve())
    assert run.fault.kind == "following error"
    alone, other = simulate_batch(xy, [servo, Servo.derive(xy.axes, law="learning", learning_repeats=1)], curve())
    assert alone.fault.time == run.fault.time
    assert other.fault is None


def test_a_run_that_is_too_long_to_learn_from_is_refused(xy, monkeypatch):
    monkeypatch.setattr("gantrysim.base.memory.LONG_RUN", 100)
    monkeypatch.setattr("gantrysim.engine.advance.MOST_STEPS", 100)
    with pytest.raises(
        InputError, match=r"law 'learning' over .* servo ticks: must be a run whose log fits into memory"
    ):
        simulate(xy, Servo.derive(xy.axes, law="learning"), curve())
    preview = Servo.derive(xy.axes, law=["preview", "friction", "observer"])
    long = simulate(xy, preview, curve())
    monkeypatch.undo()
    np.testing.assert_array_equal(long.demand, simulate(xy, preview, curve()).demand)


@pytest.mark.soak
def test_laws_on_a_closed_chain_and_at_gates():
    """Learning by a model about zero halves the error of a delta robot; a shaped stream waits at its gates."""
    errors = {}
    for law in ("friction", '["friction", "learning"]'):
        run = Job.load("delta-arc", [f"servo.law={law if '[' in law else repr(law)}", "learning_repeats=2"]).run()
        errors[law] = np.sqrt(np.mean((run.commanded - run.encoder) ** 2))
    assert errors['["friction", "learning"]'] < 0.5 * errors["friction"]
    with pytest.raises(InputError, match="its axes are not coordinates of its nozzle"):
        Job.load("delta-arc", ["servo.law='contour'"]).run()
    job = Job.load("softmc-helical", ["servo.law='zvd'", "shaper_frequency=60.0"])
    assert job.setpoints.gates.size == 8
    run = job.run()
    assert run.fault is None
    np.testing.assert_allclose(run.commanded[-1], Job.load("softmc-helical").follow().commanded[-1], atol=1e-9)


def test_a_batch_learns_and_previews_as_runs_alone_do(xy):
    servos = [
        Servo.derive(xy.axes, law=law, learning_repeats=repeats)
        for law, repeats in ((["learning", "friction"], 1), (["preview"], 1), (["pid"], 1), (["learning"], 2))
    ]
    told = []
    runs = simulate_batch(xy, servos, curve(), progress=told.append)
    for servo, run in zip(servos, runs, strict=True):
        np.testing.assert_array_equal(run.encoder, simulate(xy, servo, curve()).encoder)
    assert told[-1] == pytest.approx(1)
    assert told == sorted(told)
    shares = []
    simulate(xy, servos[3], curve(), progress=shares.append)
    assert shares[-1] == 1
    assert shares == sorted(shares)


def test_torques_sent_along_reach_the_demand_and_the_axis_they_are_of(xy):
    given = np.zeros((len(curve().position), 2))
    given[40:60, 1] = 0.01
    servo = Servo.derive(xy.axes)
    plain, fed = (simulate(xy, servo, dataclasses.replace(curve(), torque=torque)) for torque in (None, given))
    np.testing.assert_array_equal(fed.demand[:40], plain.demand[:40])
    np.testing.assert_allclose((fed.demand - plain.demand)[40], [0, 0.01], atol=1e-15)
    swapped = dataclasses.replace(curve(), axes=("y", "x"), position=curve().position[:, ::-1], torque=given[:, ::-1])
    np.testing.assert_array_equal(simulate(xy, servo, swapped).demand, fed.demand)
    with pytest.raises(InputError, match="torques of shape"):
        dataclasses.replace(curve(), torque=given[1:])


def test_shaping_calms_the_load_at_its_own_mode(frictionless):
    """What swings on after a short move, at a mode that the feedback from the motor does not damp."""
    left = {}
    setpoints = curve(0.06, 0.2, 0.05)
    for law in ("pid", "zvd"):
        servo = Servo.derive(frictionless.axes, law=law, resolution=0.0)
        run = simulate(frictionless, servo, setpoints, physics_step=FINE)
        swing = (run.nozzle[:, :2] - run.motor)[-195:]
        left[law] = np.ptp(swing, axis=0).max()
    assert servo.laws.parameters[0].shaper_frequency > 100
    assert left["zvd"] < 0.5 * left["pid"]


def test_friction_compensation_halves_the_peaks_and_learning_leaves_the_encoder_s_counts():
    """On a job as it is: counts of 1 µm have an rms of 0.29 µm."""
    rms, peak = {}, {}
    for law in ("pd", "pid", "friction", "learning"):
        job = Job.load("softmc-arc", [f'servo.law="{law}"'])
        error = 1e3 * (lambda run: run.commanded - run.encoder)(job.run())
        rms[law], peak[law] = float(np.sqrt(np.mean(error**2))), float(np.abs(error).max())
    assert rms["pd"] > 10 * rms["friction"]
    assert peak["pid"] > 2 * peak["friction"]
    assert rms["pid"] > 5 * rms["learning"]
    assert 0.29 < rms["learning"] < 0.8
