"""`gantrysim study loop`: the effect of the periods and resolutions of the chain on the bead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gantrysim.controllers.loop_theory import LoopTheory
from gantrysim.machine.perturbation import Perturbation
from gantrysim.record.setpoints import ticks
from gantrysim.study.cases import Case, Mode
from gantrysim.study.study import Rounds, Study

# variants of a job
AS_IT_IS = "as it is"
LOOP_ALONE = "loop alone"  # without the controller's other limits
PERFECT = "loop alone, perfect follower"
NO_LOOP = "no loop"  # the limit of a loop period of zero
NO_FRICTION = "no friction"  # nor loop, encoder counts and integral term: as in the theory of the servo

# sweeps in the order of the report, with their titles
SWEEPS = {
    "loop_period": "Program loop period",
    "interpreter_time": "Interpreter time per pass",
    "servo_period": "Servo period",
    "encoder_resolution": "Encoder resolution",
    "physics_step": "Physics step",
}

_DECADE = (1.0, 2.0, 3.0, 5.0)
_FINER_STEP = 4  # times: the physics step for comparison with a theory in continuous time
_FRICTIONLESS = Perturbation(friction=1e-9)


@dataclass(frozen=True)
class LoopStudy(Study):
    """Sweeps of program loop period, interpreter time, servo period, encoder resolution and physics step.

    A program with a loop runs in up to five variants: unchanged; with its loop alone, without the controller's other
    limits such as ramps, wait resolution and interpreter time; the same on a perfect follower; without the loop, as its
    continuous limit; and without loop, friction, encoder counts and integral term at a finer physics step, as in the
    theory of the sampled servo. Programs without a loop have no loop sweeps.

    Args:
        job: job to study.
        loop_periods: loop periods T, ascending [s].
        interpreter_times: interpreter times d, ascending [s].
        servo_periods: servo periods, ascending [s].
        resolutions: resolutions of the linear encoders, ascending; rotary ones change in proportion [mm].
        halvings: number of times the physics step is halved.
    """

    loop_periods: tuple[float, ...] = (*(round(s * d, 5) for d in (1e-3, 1e-2, 1e-1) for s in _DECADE), 1.0)
    interpreter_times: tuple[float, ...] = (0.0, 1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2)
    servo_periods: tuple[float, ...] = (2.5e-4, 5e-4, 1e-3, 2e-3, 4e-3, 8e-3)
    resolutions: tuple[float, ...] = (1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
    halvings: int = 3

    name = "loop"
    plots = tuple(SWEEPS)

    @cached_property
    def theory(self) -> LoopTheory | None:
        """The closed forms of the program's loop, None for a program without one."""
        return self.changed_theory({})

    def changed_theory(self, changes: Mapping[str, Any]) -> LoopTheory | None:
        """Return the closed forms of the program's loop with some arguments changed."""
        return type(self.job.controller).loop_theory({**self.job.program, **changes})

    def rounds(self) -> Rounds:
        yield self.cases

    @cached_property
    def cases(self) -> list[Case]:
        """All cases, the longest first."""
        cases = [*self._physics_step()]
        if self.theory is not None:
            cases += [*self._program("loop_period", self.loop_periods), self._case("loop_period", 0.0, NO_LOOP, {})]
            if self.job.program["loop_period"] > 0:
                cases += self._program("interpreter_time", self.interpreter_times)
        return [*cases, *self._servo_period(), *self._encoder_resolution()]

    def _case(self, sweep: str, value: float, variant: str, changes: dict[str, Any]) -> Case:
        mode: Mode = "perfect follower" if variant == PERFECT else "simulated"
        overrides = dict(changes)
        if variant != AS_IT_IS and self.theory is not None:
            alone = {f"program.{key}": setting for key, setting in self.theory.alone.items()}
            overrides = {**alone, **overrides}
        if variant in (NO_LOOP, NO_FRICTION) and self.theory is not None:
            overrides["program.loop_period"] = 0.0
        if variant == NO_FRICTION:
            overrides = {"servo.resolution": 0.0, "servo.integral_time": math.inf, **overrides}
        perturbation = _FRICTIONLESS if variant == NO_FRICTION else None
        return Case.of(self.job, overrides, mode, perturbation, sweep=sweep, variant=variant, value=value)

    def _program(self, sweep: str, values: Sequence[float]) -> Iterable[Case]:
        for variant in (AS_IT_IS, LOOP_ALONE, PERFECT):
            for value in values:
                yield self._case(sweep, value, variant, {f"program.{sweep}": value})

    def _servo_period(self) -> Iterable[Case]:
        has_loop = self.theory is not None
        bound = has_loop and self.job.program["servo_period"] > 0
        for variant in (AS_IT_IS, NO_LOOP, NO_FRICTION) if has_loop else (AS_IT_IS, NO_FRICTION):
            for value in self.servo_periods:
                changes = {"servo.period": value}
                if bound and variant == AS_IT_IS:
                    # the program's ticks are the servo's
                    changes["program.servo_period"] = value
                if variant == NO_FRICTION:
                    # slow servos have enough steps in a servo period without finer ones
                    finer = max(self._physics / _FINER_STEP, min(value / _FINER_STEP**2, self._physics))
                    changes["simulation.physics_step"] = finer
                yield self._case("servo_period", value, variant, changes)

    def _encoder_resolution(self) -> Iterable[Case]:
        for variant in (AS_IT_IS, NO_LOOP) if self.theory is not None else (AS_IT_IS,):
            for value in self.resolutions:
                counts = self._resolutions(value)
                changes = (
                    {} if counts == list(self.job.built_servo.per_axis("resolution")) else {"servo.resolution": counts}
                )
                yield self._case("encoder_resolution", value, variant, changes)

    def _physics_step(self) -> Iterable[Case]:
        period = self.job.servo.period
        first = ticks(period, self._physics)
        for halvings in range(self.halvings, -1, -1):
            value = period / (first * 2**halvings)
            for variant in (AS_IT_IS, NO_FRICTION):
                changes = {} if value == self._physics else {"simulation.physics_step": value}
                yield self._case("physics_step", value, variant, changes)

    @property
    def _physics(self) -> float:
        """The job's physics step [s]."""
        return self.job.simulation.physics_step or float(self.job.built_machine.physics.opt.timestep)

    def _resolutions(self, value: float) -> list[float]:
        """Resolution of every axis: `value` [mm] of the linear ones, rotary ones changed by the same factor."""
        axes = self.job.built_machine.axes
        present = next((axis.resolution for axis in axes if axis.unit == "mm" and axis.resolution > 0), value)
        return [value if axis.unit == "mm" else axis.resolution * value / present for axis in axes]
