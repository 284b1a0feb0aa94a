"""The library of motors: sources, consistency, and torque against speed."""

import math
import tomllib
from importlib.resources import files

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError
from gantrysim.base.input_files import validated_model
from gantrysim.machine.design.library import Motor, Winding, largest_torque, motor_names, motor_of

from support.soaked import examples

CONTENT = tomllib.loads((files("gantrysim.machine.design") / "library.toml").read_text(encoding="utf-8"))
SERVOS = [name for name, data in CONTENT["motors"].items() if data["kind"] in ("brushed", "bldc")]
STEPPERS = [name for name, data in CONTENT["motors"].items() if "stepper" in data["kind"]]


def test_there_are_motors_of_every_kind():
    kinds = [motor["kind"] for motor in CONTENT["motors"].values()]
    assert len(kinds) >= 8
    assert set(kinds) == {"brushed", "bldc", "ac servo", "stepper", "closed-loop stepper"}
    assert motor_names() == sorted(CONTENT["motors"])


@pytest.mark.parametrize("table", ["motors", "encoders"])
def test_every_number_has_a_source_or_is_an_assumption(table):
    for name, entry in CONTENT[table].items():
        numbers, sources = set(entry) - {"kind", "sources"}, entry["sources"]
        assert "rest" in sources or numbers <= set(sources), name
        assert set(sources) - {"rest"} <= numbers, name
        assert all(len(text) > 5 for text in sources.values()), name


@pytest.mark.parametrize("name", SERVOS)
def test_a_catalogue_s_speed_and_stall_torque_follow_from_its_other_values(name):
    data = CONTENT["motors"][name]
    volt, k, ohm = data["voltage"], data["torque_constant"], data["resistance"]
    motor = motor_of(name)
    speed = (volt - ohm * data["no_load_current"]) / k * 30 / math.pi
    assert motor.computed_ratings["no_load_speed"] == pytest.approx(speed, rel=1e-12)
    if "no_load_speed" in data:
        assert data["no_load_speed"] == pytest.approx(speed, rel=0.015)
        assert data["stall_torque"] == pytest.approx(k * volt / ohm, rel=0.015)
    # the no-load torque of the current is that of both frictions at the no-load speed
    coulomb, viscous = motor.friction
    assert coulomb + viscous * speed * math.pi / 30 == pytest.approx(k * data["no_load_current"], rel=1e-9)


def test_the_re_25_s_remembered_no_load_speed_contradicts_its_other_values():
    """9550 rpm at 24 V stands in models/README.md; voltage, constant and resistance give 9760 rpm."""
    assert motor_of("maxon-re25-24").computed_ratings["no_load_speed"] == pytest.approx(9759, abs=1)
    data = {**CONTENT["motors"]["maxon-re25-24"], "no_load_speed": 9550.0}
    with pytest.raises(InputError, match=r"no_load_speed = 9550 rpm: voltage, .* give 9759 rpm; correct one"):
        validated_model(Motor, data, "motor")


@pytest.mark.parametrize("name", STEPPERS)
def test_a_stepper_s_copper_loss_at_its_holding_torque_is_that_of_two_phases(name):
    data, motor = CONTENT["motors"][name], motor_of(name)
    current = motor.continuous / motor.K
    assert motor.resistance * current**2 == pytest.approx(2 * data["resistance"] * data["rated_current"] ** 2)
    assert motor.torque_at(0.0, data["voltage"], motor.current) == pytest.approx(data["holding_torque"])


@examples(60)
@given(k=st.floats(0.01, 0.5), ohm=st.floats(0.1, 5), volt=st.floats(12, 80), share=st.floats(0, 0.99))
def test_a_brushed_motor_s_torque_falls_with_its_speed(k, ohm, volt, share):
    speed = share * volt / k
    winding = Winding(k, ohm, 1e-3, 0)
    assert largest_torque(winding, speed, volt, math.inf) == pytest.approx(k * (volt - k * speed) / ohm)
    assert largest_torque(winding, speed, volt, 1e-3) == pytest.approx(min(k * 1e-3, k * (volt - k * speed) / ohm))


@examples(60)
@given(k=st.floats(0.1, 0.5), ohm=st.floats(0.3, 3), henry=st.floats(1e-3, 6e-3), speed=st.floats(0, 60))
def test_a_stepper_s_pull_out_torque(k, ohm, henry, speed):
    """K V / |Z| - K² w R / |Z|² of a voltage-driven two-phase motor, over all load angles up to 90 degrees."""
    volt, reactance = 36.0, 50 * speed * henry
    z = math.hypot(ohm, reactance)
    load = np.linspace(0, math.pi, 200_001)  # of the voltage ahead of the back-EMF, solved for the current
    v_q, v_d = volt * np.cos(load) - k * speed, -volt * np.sin(load)
    torque = k * (ohm * v_q - reactance * v_d) / z**2
    assert torque.max() == pytest.approx(k * volt / z - k**2 * speed * ohm / z**2, rel=1e-6)
    if torque.max() > 0.05:
        assert largest_torque(Winding(k, ohm, henry, 50), speed, volt, math.inf) == pytest.approx(
            torque.max(), rel=1e-4
        )


def test_a_motor_of_its_own_and_its_mistakes():
    own = {key: CONTENT["motors"]["maxon-re40-24"][key] for key in CONTENT["motors"]["maxon-re40-24"]}
    assert motor_of(own).K == 0.0302
    for change, text in (
        ({"stall_torque": 3.0}, "stall_torque = 3 N·m: voltage, .* give 2.424 N·m"),
        ({"torque_constant": None}, "torque_constant of a brushed motor missing"),
        ({"kind": "stepper", "torque_constant": None}, "holding_torque and rated_current of a stepper motor missing"),
        ({"resistance": 0}, "resistance = 0: .*greater than 0"),
        ({"weight": 1}, "unknown key weight"),
    ):
        with pytest.raises(InputError, match=text):
            motor_of({**own, **change})
    with pytest.raises(InputError, match="unknown motor 'maxon-re40': did you mean maxon-re40-"):
        motor_of("maxon-re40")
