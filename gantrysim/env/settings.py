"""Settings of the environments: path, machine and servo of an episode, action and reward."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Self

import numpy as np
from pydantic import (
    BaseModel,
    ConfigDict,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    field_validator,
)

from gantrysim.base.errors import InputError, positive, unknown, whole_number
from gantrysim.base.input_files import field_names, one_line
from gantrysim.engine.linear import Engine
from gantrysim.env.ranges import NOMINAL, PRESETS, SHIFTED_TOLERANCES, TRAINING
from gantrysim.job.job import Job
from gantrysim.job.settings import ServoSettings
from gantrysim.machine.tolerances import Tolerances

Bounds = float | tuple[float, float]  # a fixed value, or the lowest and the highest value drawn

LEAST_DIAMETER = 4  # thicknesses: the first turn ends at a radius of one


class PathSettings(BaseModel):
    """Settings of every environment. With a job, those of the spiral, its machine and its servo are not used.

    Attributes:
        job: a job, its name, its file or its content as a dict, which gives path, machine and servo. By default the
            path is a spiral, an involute commanded exactly from rest to rest.
        machine: a built-in machine, or an MJCF file.
        servo: arguments of `Servo.derive` for the nominal gains.
        diameter: outer diameter of the spiral [mm].
        turns: whole number of turns; fewer if they would not leave a radius of one thickness inside.
        thickness: distance between neighbouring turns [mm].
        speed: path speed [mm/s].
        acceleration: path acceleration at the start and the end [mm/s²].
        spread: tolerances from which every episode's machine is drawn; None for the nominal machine.
        preset: what varies between episodes: "training", the ranges of the settings and of the task; "nominal",
            nothing; "shifted", values beyond those of training, to test what was learnt. A bound, or tolerances, that
            are given hold in any preset.
        ranges: fixed values, or the lowest and the highest, of values of the task and of the machine by the names that
            `info` of a reset has, such as {"viscosity": (0.5, 2.0), "friction_x": 1.5}; they replace the preset's.
        decision_interval: time between decisions, a multiple of the servo period; inf for one per episode [s].
        tolerance: tolerance of the contour error [mm].
        engine: what makes the physics steps, see `gantrysim.simulate`: "loop" where all joints of the machine slide.

    Raises:
        InputError: a value out of bounds.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=True, arbitrary_types_allowed=True)

    job: str | Job | None = None
    machine: str = "xy"
    servo: ServoSettings = ServoSettings(integral_time=0.03)
    diameter: Bounds = (80.0, 140.0)
    turns: Bounds = (2, 5)
    thickness: Bounds = (6.0, 12.0)
    speed: Bounds = (50.0, 150.0)
    acceleration: float = 1000.0
    spread: Tolerances | None = Tolerances()
    preset: str = TRAINING
    ranges: dict[str, Bounds] = {}
    decision_interval: float = 0.1
    tolerance: float = 0.05
    engine: Engine = "loop"

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Self:
        """Return the settings with the given values.

        Raises:
            InputError: an unknown setting, or an invalid value.
        """
        for name in values:
            if name not in cls.model_fields:
                raise unknown("setting", name, cls.model_fields)
        try:
            return cls(**{name: _plain(value) for name, value in values.items()})
        except ValidationError as error:
            raise InputError(one_line(error, field_names(cls))) from None

    @field_validator("job", mode="before")
    @classmethod
    def _parsed_job(cls, value: Any) -> Any:
        return Job.model_validate(value) if isinstance(value, Mapping) else value

    @field_validator("spread", mode="before")
    @classmethod
    def _parsed_spread(cls, value: Any) -> Any:
        return Tolerances.parse(value) if isinstance(value, str) else value

    @field_validator("preset")
    @classmethod
    def _known_preset(cls, value: str) -> str:
        if value not in PRESETS:
            raise unknown("preset", value, PRESETS)
        return value

    @field_validator("ranges", mode="wrap")
    @classmethod
    def _checked_ranges(cls, value: Any, handler: ValidatorFunctionWrapHandler) -> dict[str, Bounds]:
        if not isinstance(value, Mapping):
            raise InputError(f"ranges = {value!r}: must be a dict of names and ranges")
        ranges: dict[str, Bounds] = {}
        for name, bounds in value.items():
            if name in cls.model_fields:
                raise InputError(f"ranges: {name} is a setting of its own: give {name} = {bounds!r}")
            try:
                ranges |= handler({name: bounds})
            except ValidationError:
                raise InputError(
                    f"ranges: {name} = {bounds!r}: must be one number, or the lowest and the highest"
                ) from None
        return ranges

    @field_validator("diameter", "turns", "thickness", "speed", mode="wrap")
    @classmethod
    def _checked_bounds(cls, value: Any, handler: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Bounds:
        try:
            return handler(value)
        except ValidationError:  # it would list the failure of each type of the union
            raise InputError(
                f"{info.field_name} = {value!r}: must be one number, or the lowest and the highest"
            ) from None

    def model_post_init(self, _context: Any) -> None:
        """Raise InputError for values out of bounds."""
        for name, unit in (("diameter", "mm"), ("thickness", "mm"), ("speed", "mm/s")):
            low, high = self.between(name)
            if high < positive(name, low, unit):
                raise InputError(f"{name} = ({low:g}, {high:g}) {unit}: must be the lowest, then the highest")
        fewest, most = self.between("turns")
        whole_number("highest turns", most, whole_number("turns", fewest, 1))
        positive("acceleration", self.acceleration, "mm/s²")
        positive("tolerance", self.tolerance, "mm")
        if self.decision_interval != math.inf:
            positive("decision_interval", self.decision_interval, "s")
        least = self.between("diameter")[0]
        thickest = self.between("thickness")[1]
        if least < LEAST_DIAMETER * thickest:
            raise InputError(
                f"diameter = {least:g} mm: must be at least {LEAST_DIAMETER} times the thickness, "
                f"{LEAST_DIAMETER * thickest:g} mm, for one turn to fit in"
            )

    def between(self, name: str) -> tuple[float, float]:
        """Return the lowest and the highest value of a setting, equal if it is fixed."""
        value: Bounds = getattr(self, name)
        low, high = value if isinstance(value, tuple) else (value, value)
        if self.preset == NOMINAL and name not in self.model_fields_set:
            middle = 0.5 * (low + high)
            low = high = math.floor(middle) if name == "turns" else middle
        return low, high

    @property
    def tolerances(self) -> Tolerances | None:
        """The tolerances from which the machines are drawn, None for the nominal machine."""
        if self.spread is None or self.preset == TRAINING or "spread" in self.model_fields_set:
            return self.spread
        if self.preset == NOMINAL:
            return None
        return Tolerances(**{name: SHIFTED_TOLERANCES * value for name, value in asdict(self.spread).items()})


def _plain(value: Any) -> Any:
    """Return NumPy values as Python values, and paths as text."""
    if isinstance(value, dict):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return os.fspath(value) if isinstance(value, os.PathLike) else value
