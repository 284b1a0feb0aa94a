"""Gains in the parameters of Trio's Motion BASIC."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

from gantrysim.base.errors import InputError
from gantrysim.exchange.dialect import AxisServo, Dialect, Word
from gantrysim.tables.units import NUMBER

FULL_SCALE = 2048.0  # of the DAC at the limit of torque or speed

_GAINS = ("kp", "ki", "kd", "velocity_ff", "output_velocity")  # in the order of the parameters
_WORDS = ("P_GAIN", "I_GAIN", "D_GAIN", "VFF_GAIN", "OV_GAIN")
_SETTINGS = ("DAC_SCALE", "UNITS", "SERVO_PERIOD")  # that the gains' units depend on
_SCALE_OF_16_BITS = 16.0  # DAC_SCALE at which a DAC of 16 bits takes the gains of one of 12
_SAME_EDGE = 0.01  # relative difference of encoder edges that rounding explains
_LINE = re.compile(rf"([A-Z_]+)(?:\s+AXIS\s*\(\s*(\d{{1,4}})\s*\))?\s*=\s*({NUMBER})", re.IGNORECASE)
_BASE = re.compile(r"BASE\s*\(\s*(\d{1,4})\s*\)", re.IGNORECASE)


class Trio(Dialect):
    """P_GAIN, I_GAIN, D_GAIN, VFF_GAIN and OV_GAIN, per servo period, in encoder edges and DAC units.

        DAC = P_GAIN E + I_GAIN sum(E) + D_GAIN dE + VFF_GAIN dDPOS + OV_GAIN dMPOS

    The law has no acceleration term and no notch: an export of a servo with one is refused.
    """

    name = "trio"
    suffix = ".bas"
    comment = "'"
    source = "Motion Coordinator technical reference (gains per edge and servo period, DAC_OUT -2048 to 2047)"
    assumes = (
        "the drive takes the DAC as its torque demand, full scale at torque_limit; a velocity drive as its speed "
        "demand, full scale at the axis' speed limit"
    )
    carries = (
        "kp",
        "ki",
        "kd",
        "velocity_ff",
        "output_velocity",
        "period",
        "torque_limit",
        "resolution",
        "following_error_limit",
    )

    carries_of_velocity = tuple(name for name in carries if name != "torque_limit")
    settings: ClassVar[Mapping[str, str]] = {
        "FE_LIMIT": "servo.following_error_limit of the job",
        "FE_RANGE": "the warning of the following error, which the servo lacks",
        "OUTLIMIT": "the bound of the output: servo.torque_limit of torque drives",
    }

    def words(self, axis: AxisServo) -> list[Word]:
        values = (gain * factor for gain, factor in zip(self._gain_values(axis), self._factors(axis), strict=True))
        formulas = ("kp r c", "ki T r c", "kd r c / T", "vff r c / T", "o r c / T")
        return [
            Word(name, value, "DAC/edge", formula)
            for name, value, formula in zip(_WORDS, values, formulas, strict=True)
        ]

    def gains(self, words: Mapping[str, float], axis: AxisServo) -> dict[str, float]:
        factors = self._factors(axis)
        _check_edges(words, axis)
        scaled = [words.get(name, 0.0) / factor for name, factor in zip(_WORDS, factors, strict=True)]
        return dict(zip(_GAINS, scaled, strict=True)) | {"acceleration_ff": 0.0}

    def remarks(self, words: Mapping[str, float], axis: AxisServo) -> list[str]:
        is_same = math.isclose(words.get("FE_LIMIT", 0.0), axis.following_error_limit)
        other = {name: value for name, value in words.items() if name != "FE_LIMIT" or not is_same}
        return super().remarks(other, axis)

    def body(self, axes: Sequence[AxisServo]) -> list[str]:
        lines = [
            f"' SERVO_PERIOD={1e6 * axes[0].period:g} [us], set once and active after a restart",
            "' gains for a DAC of 12 bits, DAC_SCALE=1, or of 16 bits with DAC_SCALE=16; negative turns the direction",
        ]
        for number, axis in enumerate(axes):
            lines += [f"BASE({number}) ' axis {axis.name} [{axis.unit}]", f"UNITS={1 / axis.resolution!r}"]
            lines += [f"{word.name}={word.value!r}" for word in self.words(axis)]
            lines.append(f"FE_LIMIT={axis.following_error_limit!r}")
        return lines

    def read(self, text: str, axes: Sequence[AxisServo]) -> list[dict[str, float]]:
        values: list[dict[str, float]] = [{} for _ in axes]
        base = 0
        for line in text.splitlines():
            for statement in line.split("'")[0].split(":"):
                chosen = _BASE.fullmatch(statement.strip())
                base = int(chosen[1]) if chosen else base
                given = _LINE.fullmatch(statement.strip())
                if given and given[1].upper() in (*_WORDS, *_SETTINGS, *self.settings):
                    number = base if given[2] is None else int(given[2])
                    if number < len(values):
                        values[number][given[1].upper()] = float(given[3])
        return [_in_steps_of_12_bits(words) if words.keys() & set(_WORDS) else {} for words in values]

    @staticmethod
    def _gain_values(axis: AxisServo) -> list[float]:
        return [axis.gains[name] for name in _GAINS]

    @staticmethod
    def _factors(axis: AxisServo) -> list[float]:
        edge = axis.has("resolution", axis.resolution, "as the gains count encoder edges")
        c = edge * FULL_SCALE / axis.known_full_scale
        period = axis.period
        return [c, period * c, c / period, c / period, c / period]


def _in_steps_of_12_bits(words: dict[str, float]) -> dict[str, float]:
    """Return the gains as they are where the output has +-2048 steps.

    DAC_SCALE multiplies the output: it is 1 of a DAC of 12 bits and 16 of one of 16, which then takes the same gains.
    Its sign is the direction of the drive.
    """
    scale = abs(words.get("DAC_SCALE", 1.0))
    if scale in (0.0, 1.0):
        return words
    return {name: value * (scale / _SCALE_OF_16_BITS if name in _WORDS else 1.0) for name, value in words.items()}


def _check_edges(words: Mapping[str, float], axis: AxisServo) -> None:
    """Raise InputError where a program counts other edges or periods than the servo, as its gains are per these."""
    # 1: the program works in edges, whose length it does not give
    units = words.get("UNITS", 1.0)
    if units > 0 and units != 1 and axis.resolution > 0 and abs(units * axis.resolution - 1) > _SAME_EDGE:
        raise InputError(
            f"UNITS of axis {axis.name} = {units:g} edges per {axis.unit}: the servo's encoder has "
            f"{1 / axis.resolution:g}, and gains are per edge; --set servo.resolution={1 / units:g}, or one per axis"
        )
    period = words.get("SERVO_PERIOD", 0.0) * 1e-6
    if period > 0 and abs(period / axis.period - 1) > _SAME_EDGE:
        raise InputError(
            f"SERVO_PERIOD = {1e6 * period:g} us: the servo's is {1e6 * axis.period:g} us, and gains are per period; "
            f"--set servo.period={period:g}"
        )
