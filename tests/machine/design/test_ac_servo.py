"""AC servo motors: a three-phase machine solved phase by phase against the equivalent DC motor, and their tables."""

import math
import tomllib
from importlib.resources import files

import numpy as np
import pytest

from gantrysim import InputError, Machine
from gantrysim.machine.design.library import motor_of

MOTORS = tomllib.loads((files("gantrysim.machine.design") / "library.toml").read_text(encoding="utf-8"))["motors"]
AC = {name: data for name, data in MOTORS.items() if data["kind"] == "ac servo"}
SHEET = MOTORS["wittenstein-premo-1d-320"]
MANUAL_TAU = {"delta-ecma-c10604": 0.53e-3, "yaskawa-sgmsh-10a": 0.87e-3}  # mechanical time constants [s]
PHASES = np.array([0, -2 * math.pi / 3, 2 * math.pi / 3])  # [rad]
TABLE = """
name = "ac"
arrangement = "bridge"
masses = {{ bridge = 6, carriage = 2 }}
[x]
travel = [-150, 150]
[x.drive]
motor = "{motor}"
encoder = "absolute-17-bit"
voltage = 320
{limit}
transmission = {{ kind = "screw", lead = 10, diameter = 12, length = 420, stiffness = 40 }}
[y]
travel = [-150, 150]
[y.drive]
motor = "{motor}"
encoder = "absolute-17-bit"
voltage = 320
{limit}
transmission = {{ kind = "screw", lead = 10, diameter = 12, length = 420, stiffness = 40 }}
"""


def three_phases(sheet, voltage, load, end, steps=6000):
    """Solve the phases of a star-connected motor from rest, with its drive's decoupled voltages, by Runge-Kutta.

    Nothing but the definitions of a data sheet: its resistance and inductance lie half in each phase, and its rms
    back-EMF between two terminals is sqrt(3/2) of a phase's amplitude.

    Args:
        sheet: values of the data sheet.
        voltage: amplitude between two terminals of the part in phase with the back-EMF [V].
        load: inertia of rotor and load [kg·m²].
        end: of the solution [s].
        steps: of the solution.

    Returns:
        Time [s], speed [rad/s], torque [N·m], phase currents (n, 3) [A], and the power at the terminals [W].
    """
    ohm = 0.5 * sheet["resistance_phase_to_phase"]
    henry = 0.5 * sheet["inductance_phase_to_phase"]
    flux = math.sqrt(2 / 3) * sheet["voltage_constant_rms"] * 60 / (2e3 * math.pi)  # V·s/rad of a phase
    poles = sheet["pole_pairs"]

    def terminals(state):
        angle, speed, currents = state[0], state[1], state[2:]
        shape = np.cos(poles * angle + PHASES)
        ahead = -np.sin(poles * angle + PHASES)
        torque_current = 2 / 3 * shape @ currents
        reactance = poles * speed * henry
        phase_voltage = voltage / math.sqrt(3) * shape + reactance * torque_current * ahead
        return phase_voltage, shape

    def rate(state):
        phase_voltage, shape = terminals(state)
        currents = state[2:]
        emf = flux * state[1] * shape
        torque = flux * shape @ currents  # power of the back-EMFs per speed
        return np.array([state[1], torque / load, *((phase_voltage - ohm * currents - emf) / henry)])

    times = np.linspace(0, end, steps + 1)
    step = times[1]
    states = np.zeros((steps + 1, 5))
    for k in range(steps):
        state = states[k]
        first = rate(state)
        second = rate(state + 0.5 * step * first)
        third = rate(state + 0.5 * step * second)
        fourth = rate(state + step * third)
        states[k + 1] = state + step / 6 * (first + 2 * second + 2 * third + fourth)
    currents = states[:, 2:]
    shapes = np.cos(poles * states[:, :1] + PHASES)
    torque = flux * (shapes * currents).sum(axis=1)
    power = np.array([terminals(state)[0] @ state[2:] for state in states])
    return times, states[:, 1], torque, currents, power


@pytest.fixture(scope="module")
def started():
    """A motor of a data sheet started at 100 V against ten times its rotor's inertia."""
    load = 10 * SHEET["rotor_inertia"]
    sheet = {**SHEET, "torque_constant_rms": math.sqrt(3) * SHEET["voltage_constant_rms"] * 60 / (2e3 * math.pi)}
    return sheet, load, three_phases(sheet, 100.0, load, 0.05)


@pytest.mark.validates(
    "AC servo motor: speed, torque, heat, power",
    "three phases, solved one by one",
    "1e-6 relative",
)
def test_the_phases_of_a_motor_move_as_its_equivalent_dc_motor(started):
    sheet, load, (times, speed, torque, currents, power) = started
    motor = motor_of({**sheet, "sources": {}})
    # closed form of a DC motor that starts its load: R, L, K and a constant voltage
    dynamics = np.array([[-motor.resistance, -motor.K], [motor.K, 0]]) / np.array([[motor.inductance], [load]])
    source = np.array([100.0 / motor.inductance, 0])
    values, vectors = np.linalg.eig(dynamics)
    steady = np.linalg.solve(dynamics, -source)
    weights = np.linalg.solve(vectors, -steady)
    current, dc_speed = (steady[:, None] + vectors @ (weights[:, None] * np.exp(values[:, None] * times))).real
    assert speed.max() > 200
    assert speed == pytest.approx(dc_speed, abs=1e-6 * speed.max())
    assert torque == pytest.approx(motor.K * current, abs=1e-6 * torque.max())
    # power at the terminals, copper loss and current: sqrt(3/2) A of the DC motor per A rms of a phase
    assert power == pytest.approx(100.0 * current, abs=1e-6 * power.max())
    copper = 0.5 * sheet["resistance_phase_to_phase"] * (currents**2).sum(axis=1)
    assert copper == pytest.approx(motor.resistance * current**2, abs=1e-6 * copper.max())
    rms = np.sqrt((currents**2).mean(axis=1))
    assert current == pytest.approx(math.sqrt(1.5) * rms, abs=1e-6 * current.max())
    # torque per A rms of the data sheet
    late = slice(100, None)
    assert torque[late] / rms[late] == pytest.approx(sheet["torque_constant_rms"], rel=1e-6)


def test_the_terminals_power_becomes_heat_motion_and_field(started):
    sheet, load, (times, speed, _, currents, power) = started
    ohm = 0.5 * sheet["resistance_phase_to_phase"]
    henry = 0.5 * sheet["inductance_phase_to_phase"]
    lost = ohm * (currents**2).sum(axis=1)
    supplied = np.sum(0.5 * (power[1:] + power[:-1]) * np.diff(times))
    heat = np.sum(0.5 * (lost[1:] + lost[:-1]) * np.diff(times))
    stored = 0.5 * load * speed[-1] ** 2 + 0.5 * henry * (currents[-1] ** 2).sum()
    assert supplied == pytest.approx(heat + stored, rel=1e-5)


@pytest.mark.parametrize("name", AC)
def test_a_data_sheet_s_other_values_agree(name):
    """Continuous and peak torque lie at currents of the data sheet; both forms of resistance give one motor."""
    data = AC[name]
    motor = motor_of(name)
    assert motor.kind == "ac servo"
    assert motor.K * motor.current == pytest.approx(data["peak_torque"], rel=1e-9)
    assert motor.current <= math.sqrt(1.5) * data["peak_current_rms"] * (1 + 1e-9)
    constant = motor.K
    assert constant == pytest.approx(data["torque_constant_rms"] * math.sqrt(2 / 3), rel=1e-9)
    if "resistance_phase_to_phase" in data:
        other = {key: value for key, value in data.items() if "phase_to_phase" not in key}
        other["resistance_per_phase"] = 0.5 * data["resistance_phase_to_phase"]
        other["inductance_per_phase"] = 0.5 * data["inductance_phase_to_phase"]
        assert motor_of(other) == motor
    else:  # the mechanical time constant 3 R J / KT² of the manuals
        tau = 3 * data["resistance_per_phase"] * data["rotor_inertia"] / data["torque_constant_rms"] ** 2
        assert motor.resistance * motor.rotor_inertia / motor.K**2 == pytest.approx(tau, rel=1e-9)
        assert tau == pytest.approx(MANUAL_TAU[name], rel=0.02)


def test_a_voltage_constant_alone_gives_the_torque_constant():
    alone = {key: value for key, value in SHEET.items() if key != "torque_constant_rms"}
    # the data sheet's own torque constant, rounded to two digits
    constant = motor_of(alone).K
    assert constant == pytest.approx(motor_of(SHEET).K, rel=0.013)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"voltage_constant_rms": 14.3},
            "14.3 V/krpm: .* gives 24.8 V/krpm .*; it looks like the rms from phase",
        ),
        ({"voltage_constant_rms": 35.1}, "amplitude between two phases, give it divided by sqrt"),
        ({"voltage_constant_rms": 20.2}, "amplitude from phase to neutral, give sqrt"),
        ({"voltage_constant_rms": 60.0}, "correct one of them, or leave one out"),
        ({"voltage_constant_rms": None, "torque_constant_rms": None}, "missing: an ac servo needs one of them"),
        ({"resistance_per_phase": 3.7}, "resistance_phase_to_phase and resistance_per_phase both given: give one"),
        ({"inductance_phase_to_phase": None}, "inductance_phase_to_phase and inductance_per_phase missing: give one"),
        ({"peak_torque": None, "peak_current_rms": None}, "peak_torque and peak_current_rms missing"),
        ({"torque_constant": 0.3}, "unknown key torque_constant: did you mean torque_constant_rms"),
        ({"kind": "bldc"}, "torque_constant_rms: a key of kind = 'ac servo', not of kind = 'bldc'"),
        ({"pole_pairs": 0}, "pole_pairs = 0"),
    ],
)
def test_what_a_table_of_an_ac_servo_may_not_hold(change, text):
    with pytest.raises(InputError, match=text) as error:
        motor_of({**SHEET, **change})
    assert "\n" not in str(error.value)


def test_a_machine_with_ac_servos(tmp_path):
    file = tmp_path / "ac.toml"
    file.write_text(TABLE.format(motor="wittenstein-premo-1d-320", limit="current_rms = 3"))
    axis = Machine(file).axes[0]
    assert axis.peak_torque == pytest.approx(3 * SHEET["torque_constant_rms"], rel=1e-9)
    assert axis.motor_constant == pytest.approx(SHEET["torque_constant_rms"] * math.sqrt(2 / 3), rel=1e-9)
    assert axis.resistance == SHEET["resistance_phase_to_phase"]
    for motor, limit, text in (
        ("wittenstein-premo-1d-320", "current = 3", "current = 3 A: the drive of an ac servo is rated in A rms"),
        ("maxon-re40-48", "current_rms = 3", "current_rms: a brushed motor has no phases with rms currents"),
    ):
        file.write_text(TABLE.format(motor=motor, limit=limit))
        with pytest.raises(InputError, match=text):
            Machine(file)
