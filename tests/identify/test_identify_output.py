"""What is told and written of an identification, of fits that are made up."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from gantrysim import Machine
from gantrysim.identify.checks.finding import Finding
from gantrysim.identify.checks.judgement import Judgement
from gantrysim.identify.identification import Identification, friction_words, verdict
from gantrysim.identify.model import model_of
from gantrysim.identify.output import content, values_table
from gantrysim.identify.plan import strokes
from gantrysim.identify.result import AxisFit, Estimate
from gantrysim.identify.whole_run import WholeRun

MACHINE = Machine("xy")
TABLE = model_of(MACHINE, 1)
PERIOD = 1e-3
COUNT = 2e-3  # [mm]


def estimates_of(model, share=0.02):
    """Parameters known to a share of their values."""
    names = ("inertia", "viscous", "coulomb", "excess", "static", "offset", "delay", "share", "stiffness", "damping")
    values = {name: float(getattr(model, name)) for name in names}
    return {name: Estimate(value, share * abs(value)) for name, value in values.items()}


def fit_of(axis="y", unit="mm", highest=500.0, residual=None, words=(), **changes):
    model = replace(TABLE, offset=0.003, delay=2e-4, **changes)
    residual = 1e-3 * np.random.default_rng(4).standard_normal(5000) if residual is None else residual
    return AxisFit(
        axis=axis,
        unit=unit,
        nominal=TABLE,
        model=model,
        estimates=estimates_of(model),
        noise=0.0,
        expected=COUNT / math.sqrt(12),
        used=np.ones(residual.size, bool),
        innovations=residual,
        directions=np.ones(residual.size),
        start=(model.inertia, 0.0, 0.0),
        highest=highest,
        position=np.arange(float(residual.size)),
        torque=np.ones(residual.size),
        held=True,
        sensitivity=None,
        predicted=model,
        law=SimpleNamespace(words=words, terms=()),
    )


def identification(fit, *findings, estimates=None):
    found = Identification(MACHINE, PERIOD, (fit,))
    found.__dict__["judgements"] = (Judgement(estimates or fit.estimates, findings, PERIOD),)
    return found


def test_values_are_those_of_the_axis_in_si():
    """A slide of 10 mm a turn: torques over 1e-2 / 2 pi m are forces; the others are the motor's."""
    fit = fit_of(inertia=1.1 * TABLE.inertia)
    values = {value.name: value for value in identification(fit).values}
    metres = 1e-2 / math.tau  # of travel per radian of the motor
    for name, unit in (("inertia", "kg"), ("viscous", "N·s/m"), ("stiffness", "N/m"), ("damping", "N·s/m")):
        assert values[name].unit == unit
        at_motor = getattr(fit.model, name)  # [N·m per mm of travel]
        assert values[name].value == pytest.approx(1e3 * at_motor / metres)
        assert values[name].nominal == pytest.approx(1e3 * getattr(TABLE, name) / metres)
    for name in ("coulomb", "static", "offset", "delay", "share"):
        assert values[name].value == getattr(fit.model, name)
    inertia = values["inertia"]
    assert inertia.value / inertia.nominal == pytest.approx(1.1)
    assert (inertia.low, inertia.high) == pytest.approx((inertia.value * (1 - 0.0392), inertia.value * (1 + 0.0392)))
    assert all(value.identified and not value.reason for value in values.values())
    hinge = {value.name: value for value in identification(replace(fit, unit="deg")).values}
    assert hinge["stiffness"].unit == "N·m/rad"
    assert hinge["stiffness"].value == pytest.approx((180 / math.pi) ** 2 * fit.model.stiffness / fit.model.scale)


@pytest.mark.parametrize(
    ("share", "damping_too", "coulomb_too"), [(0.07, True, True), (0.08, True, False), (0.2, True, False), (0.21, 0, 0)]
)
def test_a_value_is_identified_to_15_percent_a_damping_to_40(share, damping_too, coulomb_too):
    """Half an interval is 1.96 deviations."""
    found = identification(fit_of(), estimates=estimates_of(fit_of().model, share))
    values = {value.name: value for value in found.values}
    assert values["damping"].identified == bool(damping_too)
    assert values["coulomb"].identified == bool(coulomb_too)
    assert values["coulomb"].reason == ("" if coulomb_too else "interval")


def test_a_check_forbids_its_values_and_one_without_values_all():
    forbidding = Finding("drag", ("viscous", "coulomb"), "it varies")
    found = identification(fit_of(), forbidding, Finding("drag", ("viscous",), "twice"))
    values = {value.name: value for value in found.values}
    assert {name for name, value in values.items() if not value.identified} == {"viscous", "coulomb"}
    assert values["viscous"].reason == "drag"
    assert found.unidentified == []
    assert "y: viscous, coulomb are not identified: drag: it varies" in found.notes
    assert "y: viscous is not identified: drag: twice" in found.notes
    nothing = identification(fit_of(), forbidding, Finding("clock", (), "it runs backwards"))
    assert not any(value.identified for value in nothing.values)
    assert nothing.unidentified == ["axis y: it runs backwards"]
    assert "y: no value is identified: clock: it runs backwards" in nothing.notes


def test_the_machine_written_has_what_is_identified():
    model = {name: 1.2 * getattr(TABLE, name) for name in ("inertia", "viscous", "coulomb", "stiffness", "damping")}
    fit = fit_of(**model, excess=0.01, share=0.9 * TABLE.share)
    (accepted,) = identification(fit).accepted
    for name in ("inertia", "viscous", "coulomb", "stiffness", "damping", "share"):
        assert getattr(accepted.model, name) == getattr(fit.model, name)
    assert accepted.model.static == pytest.approx(fit.model.static)
    assert accepted.model.offset == fit.model.offset
    (without_mode,) = identification(fit, Finding("m", ("share",), "")).accepted
    assert (without_mode.model.stiffness, without_mode.model.share) == (TABLE.stiffness, TABLE.share)
    assert without_mode.model.inertia == fit.model.inertia
    assert not {"share", "stiffness", "damping"} & set(without_mode.estimates)
    (undamped,) = identification(fit, Finding("m", ("damping",), "")).accepted
    assert (undamped.model.stiffness, undamped.model.damping) == (fit.model.stiffness, TABLE.damping)
    # correlated values are adopted together or not at all
    (no_friction,) = identification(fit, Finding("m", ("coulomb",), "")).accepted
    for name in ("coulomb", "static", "viscous", "offset"):
        assert getattr(no_friction.model, name) == getattr(TABLE, name), name
    wide = {**estimates_of(fit.model), "viscous": Estimate(fit.model.viscous, 0.3 * fit.model.viscous)}
    (wider,) = identification(fit, estimates=wide).accepted
    assert wider.model.viscous == fit.model.viscous
    # static friction that the log does not show keeps its ratio
    (no_static,) = identification(fit, Finding("m", ("static",), "")).accepted
    assert no_static.model.static / no_static.model.coulomb == pytest.approx(TABLE.static / TABLE.coulomb)


def test_no_constant_torque_and_no_delay_are_known_too():
    """Zero, known to 5 % of the Coulomb friction and to a tenth of the period."""
    model = replace(fit_of().model, offset=0.0, delay=0.0)
    fit = replace(fit_of(), model=model)
    for share, known in ((0.95, True), (1.05, False)):
        half = {"offset": 0.05 * model.coulomb * share / 1.96, "delay": 0.1 * PERIOD * share / 1.96}
        estimates = estimates_of(model) | {name: Estimate(0.0, deviation) for name, deviation in half.items()}
        values = {value.name: value for value in identification(fit, estimates=estimates).values}
        assert (values["offset"].identified, values["delay"].identified) == (known, known)


@pytest.mark.parametrize(("reach", "shows"), [(0.86, False), (0.84, True)])
def test_a_mode_shows_up_to_85_percent_of_the_log_s_reach(reach, shows):
    found = identification(fit_of(highest=TABLE.resonance / reach))
    values = {value.name: value for value in found.values}
    assert values["stiffness"].identified == shows
    assert values["stiffness"].reason == ("" if shows else "beyond the log's rate")
    assert any("the MJCF's stays" in note for note in found.notes) != shows


def test_the_file_of_values_holds_all_that_is_told():
    fit = fit_of()
    found = identification(fit, Finding("drag", ("viscous",), "it varies"))
    runs = [
        WholeRun("y", torque=0.2, written=0.01, nominal=math.nan, counts=3.0),
        WholeRun("x", missing="x jammed"),
        WholeRun("z", torque=0.2, written=0.03, fitted=0.02, nominal=0.1, counts=3.0),
    ]
    written = content(found, runs)
    assert written["whole_run"] == {
        "y": {"torque": 0.2, "written": 0.01, "counts": 3.0, "repeats": True},
        "x": {"missing": "x jammed"},
        "z": {"torque": 0.2, "written": 0.03, "fitted": 0.02, "nominal": 0.1, "counts": 3.0, "repeats": False},
    }
    assert "whole_run" not in content(found)
    axis = written["axes"]["y"]
    assert axis["mode"] == {"frequency": fit.model.resonance, "damping_ratio": fit.model.damping_ratio}
    inertia = next(value for value in found.values if value.name == "inertia")
    assert axis["inertia"] == {
        "value": inertia.value,
        "interval": [inertia.low, inertia.high],
        "nominal": inertia.nominal,
        "unit": "kg",
        "identified": True,
    }
    assert (axis["viscous"]["identified"], axis["viscous"]["reason"]) == (False, "drag")
    assert "mode" not in content(identification(replace(fit, model=replace(fit.model, share=0.0))))["axes"]["y"]


def test_the_table_of_values_names_each_axis_once():
    found = Identification(MACHINE, PERIOD, (fit_of("x"), fit_of("y")))
    found.__dict__["judgements"] = tuple(Judgement(fit.estimates, (), PERIOD) for fit in found.fits)
    table = values_table(found)
    axes, quantities, nominal, fitted, half, units, words = (list(column.cells) for column in table.columns)
    assert [axis for axis in axes if axis] == ["x", "y"]
    assert axes.index("y") == len(axes) // 2
    row = quantities.index("Coulomb friction")
    assert (nominal[row], fitted[row], units[row]) == (f"{TABLE.coulomb:.4g}", f"{TABLE.coulomb:.4g}", "N·m")
    assert half[row] == f"{1.96 * 0.02 * TABLE.coulomb:.2g}"
    assert words[row] == "identified"


def test_a_run_is_told_in_a_sentence():
    run = WholeRun(
        "y", torque=0.2, written=0.01, fitted=0.008, nominal=0.05, counts=3.21, adopted="inertia and friction"
    )
    assert run.repeats
    assert run.sentence == (
        "y: simulated over the whole run under the log's torque of 0.2 N·m rms, the machine written, with inertia and "
        "friction of this log, takes 5 % more or less, 10 mN·m rms, to stay within 3.2 counts rms of the log; with "
        "every fitted value, identified or not, 4 %; the nominal machine takes 25 %"
    )
    assert replace(run, written=0.02).repeats
    poor = replace(run, written=0.0201, nominal=math.nan, lacking=("cogging", "drag"))
    assert not poor.repeats
    assert poor.sentence.endswith(
        "identified or not, 4 %; must be at most 10 %: the machine written does not repeat the run; no machine holds: "
        "cogging, drag"
    )
    # where nothing is taken from the log, the nominal machine is not called another one
    nothing = replace(run, adopted="", written=0.05, fitted=3.0)
    assert nothing.sentence.endswith(
        "the nominal machine takes 25 % more or less, 50 mN·m rms, to stay within 3.2 counts rms of the log; with "
        "every fitted value, identified or not, 15 times the torque; must be at most 10 %: the nominal machine does "
        "not repeat the run"
    )
    assert WholeRun("y", missing="x jammed").sentence == "y: whole run not simulated: x jammed"


@pytest.mark.parametrize(("share", "told"), [(0.21, "with presliding over"), (0.19, "without presliding")])
def test_the_friction_is_told_in_words(share, told):
    fit = fit_of(words=("cogging of a size",), deflection=share * TABLE.deflection)
    sentence = friction_words(fit)
    assert sentence.startswith("y: friction by the log: Coulomb and viscous, cogging of a size; ")
    assert told in sentence
    if share > 0.2:
        assert sentence.endswith(f" {1e3 * share * TABLE.deflection * TABLE.scale:.2g} µm")


def test_a_white_residual_speaks_for_the_structure_and_a_wave_in_it_against():
    """A deviation of 1 µm is half a count."""
    white = fit_of()
    assert "y: the residual is 0.5 counts rms and white" in verdict(white, PERIOD, doubted=False)
    assert verdict(white, PERIOD, doubted=False).endswith(": the structure of the model holds")
    assert verdict(white, PERIOD, doubted=True).endswith("but a check above doubts the model")
    gapped = replace(white, estimates={**white.estimates, "gap": Estimate(0.02, 0.001)})
    gapped = replace(gapped, model=replace(white.model, gap=0.02))
    assert verdict(gapped, PERIOD, doubted=False).endswith("holds, with a backlash of about 20 µm")
    wave = white.residual + 1e-3 * np.sin(2 * np.pi * 40.0 * PERIOD * np.arange(5000))
    coloured = verdict(fit_of(residual=wave), PERIOD, doubted=False)
    assert "and not white" in coloured
    assert coloured.endswith("is wrong, most at 39 Hz; a second mode or another friction may be missing")


@pytest.mark.parametrize(("rho", "named"), [(0.55, False), (0.64, True)])
def test_a_frequency_is_named_that_stands_out_by_a_factor_of_eight(rho, named):
    """The spectrum of an autoregressive residual has (1 + rho²) / (1 - rho)² times its median at its lowest bin."""
    assert ((1 + rho**2) / (1 - rho) ** 2 > 8) == named
    residual = 1e-3 * lfilter([1.0], [1.0, -rho], np.random.default_rng(6).standard_normal(200_000))
    assert (", most at " in verdict(fit_of(residual=residual), PERIOD, doubted=False)) == named


def test_the_strokes_of_a_plan_keep_to_room_speed_and_torque():
    """Against the axis' own numbers: 35 % of the travel, half the speed, 40 % of the torque left by friction."""
    for index, axis in enumerate(MACHINE.axes):
        moves = [stroke for stroke in strokes(MACHINE) if stroke.axis == axis.name]
        low, high = axis.travel
        room = min(80.0, 0.35 * (high - low), 0.9 * max(high, -low))
        strongest = 0.4 * (axis.peak_torque - axis.coulomb) / axis.inertia
        assert max(abs(stroke.distance) for stroke in moves) == pytest.approx(room, rel=5e-3)
        assert max(stroke.acceleration for stroke in moves) == pytest.approx(strongest, rel=5e-3)
        fastest = min(0.5 * axis.speed_limit, math.sqrt(room * strongest / 2))
        assert max(stroke.speed for stroke in moves) == pytest.approx(fastest, rel=5e-3)
        model = model_of(MACHINE, index)
        slowest = min(0.5 * model.stribeck * model.scale, 0.1 * fastest)
        assert moves[0].speed == pytest.approx(slowest, rel=5e-3)
        # six speeds in equal ratios, each of which cruises for 0.3 s where there is room
        speeds = np.array([stroke.speed for stroke in moves[:6]])
        assert np.diff(np.log(speeds)) == pytest.approx(math.log(fastest / slowest) / 5, rel=0.02)
        for stroke in moves[:6]:
            cruise = abs(stroke.distance) - stroke.speed**2 / stroke.acceleration
            assert cruise == pytest.approx(0.3 * stroke.speed, rel=0.02) or abs(stroke.distance) > 0.99 * room
        assert [stroke.acceleration for stroke in moves[6:9]] == pytest.approx(
            [0.25 * strongest, 0.5 * strongest, strongest], rel=5e-3
        )
        short = [abs(stroke.distance) for stroke in moves[9:]]
        assert len(short) == 160
        assert max(short) == pytest.approx(strongest * 0.03**2 / 4, rel=5e-3)
        assert min(short) == pytest.approx(0.02 * max(short), rel=0.01)
        assert len(set(short)) > 140  # each pass has strokes of its own
