"""What each check of a log and of its fit admits: on both sides of its bound, for logs and fits that are made up."""

# ruff: noqa: N806 - matrices bear the letters of the equations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gantrysim import InputError, Machine
from gantrysim.identify.checks.finding import FRICTION, VISCOUS, NotIdentifiedError
from gantrysim.identify.checks.parameters import check_plausible, check_segments
from gantrysim.identify.checks.residual import PREDICTED, check_clipping, check_counts, check_residual
from gantrysim.identify.checks.sampling import (
    check_encoder,
    check_excitation,
    check_rate,
    check_sampling,
    check_torque,
    strokes,
)
from gantrysim.identify.checks.units import check_inertia, check_travel, inertia_hint, position_slips, torque_slips
from gantrysim.identify.friction_terms import COGGING, DIRECTION, LOAD, POSITION, SQUARE, STRIBECK, Motion, Term
from gantrysim.identify.instants import instants_of
from gantrysim.identify.model import model_of
from gantrysim.identify.result import Estimate, Sensitivity

MACHINE = Machine("xy")
AXIS = MACHINE.axes[1]
MODEL = model_of(MACHINE, 1)
PERIOD = 1e-3


def refused(check, *arguments):
    """Whether a check refuses, and says so of the axis."""
    try:
        check(*arguments)
    except NotIdentifiedError as error:
        return str(error).startswith(f"axis {AXIS.name}: ")
    return False


@pytest.mark.parametrize(("factor", "beyond"), [(1.19, False), (1.21, True)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_torque_may_exceed_the_peak_by_a_fifth(factor, sign, beyond):
    torque = np.array([0.0, sign * factor * AXIS.peak_torque, 0.1])
    assert refused(check_torque, AXIS, torque, math.nan) == beyond


@pytest.mark.parametrize(("factor", "beyond"), [(1.99, False), (2.01, True)])
def test_a_position_may_go_twice_as_far_as_the_axis(factor, beyond):
    low, high = AXIS.travel
    position = np.linspace(-7.0, factor * (high - low) - 7.0, 9)
    assert refused(check_travel, AXIS, position, math.nan) == beyond


@pytest.mark.parametrize(("ratio", "beyond"), [(4.9, False), (5.1, True), (0.21, False), (0.19, True), (1.0, False)])
def test_an_inertia_may_be_a_fifth_to_five_times_the_table_s(ratio, beyond):
    assert refused(check_inertia, AXIS, ratio) == beyond


@pytest.mark.parametrize(
    ("unit", "size"),
    [("mN·m", 1e3), ("N·cm", 100.0), ("ozf·in", 141.6), ("lbf·in", 8.851), ("kgf·m", 1 / 9.81), ("kN·m", 1e-3)],
)
def test_a_unit_of_torque_is_told_by_its_size(unit, size):
    """One newton metre in that unit; a machine may differ from its table by half, not by more."""
    for off in (1 / 1.45, 1.0, 1.45):
        assert unit in torque_slips(AXIS, off * size)
    for off in (1 / 3.0, 3.0):
        assert unit not in torque_slips(AXIS, off * size)
    assert torque_slips(AXIS, size)[0] == unit


def test_a_current_and_a_share_of_the_rated_torque_are_told_by_the_drive():
    """The peak is two to five times the rated torque: 100 % of that are a fifth to a half of the peak."""
    peak = AXIS.peak_torque
    assert f"A ({AXIS.motor_constant:g} N·m/A)" in torque_slips(AXIS, 1 / AXIS.motor_constant)
    for name, whole in (("% of the rated torque", 100.0), ("per mille of the rated torque", 1000.0)):
        for rated in (peak / 5, peak / 3, peak / 2):
            assert name in torque_slips(AXIS, whole / rated)
        for rated in (peak / 8, peak / 1.3):
            assert name not in torque_slips(AXIS, whole / rated)


@pytest.mark.parametrize(("unit", "size"), [("m", 1e-3), ("µm", 1e3), ("inches", 1 / 25.4)])
def test_a_unit_of_length_is_told_by_its_size(unit, size):
    assert position_slips(AXIS, size)[0] == unit
    assert unit not in position_slips(AXIS, 3 * size)
    # an inertia in N·m·s² per unit of the position
    assert f"position in {unit} read as mm" in inertia_hint(AXIS, 1 / size)


def test_a_unit_of_time_is_told_by_its_square():
    assert "time in ms read as s" in inertia_hint(AXIS, 1.2e6)
    assert "time" not in inertia_hint(AXIS, 1e3)


def test_the_motor_s_angle_and_counts_are_told_by_the_axis():
    """10 mm a turn: 0.1 turns, 36 degrees, 0.628 rad and 1000 counts of 1 µm make a millimetre."""
    assert pytest.approx(10 / math.tau) == AXIS.scale
    for unit, size in (("turns", 0.1), ("degrees", 36.0), ("rad", math.tau / 10)):
        assert f"{unit} of the motor" in position_slips(AXIS, size)
    assert "counts" in position_slips(AXIS, 1 / AXIS.resolution)
    turning = SimpleNamespace(unit="deg", scale=1.0, resolution=0.0)
    for unit, size in (("rad", math.pi / 180), ("turns", 1 / 360), ("mdeg", 1000.0)):
        assert unit in position_slips(turning, size)


def instants(time):
    return instants_of(np.ones(time.size, bool), time, None)


def test_time_stamps_may_be_off_by_a_share_of_the_period():
    time = 1e-3 * np.arange(200)
    assert instants(time + 5.0).period == pytest.approx(1e-3)
    for share, even in ((0.09, True), (0.12, False)):
        late = time.copy()
        late[40] += share * 1e-3
        if even:
            assert instants(late).period == pytest.approx(1e-3)
            continue
        with pytest.raises(InputError, match=r"at t = 0\.04\S* s one is off by 12 % of the period"):
            instants(late)
    parts = instants(np.delete(time, slice(60, 64)))
    assert (parts.period, parts.pieces) == (pytest.approx(1e-3), (slice(0, 60), slice(60, 196)))
    with pytest.raises(InputError, match="does not rise"):
        instants(np.repeat(time, 2))


@pytest.mark.parametrize(("factor", "beyond"), [(0.98, False), (1.02, True), (-0.98, False), (-1.02, True)])
def test_a_position_jumps_no_further_than_eight_times_what_the_peak_torque_does(factor, beyond):
    """In a sample, and by five counts; the time of the jump is that of the sample."""
    most = 8 * AXIS.peak_torque / MODEL.inertia * PERIOD**2 + 5 * AXIS.resolution
    position = 0.01 * np.arange(400.0)
    position[250:] += factor * most
    torque = np.zeros(400)
    assert refused(check_encoder, AXIS, MODEL, position, torque, PERIOD) == beyond
    if beyond:
        with pytest.raises(NotIdentifiedError, match=r"at 0\.(249|25) s of the log"):
            check_encoder(AXIS, MODEL, position, torque, PERIOD)


@pytest.mark.parametrize(("factor", "samples", "frozen"), [(0.98, 60, False), (1.02, 60, True), (1.02, 4, False)])
def test_a_position_stands_still_under_six_times_the_static_friction(factor, samples, frozen):
    """Or a tenth of the peak torque, and for five milliseconds; the first samples may answer to the last count."""
    bound = max(6 * MODEL.static, 0.1 * AXIS.peak_torque)
    steps = np.full(400, 0.01)
    steps[100 : 100 + samples] = 0.0
    position = np.cumsum(steps)
    torque = np.zeros(400)
    torque[100 + samples // 2 :] = factor * bound
    assert refused(check_encoder, AXIS, MODEL, position, torque, PERIOD) == frozen


@pytest.mark.parametrize(("count", "refuses"), [(1.2, False), (0.3, True)])
@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_an_axis_that_reverses_within_a_count_is_not_frozen(count, refuses, offset):
    """A torque beyond friction turns the axis by a t² / 2 before a count shows it, wherever a constant torque is."""
    bound = max(6 * MODEL.static, 0.1 * AXIS.peak_torque)
    torque = np.full(400, offset)
    # three samples of the standstill from 100 to 107 are driven
    torque[103:] += 1.5 * bound
    push = np.convolve(torque, np.ones(3) / 3, "same")[102:106] - offset
    moved = PERIOD**2 * np.cumsum(np.cumsum(np.maximum(push - bound, 0.0))) / MODEL.inertia
    step = count * moved[-1]
    assert step > AXIS.resolution
    steps = np.full(400, -step)
    steps[100:107] = 0.0
    steps[107:] = step
    assert refused(check_encoder, AXIS, MODEL, np.cumsum(steps), torque, PERIOD) == refuses


def back_and_forth(*lengths, step=0.1):
    """Positions of strokes of so many samples, to and fro."""
    steps = np.concatenate([np.full(length, step * (-1) ** k) for k, length in enumerate(lengths)])
    return np.concatenate([[0.0], np.cumsum(steps)])


def test_strokes_are_counted_between_reversals_without_the_jitter_of_counts():
    position = back_and_forth(5, 3, 7)
    assert strokes(position, 0.001).tolist() == [5, 3, 7]
    jitter = np.concatenate([position, position[-1] + 0.0019 * (np.arange(6) % 2)])
    assert strokes(jitter, 0.001).tolist() == [5, 3, 7]
    assert strokes(position, 0.06).size == 0
    assert strokes(position, 0.04).tolist() == [5, 3, 7]


@pytest.mark.parametrize(
    ("lengths", "slow"), [((2, 2, 2), True), ((2, 5, 2), True), ((2, 3, 3, 2), True), ((2, 7), False)]
)
def test_a_quarter_of_the_motion_may_be_in_strokes_of_two_samples(lengths, slow):
    assert refused(check_sampling, AXIS, back_and_forth(*lengths), PERIOD) == slow


def swinging(reversals=8, ratio=4.0, size=1.0):
    """An axis that goes to and fro, half of its samples slowly."""
    fast = [30] * (reversals + 1)
    quick = np.diff(back_and_forth(*fast, step=size))
    slowly = np.where(np.arange(30 * len(fast)) % 30 < 15, 1.0, 1 / ratio)
    position = np.concatenate([[0.0], np.cumsum(quick * slowly)])
    return np.concatenate([position, np.full(500, position[-1])])


@pytest.mark.parametrize(
    ("position", "told"),
    [
        (swinging(), ""),
        (swinging(reversals=5), "reversals = 5: must be at least 6"),
        (swinging(reversals=6), ""),
        (swinging(ratio=2.9), "2.9 times as fast as its slow ones: must be at least 3"),
        (swinging(ratio=3.1), ""),
        (0.19 * np.sin(np.arange(600) / 9) / 2, "hardly moves"),
        (np.zeros(600), "hardly moves, by 0 mm"),
    ],
)
def test_a_log_must_excite(position, told):
    torque = np.sin(np.arange(position.size))
    if not told:
        check_excitation(AXIS, position, torque)
        return
    with pytest.raises(NotIdentifiedError, match=told):
        check_excitation(AXIS, position, torque)


def test_a_torque_that_never_changes_excites_nothing():
    with pytest.raises(NotIdentifiedError, match=r"its torque is 0\.2 N·m throughout"):
        check_excitation(AXIS, swinging(), np.full(swinging().size, 0.2))


@pytest.mark.parametrize(("samples", "clipped"), [(10, False), (11, True)])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_torque_is_clipped_that_is_at_its_largest_in_more_than_a_hundredth(samples, sign, clipped):
    torque = 0.1 * np.sin(np.arange(1000))
    torque[:samples] = sign * 0.3 * (1 - 1e-7)
    torque[0] = sign * 0.3
    assert bool(check_clipping(SimpleNamespace(torque=torque)).findings) == clipped


def jumping(size, at=(300,)):
    """Innovations of a deviation of 1 µm of an encoder with counts of half a micrometre, with jumps."""
    innovations = 1e-3 * np.random.default_rng(1).standard_normal(2000)
    innovations = np.clip(innovations, -4e-3, 4e-3)
    innovations[list(at)] = size
    used = np.ones(2000, bool)
    used[-200:] = False
    return SimpleNamespace(innovations=innovations, used=used, expected=5e-4 / math.sqrt(12), unit="mm", starts=(0,))


@pytest.mark.parametrize("sign", [1, -1])
def test_a_jump_of_twelve_deviations_is_a_loss_of_counts(sign):
    """The deviation by the median is known to 3 %."""
    assert not check_counts(jumping(sign * 11.5e-3), PERIOD).findings
    (finding,) = check_counts(jumping(sign * 12.6e-3), PERIOD).findings
    assert "by up to 0.013 mm, 25 counts, once, first 0.3 s into the moves" in finding.reason


def test_jumps_within_a_fiftieth_of_a_second_are_one():
    (finding,) = check_counts(jumping(0.02, (300, 310, 319, 400)), PERIOD).findings
    assert "2 times, first 0.3 s" in finding.reason


def test_ten_counts_are_no_loss_however_quiet_the_rest_is():
    quiet = jumping(4.9e-3)
    quiet.innovations[np.abs(quiet.innovations) < 4.8e-3] *= 0.1
    assert not check_counts(quiet, PERIOD).findings
    quiet.innovations[300] = 5.1e-3
    assert check_counts(quiet, PERIOD).findings


def fit_with(estimates=None, **changes):
    """A fit that is beyond no reason, but for some changes of its model."""
    model = replace(MODEL, excess=0.3 * MODEL.coulomb, **changes)
    known = {
        "inertia": Estimate(model.inertia, 1e-6 * model.inertia),
        "viscous": Estimate(model.viscous, 1e-6),
        "coulomb": Estimate(model.coulomb, 1e-6),
        "delay": Estimate(2e-4, 1e-5),
        "excess": Estimate(0.006, 0.0006),
    }
    return SimpleNamespace(model=model, nominal=MODEL, estimates={**known, **(estimates or {})}, unit="mm")


PRESLIDING = MODEL.deflection * MODEL.scale


@pytest.mark.parametrize(
    ("fit", "values"),
    [
        (fit_with(), None),
        (fit_with(inertia=1.99 * MODEL.inertia), None),
        (fit_with(inertia=2.01 * MODEL.inertia), ()),
        (fit_with(inertia=0.51 * MODEL.inertia), None),
        (fit_with(inertia=0.49 * MODEL.inertia), ()),
        (fit_with(coulomb=9.9 * MODEL.coulomb), None),
        (fit_with(coulomb=10.1 * MODEL.coulomb), FRICTION),
        (fit_with(coulomb=0.101 * MODEL.coulomb), None),
        (fit_with(coulomb=0.099 * MODEL.coulomb), FRICTION),
        # zero within its interval is only not known; below zero with all of it, the friction is another one
        (fit_with({"viscous": Estimate(-1e-5, 1e-5)}, viscous=0.0), VISCOUS),
        (fit_with({"viscous": Estimate(-1e-5, 1e-6)}, viscous=0.0), FRICTION),
        # judged by the whole of the interval
        (fit_with({"inertia": Estimate(2.2 * MODEL.inertia, 0.15 * MODEL.inertia)}, inertia=2.2 * MODEL.inertia), None),
        (fit_with({"coulomb": Estimate(10.5 * MODEL.coulomb, MODEL.coulomb)}, coulomb=10.5 * MODEL.coulomb), None),
        (fit_with({"delay": Estimate(10.1e-3, 1e-4)}), None),
        (fit_with({"delay": Estimate(9.9e-3, 1e-5)}), None),
        (fit_with({"delay": Estimate(10.1e-3, 1e-5)}), ()),
        (fit_with({"delay": Estimate(-0.9e-4, 1e-5)}), None),
        (fit_with({"delay": Estimate(-1.1e-4, 1e-5)}), ()),
        (fit_with({"delay": Estimate(-1.1e-4, 1e-4)}), None),
        (fit_with({"gap": Estimate(1.0, 0.1)}, gap=2.1 * PRESLIDING), None),
        (fit_with({"gap": Estimate(1.0, 0.1)}, gap=1.9 * PRESLIDING), ("gap",)),
        (fit_with({"excess": Estimate(0.006, 0.02)}), ("static",)),
    ],
)
def test_a_fit_is_plausible_within_its_bounds(fit, values):
    findings = check_plausible(fit, PERIOD, fit.estimates)
    assert [set(finding.values) for finding in findings] == ([] if values is None else [set(values)])


@pytest.mark.parametrize(("delay", "said"), [(-MODEL.lag, True), (-1.05 * MODEL.lag, True), (-2.0 * MODEL.lag, False)])
def test_a_drive_without_the_lag_of_the_table_is_named(delay, said):
    """A plant that takes its torque at once, fitted with the winding's L/R, is early by that L/R."""
    fit = fit_with({"delay": Estimate(delay, 1e-5)})
    (finding,) = check_plausible(fit, PERIOD, fit.estimates)
    text = f"or the drive lacks the lag of {1e3 * MODEL.lag:.3g} ms that the machine's table gives its winding"
    assert (text in finding.reason) == said


def fit_that_differs_by_direction(**changes):
    """A fit to a stroke back and one forth, with parameters that would differ by shares of themselves in each."""
    n = 8000
    names = ("inertia", "delay", "viscous", "coulomb", "offset", "excess")
    values = np.array([MODEL.inertia, PERIOD, 1.0, 1.0, 1.0, 1.0])
    position = np.abs(np.linspace(-50.0, 50.0, n))
    forth = np.gradient(position) >= 0
    # columns that are orthogonal over any part of the log, so that each parameter is its column's mean
    jacobian = np.tile(np.eye(len(names) + 1), (n // (len(names) + 1) + 1, 1))[:n]
    residual = -np.where(forth, 1.0, -1.0) * (jacobian @ [*(changes.get(name, 0.0) for name in names), 0.0])
    residual *= 1 + 0.01 * np.where(np.arange(n) // 7 % 2, 1.0, -1.0)
    return SimpleNamespace(
        model=MODEL, position=position, torque=np.zeros(n), used=np.ones(n, bool), starts=(0,),
        sensitivity=Sensitivity(names, jacobian, values, residual),
    )  # fmt: skip


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("name", ["inertia", "delay"])
@pytest.mark.parametrize(("share", "beyond"), [(0.05, False), (0.094, False), (0.106, True), (0.5, True)])
def test_a_value_may_change_by_a_tenth_without_a_part_of_the_log(name, share, sign, beyond):
    """Of one stroke alone the estimate is its mean over it, and counts less by sqrt(1/2), as half the log tells it.

    A delay's tenth is of a period at least.
    """
    fit = fit_that_differs_by_direction(**{name: sign * share * math.sqrt(2)})
    doubt = check_segments(fit, PERIOD)
    size = MODEL.inertia if name == "inertia" else PERIOD
    assert doubt.deviations[name] == pytest.approx(share * size, rel=0.02)
    assert [finding.values for finding in doubt.findings] == ([(name,)] if beyond else [])
    if beyond:
        assert f"changes by {100 * share:.0f} % with a part of the log (direction) left out" in doubt.findings[0].reason


def noisy_fit(times=5.0, noise=0.1, colour=0.0, remainder=0.001):
    """A fit with a residual of so many counts, and its largest correlation, at a lag of one."""
    random = np.random.default_rng(2).standard_normal(20_001)
    # of a moving average a + b z^-1 the correlation is a b / (a² + b²)
    b = 0.0 if not colour else (1 - math.sqrt(1 - 4 * colour**2)) / (2 * colour)
    residual = random[1:] + b * random[:-1]
    expected = 1e-3
    position = np.arange(20_000.0)  # never at rest: what counts and noise explain is not known
    torque = np.where(np.arange(20_000) % 2, 1.0, -1.0)
    law = SimpleNamespace(remainder=remainder, size=1.0)
    residual *= times * expected / residual.std()
    return SimpleNamespace(
        axis="y", expected=expected, residual=residual, position=position, torque=torque, noise=noise, law=law
    )


@pytest.mark.parametrize(
    ("fit", "values"),
    [
        (noisy_fit(), None),
        (noisy_fit(times=14.9), None),
        (noisy_fit(times=15.1), ()),
        (noisy_fit(noise=0.149), None),
        (noisy_fit(noise=0.151), PREDICTED),
        (noisy_fit(noise=0.151, remainder=0.9), ()),
        (noisy_fit(noise=0.51), PREDICTED),
        (noisy_fit(colour=0.23), None),
        (noisy_fit(colour=0.27), PREDICTED),
        (noisy_fit(colour=0.27, remainder=0.9), ()),
        (noisy_fit(colour=0.49), PREDICTED),
    ],
)
def test_a_residual_is_noise_within_its_bounds(fit, values):
    findings = check_residual(fit, PERIOD).findings
    assert [finding.values for finding in findings] == ([] if values is None else [values])


def test_a_residual_of_a_hundred_counts_has_another_cause():
    check_residual(noisy_fit(times=99.0), PERIOD)
    with pytest.raises(NotIdentifiedError, match="axis y: the prediction of the position is wrong by 101 times"):
        check_residual(noisy_fit(times=101.0), PERIOD)


@pytest.mark.parametrize(
    ("shows", "share", "highest", "told"),
    [(False, 0.3, 0.9, True), (False, 0.3, 1.1, False), (True, 0.3, 0.9, False), (False, 0.0, 0.9, False)],
)
def test_a_mode_beyond_the_log_s_rate_is_told(shows, share, highest, told):
    nominal = replace(MODEL, share=share)
    fit = SimpleNamespace(shows_mode=shows, nominal=nominal, highest=highest * replace(MODEL, share=0.3).resonance)
    assert bool(check_rate(fit, PERIOD).findings) == told


def test_the_mode_of_a_model_is_that_of_two_masses_on_a_spring():
    """1 and 3 kg cm², 4000 N·m a unit: the reduced inertia is 0.75, the frequency sqrt(k / J) / 2 pi."""
    model = replace(MODEL, inertia=4e-4, share=0.75, stiffness=40.0, damping=0.01, viscous=0.0, lag=0.0)
    assert model.reduced == pytest.approx(0.75e-4)
    frequency = math.sqrt(40.0 / 0.75e-4) / math.tau
    assert model.resonance == pytest.approx(frequency)
    assert model.damping_ratio == pytest.approx(0.01 / (2 * math.sqrt(40.0 * 0.75e-4)))
    assert model.static == MODEL.coulomb + MODEL.excess
    A, B, E = model.matrices()
    swings = np.linalg.eigvals(A)
    swing = swings[swings.imag.argmax()]
    assert abs(swing) == pytest.approx(math.tau * frequency, rel=1e-6)
    assert -swing.real / abs(swing) == pytest.approx(model.damping_ratio, rel=1e-6)
    # far below the mode both masses move, far above it the motor alone; friction of the load acts on the load
    low, high = model.response(np.array([0.01 * frequency, 100 * frequency]))
    assert (low, high) == (pytest.approx(1 / 4e-4, rel=1e-3), pytest.approx(1 / 1e-4, rel=1e-2))
    assert B.tolist() == pytest.approx([0, 1e4, 0, 0])
    assert E.tolist() == pytest.approx([0, 1e4, 0, -1 / 3e-4])


def test_a_rigid_model_answers_by_its_inertia_drag_and_lag():
    model = replace(MODEL, inertia=4e-4, share=0.0, viscous=0.02, lag=1e-3)
    assert math.isnan(model.resonance)
    assert math.isnan(model.damping_ratio)
    s = 2j * math.pi * 30.0
    expected = abs(s / (4e-4 * s + 0.02) / (1 + 1e-3 * s))
    assert model.response(np.array([30.0])) == pytest.approx([expected])
    A, B, E = model.matrices()
    assert (A.tolist(), B.tolist(), E.tolist()) == ([[0, 1], [0, -50.0]], [0, 2500.0], [0, 0])


def test_terms_of_friction_are_their_formulas():
    motion = Motion(
        position=np.array([0.0, 2.5, 5.0, 7.5]),
        speed=np.array([3.0, -4.0, 0.5, 0.0]),
        calm=np.array([2.0, -4.0, 0.0, 1.0]),
        direction=np.array([1.0, -1.0, 1.0, -1.0]),
        torque=np.array([0.2, -0.3, -0.1, 0.4]),
        braking=np.array([0.2, -0.4, 0.1, -0.4]),
    )
    quarter = ([0, 1, 0, -1], [1, 0, -1, 0])  # sine and cosine over 10 mm
    expected = {
        Term(SQUARE): [[9, -16, 0.25, 0]],
        Term(LOAD): [[0.2, -0.4, 0.1, -0.4]],
        Term(STRIBECK, 2.0): [[math.exp(-1), -math.exp(-2), 1, -math.exp(-0.5)]],
        Term(POSITION, 10.0): [[0, -1, 0, 1], [1, 0, -1, 0]],
        Term(COGGING, 10.0): quarter,
    }
    for term, torques in expected.items():
        assert np.array(term.torques(motion)) == pytest.approx(np.array(torques), abs=1e-12), term


@pytest.mark.parametrize(
    ("term", "coefficients", "words"),
    [
        (Term(DIRECTION), [2e-6], "viscous friction by direction, 0.0004 N·m more forwards at 100 mm/s"),
        (Term(DIRECTION), [-2e-6], "viscous friction by direction, 0.0004 N·m more back at 100 mm/s"),
        (Term(SQUARE), [2e-6], "drag by the square of the speed, 0.02 N·m at 100 mm/s"),
        (Term(LOAD), [0.043], "friction by load, 4.3 % of the motor's torque"),
        (Term(STRIBECK, 12.0), [0.007], "Stribeck friction, 0.007 N·m more at rest, gone beyond 12 mm/s"),
        (Term(COGGING, 2.5), [0.003, -0.004], "cogging of 0.005 (± 0.0002) N·m over every 2.5 mm"),
        (Term(POSITION, 40.0), [0.003, -0.004], "friction over the travel, 20 (± 0.8) % every 40 mm"),
    ],
)
def test_terms_of_friction_are_told_in_words(term, coefficients, words):
    covariance = 1e-8 * np.eye(len(coefficients))
    assert term.words(np.array(coefficients), covariance, 0.025, 100.0, "mm") == words


@pytest.mark.parametrize(("unit", "size"), [("µm", 1e3), ("inches", 1 / 25.4), ("m", 1e-3)])
def test_a_position_too_far_is_in_the_unit_that_the_inertia_suggests(unit, size):
    """In a unit of which the millimetre has `size`, the inertia per unit is as much smaller."""
    low, high = AXIS.travel
    position = np.linspace(0.0, 2.5 * (high - low), 9)
    with pytest.raises(NotIdentifiedError, match=f"position in .*{unit}.* read as {AXIS.unit}") as error:
        check_travel(AXIS, position, 1 / size)
    assert str(error.value).partition("position in ")[2].startswith(unit)
