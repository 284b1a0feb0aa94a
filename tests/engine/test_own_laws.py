"""A user's own law, in plain Python or compiled: alone, in batches, jobs, margins, studies, tuner and environment."""

import os
import pickle
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

from gantrysim import InputError, Job, Servo, simulate, simulate_batch
from gantrysim.servo.laws.user import resolved_law
from gantrysim.servo.stability.margins import margins_of
from gantrysim.servo.stability.motion import UnknownLoopError

from support import own_laws
from support.runs import ramp
from support.soaked import suite_runs

SAME = 1e-10  # of two computations of one law
HERE = Path(own_laws.__file__)
FILE = f"{HERE}:compiled_pd"


@pytest.fixture(scope="module")
def pd(xy):
    return Servo.derive(xy.axes, law="pd", notch_frequency=0.0)


@pytest.mark.parametrize(
    "law",
    suite_runs([own_laws.pd, own_laws.compiled_pd, "support.own_laws:pd", "support.own_laws:compiled_pd", FILE], 0),
    ids=["python", "numba", "module", "compiled in a module", "file"],
)
def test_a_user_s_pd_is_pd(xy, pd, law):
    own = pd.with_values(law=(law,))
    setpoints = ramp(50.0, 20.0)
    reference = simulate(xy, pd, setpoints)
    np.testing.assert_allclose(simulate(xy, own, setpoints).demand, reference.demand, rtol=0, atol=SAME)
    for margins, known in zip(margins_of(xy, own), margins_of(xy, pd), strict=True):
        assert margins.gain == pytest.approx(known.gain, rel=1e-6)
        assert margins.phase == pytest.approx(known.phase, rel=1e-6)


def test_runs_of_a_batch_have_each_their_own_state(xy, pd):
    laws = [own_laws.pd, own_laws.compiled_pd, "pd", own_laws.pd]
    servos = [
        pd.with_values(law=(law,), kp=tuple((1 + 0.1 * k) * g for g in pd.per_axis("kp"))) for k, law in enumerate(laws)
    ]
    setpoints = ramp(50.0, 10.0)
    runs = simulate_batch(xy, servos, setpoints, threads=2)
    for servo, run in zip(servos, runs, strict=True):
        np.testing.assert_array_equal(run.encoder, simulate(xy, servo, setpoints).encoder)
    alike = servos[3].with_values(law=("pd",))
    np.testing.assert_allclose(runs[3].demand, simulate(xy, alike, setpoints).demand, rtol=0, atol=SAME)


def test_friction_is_added_to_a_user_s_law(xy, pd):
    laws = ("pd", "friction"), (own_laws.compiled_pd, "friction")
    servos = [Servo.derive(xy.axes, law=law, notch_frequency=0.0) for law in laws]
    known, own = (simulate(xy, servo, ramp(50.0, 10.0)) for servo in servos)
    np.testing.assert_allclose(own.demand, known.demand, rtol=0, atol=SAME)
    assert np.abs(own.demand - simulate(xy, pd, ramp(50.0, 10.0)).demand).max() > 1e-3


def test_margins_of_a_linear_law_are_exact(xy, pd):
    """PID with a lag: its transfer function, written anew."""
    servo = pd.with_values(law=(own_laws.lagged_pid,))
    z, T = np.exp(1j * np.linspace(0.01, np.pi, 30)), servo.period  # noqa: N806
    for a, law in enumerate(servo.compensators()):
        raw = servo.gains[a].kp * (1 + 20.0 * T / (1 - 1 / z)) + servo.gains[a].kd * (1 - 1 / z) / T
        np.testing.assert_allclose(law.response(z), raw * 0.7 / (1 - 0.3 / z), rtol=1e-6)
        assert len(law.A) <= 3


def test_margins_of_a_law_that_answers_late_are_exact(xy, pd):
    """0.3 kp / z / (1 - 0.7 / z), of order two at most: nothing of the kick comes out at its own tick."""
    servo = pd.with_values(law=(own_laws.late,))
    z = np.exp(1j * np.linspace(0.01, np.pi, 30))
    for a, law in enumerate(servo.compensators()):
        np.testing.assert_allclose(law.response(z), 0.3 * servo.gains[a].kp / z / (1 - 0.7 / z), rtol=1e-6)
        assert law.D == 0
        assert len(law.A) <= 2


@pytest.mark.parametrize("law", [own_laws.cubic, own_laws.coupled, own_laws.fading])
def test_margins_of_others_are_unknown(xy, pd, law):
    assert margins_of(xy, pd.with_values(law=(law,))) is None


def test_what_a_law_raises_reaches_the_caller_of_a_run_and_of_a_batch(xy, pd):
    servo = pd.with_values(law=(own_laws.broken,))
    for work in (
        lambda: simulate(xy, servo, ramp(50.0, 10.0)),
        lambda: simulate_batch(xy, [pd, servo], ramp(50.0, 10.0)),
    ):
        with pytest.raises(ZeroDivisionError, match="gain of nothing"):
            work()
    assert simulate(xy, pd, ramp(50.0, 5.0)).fault is None  # nothing is left behind


@pytest.mark.parametrize("batch", [False, True])
def test_ctrl_c_reaches_the_caller_wherever_it_falls(xy, pd, batch):
    servo, setpoints = pd.with_values(law=(own_laws.pd,)), ramp(1.0, 100.0)  # a run of many seconds
    for k in range(5):
        timer = threading.Timer(0.05 + 0.013 * k, lambda: os.kill(os.getpid(), signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            simulate_batch(xy, [servo, servo], setpoints) if batch else simulate(xy, servo, setpoints)
        timer.join()


def test_a_torque_that_is_no_number_is_a_fault(xy, pd):
    fault = simulate(xy, pd.with_values(law=(own_laws.nothing,)), ramp(50.0, 5.0)).fault
    assert fault.kind == "diverged"


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("law", [own_laws.bursting, own_laws.boundless, own_laws.nothing])
def test_a_law_whose_torques_are_not_finite_has_no_margins_and_its_run_a_fault_without_a_warning(xy, pd, law):
    servo = pd.with_values(law=(law,))
    assert margins_of(xy, servo) is None
    assert simulate(xy, servo, ramp(50.0, 5.0)).fault is not None
    with pytest.raises(UnknownLoopError, match="whose torques are not finite has no margins"):
        servo.compensators()


@pytest.mark.parametrize(
    ("law", "text"),
    [
        ("no_such_module_at_all:pd", "no_such_module_at_all cannot be imported"),
        ("support.own_laws:missing", "support.own_laws has no function 'missing'"),
        ("support.own_laws:number", "has no function 'number'"),
        ("/nowhere/laws.py:pd", "cannot be imported: FileNotFoundError"),
        (own_laws.uncompilable, "does not compile with numba"),
    ],
)
def test_a_law_that_cannot_be_had_is_one_line(xy, pd, law, text):
    with pytest.raises(InputError) as caught:
        simulate(xy, pd.with_values(law=(law,)), ramp(50.0, 5.0))
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_does_not_fit_a_user_s_law_is_refused(xy):
    for law in ([own_laws.pd, "preview"], [own_laws.pd, "learning"], ["support.own_laws:pd", "contour"]):
        with pytest.raises(InputError, match="needs a base law with a known response"):
            Servo.derive(xy.axes, law=law)
    with pytest.raises(InputError, match="must have at most one of"):
        Servo.derive(xy.axes, law=[own_laws.pd, "pid"])


def test_a_job_names_its_law_by_a_file_beside_it(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(HERE.read_text())
    text = Job.load("an225", ["turns=1"]).toml().replace('law = "pid"', 'law = ["mine.py:compiled_pd", "friction"]')
    (tmp_path / "job.toml").write_text(text)
    monkeypatch.chdir("/")
    job = Job.load(tmp_path / "job.toml", allow_code=True)
    run = job.run()
    assert run.fault is None
    assert job.margins[0].stable
    again = pickle.loads(pickle.dumps(job))
    np.testing.assert_array_equal(again.run().demand, run.demand)
    other = Job.load(tmp_path / "job.toml", ['servo.law=["pd", "friction"]', "integral_time=inf"])
    assert job.digest != other.digest


def test_names_stand_for_functions():
    assert resolved_law("support.own_laws:pd") is own_laws.pd
    assert resolved_law(own_laws.pd) is own_laws.pd
    assert resolved_law(FILE) is resolved_law(FILE)
