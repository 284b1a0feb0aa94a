"""The gains of a cascade: a position loop that gives a speed, and a velocity loop inside it."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from gantrysim.base.errors import InputError
from gantrysim.exchange.dialect import AxisServo, Dialect, Word, by_name
from gantrysim.servo.gains import GAIN_NAMES
from gantrysim.tables.units import NUMBER

_SOFTMC = ("KPP", "KPI", "KVP", "KPVFR", "KPAFR")
_OF_DRIVE = "KVI"  # of the integral term that a velocity loop in the drive has
_FANUC_RANGES = {"1825": (1, 9999), "2092": (0, 10000)}  # valid data of the parameters


class SoftMC(Dialect):
    """Position and velocity gains of a drive under softMC, with both loops at the servo period.

        speed demand = KPP E + KPI T sum(E) + KPVFR dDPOS/T
        torque = KVP (speed demand - dMPOS/T) + KPAFR ddDPOS/T^2

    With dMPOS = dDPOS - dE this is the servo's law. A drive whose velocity loop is faster is calmer than that. Of a
    velocity drive the words are those of the loop around its velocity loop, which has the integral term
    KVI [1/s] of its own: torque = KVP (w - v + KVI integral (w - v)) with the speed demand w.
    """

    name = "softmc"
    suffix = ".prg"
    comment = "'"
    source = "public descriptions of the linear position loop of CDHD drives"
    assumes = "parameters and units; both loops run at the servo period, the loop in a velocity drive at drive_period"
    carries = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff", "output_velocity")
    carries_of_velocity = ("kp", "ki", "velocity_ff", "velocity_gain", "velocity_time")

    def words(self, axis: AxisServo) -> list[Word]:
        if axis.takes_velocity:
            return self._around_velocity_loop(axis)
        gains = axis.on_error
        kv = axis.has("kd - output_velocity", gains["kd"], "it is the gain of the velocity loop")
        c, unit = axis.motor_unit_factor
        return [
            Word("KPP", gains["kp"] / kv, "1/s", "kp / kv"),
            Word("KPI", gains["ki"] / kv, "1/s²", "ki / kv"),
            Word("KVP", kv * c, f"{unit}·s/rad", "kv s / K"),
            Word("KPVFR", 1 + gains["velocity_ff"] / kv, "1", "1 + (vff + o) / kv"),
            Word("KPAFR", gains["acceleration_ff"] * c, f"{unit}·s²/rad", "aff s / K"),
        ]

    @staticmethod
    def _around_velocity_loop(axis: AxisServo) -> list[Word]:
        """Return the parameters of the loop around the drive's own velocity loop, and of that velocity loop."""
        c, unit = axis.motor_unit_factor
        rate = 1 / axis.velocity_time if axis.velocity_time else 0.0
        return [
            Word("KPP", axis.gains["kp"], "1/s", "kp"),
            Word("KPI", axis.gains["ki"], "1/s²", "ki"),
            Word("KVP", axis.velocity_gain * c, f"{unit}·s/rad", "kv s / K"),
            Word("KVI", rate, "1/s", "1 / velocity_time"),
            Word("KPVFR", axis.gains["velocity_ff"], "1", "vff"),
        ]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        c, _ = axis.motor_unit_factor
        if axis.takes_velocity:
            return self._gains_around_velocity_loop(words, axis)
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

    @staticmethod
    def _gains_around_velocity_loop(words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        c, _ = axis.motor_unit_factor
        if words.get("KPAFR", 0.0):
            raise InputError(
                f"KPAFR of axis {axis.name} = {words['KPAFR']:g}: must be 0 around a velocity drive's loop"
            )
        values = {
            "kp": words.get("KPP", 0.0),
            "ki": words.get("KPI", 0.0),
            "velocity_ff": words.get("KPVFR", 0.0),
        }
        # else the drive keeps the job's loop
        if "KVP" in words:
            rate = words.get("KVI", 0.0)
            values["velocity_gain"] = words["KVP"] / c
            values["velocity_time"] = 1 / rate if rate else 0.0
        return values

    def remarks(self, words: Mapping[str, float], axis: AxisServo) -> list[str]:
        remarks = super().remarks(words, axis)
        if "KPVFR" not in words:
            remarks.append(f"KPVFR of axis {axis.name} is not given: read as 0, without velocity feed-forward")
        return remarks

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
            if a is not None and word.upper() in (*_SOFTMC, _OF_DRIVE):
                values[a][word.upper()] = float(value)
        return values


class Fanuc(Dialect):
    """FANUC's loop gain, parameter 1825 in whole hundredths of 1/s: the position gain over a velocity loop.

    The velocity loop's own parameters belong to the motor and are not given; read back, the loop gain scales the kp of
    the job's own kd. Of a velocity drive the loop gain is kp itself, and 2092 is the advanced preview feed-forward in
    hundredths of a percent, active with bit 1 of 2005.
    """

    name = "fanuc"
    suffix = ".prm"
    comment = ";"  # before the first %, where the control skips all
    source = "FANUC parameter manuals (1825, servo loop gain per axis, 0.01 1/s; 2092, feed-forward, 0.01 %)"
    assumes = "the velocity loop has the gain kv of the job's servo"
    carries = ("kp", "kd")  # kd by their ratio: the velocity loop is assumed
    carries_of_velocity = ("kp", "velocity_ff")

    def words(self, axis: AxisServo) -> list[Word]:
        if axis.takes_velocity:
            return [
                Word("1825", round(100 * axis.gains["kp"]), "0.01/s", "100 kp, rounded"),
                Word("2092", round(1e4 * axis.gains["velocity_ff"]), "0.01 %", "10000 vff, rounded"),
            ]
        gains = axis.on_error
        kv = axis.has("kd - output_velocity", gains["kd"], "it is the gain of the velocity loop")
        return [Word("1825", round(100 * gains["kp"] / kv), "0.01/s", "100 kp / kv, rounded")]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        if axis.takes_velocity:
            return {"kp": words.get("1825", 0.0) / 100, "velocity_ff": words.get("2092", 0.0) / 1e4}
        kv = axis.has("kd - output_velocity", axis.on_error["kd"], "it is the gain of the velocity loop")
        return {name: axis.gains[name] for name in GAIN_NAMES} | {"kp": words.get("1825", 0.0) / 100 * kv}

    def warnings(self, axis: AxisServo) -> list[str]:
        return [
            f"{word.name} of axis {axis.name} = {word.value:g}: a control takes {lowest} to {highest}"
            for word in self.words(axis)
            for lowest, highest in (_FANUC_RANGES[word.name],)
            if not lowest <= word.value <= highest
        ]

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        by_parameter: dict[str, list[str]] = {}
        for number, axis in enumerate(axes, 1):
            for word in self.words(axis):
                by_parameter.setdefault(word.name, []).append(f"A{number}P{int(word.value)}")
        return ["%", *(f"N0{name}Q1 {' '.join(values)}" for name, values in by_parameter.items()), "%"]

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        values: list[dict[str, float]] = [{} for _ in axes]
        for parameter, arguments in by_name(r"N0*(1825|2092)\s*(?:Q1)?\s*(.*)", text):
            for number, value in re.findall(r"A(\d{1,4})\s*P(\d+)", arguments, re.IGNORECASE):
                if 1 <= int(number) <= len(values):
                    values[int(number) - 1][parameter] = float(value)
        return values
