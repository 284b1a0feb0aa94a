"""The gains of a cascade: a position loop that gives a speed, and a velocity loop inside it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from gantrysim.base.patterns import NUMBER
from gantrysim.exchange.dialect import AxisServo, Dialect, Word, by_name
from gantrysim.servo.gains import GAIN_NAMES

_SOFTMC = ("KPP", "KPI", "KVP", "KPVFR", "KPAFR")


class SoftMC(Dialect):
    """Position and velocity gains of a drive under softMC, with both loops at the servo period.

        speed demand = KPP E + KPI T sum(E) + KPVFR dDPOS/T
        torque = KVP (speed demand - dMPOS/T) + KPAFR ddDPOS/T^2

    With dMPOS = dDPOS - dE this is the servo's law. A drive whose velocity loop is faster is calmer than that.
    """

    name = "softmc"
    suffix = ".prg"
    comment = "'"
    source = "public descriptions of the linear position loop of CDHD drives"
    assumes = "words and units, and both loops at the servo period"
    carries = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "output_velocity")

    def words(self, axis: AxisServo) -> list[Word]:
        gains = axis.on_error
        kv = axis.has("kd - output_velocity", gains["kd"], "it is the gain of the velocity loop")
        c, unit = _per_speed(axis)
        return [
            Word("KPP", gains["kp"] / kv, "1/s", "kp / kv"),
            Word("KPI", gains["ki"] / kv, "1/s²", "ki / kv"),
            Word("KVP", kv * c, f"{unit}·s/rad", "kv s / K"),
            Word("KPVFR", 1 + gains["velocity_ff"] / kv, "1", "1 + (vff + o) / kv"),
            Word("KPAFR", gains["acceleration_ff"] * c, f"{unit}·s²/rad", "aff s / K"),
        ]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        c, _ = _per_speed(axis)
        kpp, kpi, kvp, forward, acceleration = (words.get(name, 0.0) for name in _SOFTMC)
        kv = kvp / c
        return {
            "kp": kpp * kv,
            "ki": kpi * kv,
            "kd": kv,
            "velocity_ff": (forward - 1) * kv,
            "acceleration_ff": acceleration / c,
            "output_velocity": 0.0,
        }

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        lines = []
        for axis in axes:
            lines += [f"{axis.name}.{word.name} = {word.value!r}" for word in self.words(axis)]
        return lines

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        values: list[dict[str, float]] = [{} for _ in axes]
        places = {axis.name.lower(): a for a, axis in enumerate(axes)}
        for owner, word, value in by_name(rf"(\w+)\.(\w+)\s*=\s*({NUMBER})\s*(?:'.*)?", text):
            a = places.get(owner.lower())
            if a is not None and word.upper() in _SOFTMC:
                values[a][word.upper()] = float(value)
        return values


class Fanuc(Dialect):
    """FANUC's loop gain, parameter 1825 in whole hundredths of 1/s: the position gain over a velocity loop.

    The velocity loop's own parameters belong to the motor and are not given; read back, the loop gain scales the kp of
    the job's own kd.
    """

    name = "fanuc"
    suffix = ".prm"
    comment = ";"  # before the first %, where the control skips all
    source = "FANUC parameter manuals (1825, servo loop gain per axis, unit 0.01 1/s)"
    assumes = "the velocity loop has the gain kv of the job's servo"
    carries = ("kp", "kd")  # kd by their ratio: the velocity loop is assumed

    def words(self, axis: AxisServo) -> list[Word]:
        gains = axis.on_error
        kv = axis.has("kd - output_velocity", gains["kd"], "it is the gain of the velocity loop")
        return [Word("1825", round(100 * gains["kp"] / kv), "0.01/s", "100 kp / kv, rounded")]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        kv = axis.has("kd - output_velocity", axis.on_error["kd"], "it is the gain of the velocity loop")
        return {name: axis.gains[name] for name in GAIN_NAMES} | {"kp": words.get("1825", 0.0) / 100 * kv}

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        values = " ".join(f"A{a}P{int(self.words(axis)[0].value)}" for a, axis in enumerate(axes, 1))
        return ["%", f"N01825Q1 {values}", "%"]

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        values: list[dict[str, float]] = [{} for _ in axes]
        for (arguments,) in by_name(r"N0*1825\s*(?:Q1)?\s*(.*)", text):
            for number, value in re.findall(r"A(\d{1,4})\s*P(\d+)", arguments, re.IGNORECASE):
                if 1 <= int(number) <= len(values):
                    values[int(number) - 1]["1825"] = float(value)
        return values


def _per_speed(axis: AxisServo) -> tuple[float, str]:
    """Return the factor from torque per travel to the drive's current, or torque, per angle of the motor."""
    if math.isfinite(axis.motor_constant):
        return axis.scale / axis.motor_constant, "A"
    return axis.scale, "N·m"
