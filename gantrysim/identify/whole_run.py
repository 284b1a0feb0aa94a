"""Check of the whole run: the fitted machine is simulated under the log's torque, and compared with the log.

The engine drives a machine by the torque of the log: the one that is written, one with every fitted value, and the
nominal one. A soft loop holds it to the measured positions, as an open one would drift away; the torque that the loop
has to add is what the machine lacks.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from scipy.ndimage import gaussian_filter1d

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError
from gantrysim.base.files import replaced_file
from gantrysim.engine.simulate import simulate
from gantrysim.identify.friction_terms import DIRECTION
from gantrysim.identify.identification import Identification
from gantrysim.identify.log import Log
from gantrysim.identify.model import AxisModel, model_of
from gantrysim.identify.result import AxisFit
from gantrysim.identify.sizes import count_words, times_words
from gantrysim.machine.axis import CONSTANT_TORQUE, PER_SI, VISCOUS_DIFFERENCE
from gantrysim.machine.machine import Machine
from gantrysim.machine.motors import BRISTLE_DAMPING, BRISTLE_STIFFNESS, COULOMB, STATIC, spring_of
from gantrysim.paths.chain import Chain
from gantrysim.paths.pieces import Line
from gantrysim.record.run import Run
from gantrysim.record.setpoints import Setpoints
from gantrysim.servo.servo import Servo

# The fitted machine as an MJCF.

_INERTIA_ROUNDS = 4  # of the correction of inertias, which depend on those of the axes that an axis carries
_LEAST_INERTIA = 1e-12  # inertia of a body [kg·m²]
_ROUNDING = 1e-9  # by which moments of inertia keep from the limits of a body, relative


def fitted_machine(identification: Identification, fits: Sequence[AxisFit] | None = None) -> Machine:
    """Return the machine with the adopted values in its MJCF; all other values stay.

    Friction goes to motor and joint, inertia to the load's body and the motor's armature, the mode to the spring's
    joint. Torques are those of the log: a motor constant other than the nominal is part of all values. Constant
    torque and viscous friction by direction are custom numerics. Delay and gap are no part of the MJCF; what the log
    does not show stays.

    Args:
        identification: of a log.
        fits: with the values that the machine gets, by default the adopted ones.

    Raises:
        InputError: the fitted inertia leaves a body or a motor none.
    """
    machine = identification.machine
    fits = identification.accepted if fits is None else fits
    for attempt in range(_INERTIA_ROUNDS):
        machine = machine.edited(_edit(machine, fits, first=attempt == 0))
    return machine


def write_machine(machine: Machine, file: str | Path) -> None:
    """Write the MJCF of a machine, with all that it includes, to one file.

    Raises:
        InputError: the file cannot be written.
    """
    with replaced_file(file) as partial:
        partial.write_text(machine.spec.to_xml(), encoding="utf-8")


def _edit(machine: Machine, fits: Sequence[AxisFit], *, first: bool) -> Callable[[mujoco.MjSpec], None]:
    def edit(spec: mujoco.MjSpec) -> None:
        for fit in fits:
            index = machine.axis_names.index(fit.axis)
            now = model_of(machine, index)
            if first:
                _set_friction(spec.actuators[index], spec.joint(fit.axis), fit)
                _set_fact(spec, CONSTANT_TORQUE, index, fit.model.offset)
                per_joint = PER_SI[fit.unit] ** 2 / fit.model.scale
                _set_fact(spec, VISCOUS_DIFFERENCE, index, per_joint * fit.model.difference)
            armature = fit.model.inertia - now.inertia
            spring = spring_of(machine.layout, index)
            if fit.shows_mode and spring is not None:
                load = fit.model.inertia * fit.model.share - now.inertia * now.share
                armature -= load
                _set_mode(spec.joint(spring), fit, now, load)
            motor = spec.actuators[index]
            motor.armature += armature * fit.model.scale
            # one without inertia of its own may stay so
            if motor.armature < 0:
                raise InputError(
                    f"axis {fit.axis}: the fitted inertia leaves the motor {motor.armature:.3g} kg·m²; the masses of "
                    "the MJCF are too large"
                )

    return edit


def _set_fact(spec: mujoco.MjSpec, name: str, actuator: int, value: float) -> None:
    """Set the value of an actuator in a custom numeric."""
    numeric = spec.numeric(name)
    if numeric is None:
        if not value:
            return
        numeric = spec.add_numeric(name=name, size=len(spec.actuators), data=np.zeros(len(spec.actuators)))
    data = np.array(numeric.data, dtype=np.float64)
    data[actuator] = value
    numeric.data = data


def _set_mode(spring: mujoco.MjsJoint, fit: AxisFit, present: AxisModel, load: float) -> None:
    body = spring.parent
    added = load * PER_SI[fit.unit] ** 2 / fit.model.scale
    if spring.type == mujoco.mjtJoint.mjJNT_SLIDE:
        body.mass += added
        if not body.mass > 0:
            raise InputError(f"axis {fit.axis}: the fitted load leaves the body {body.name!r} no mass")
    else:
        inertia = np.array(body.inertia)
        along = int(np.argmax(np.abs(spring.axis)))
        inertia[along] = max(inertia[along] + added, _LEAST_INERTIA)
        # of a body's moments of inertia none exceeds the sum of the others; those across the hinge are not fitted
        first, second = (axis for axis in range(3) if axis != along)
        half = 0.5 * inertia[along]
        mean = max(0.5 * (inertia[first] + inertia[second]), half * (1 + _ROUNDING))
        most = half * (1 - _ROUNDING)
        apart = np.clip(0.5 * (inertia[first] - inertia[second]), -most, most)
        inertia[first] = mean + apart
        inertia[second] = mean - apart
        body.inertia = inertia
    spring.stiffness = np.array([spring.stiffness[0] * fit.model.stiffness / present.stiffness, 0, 0])
    spring.damping = np.array([spring.damping[0] * fit.model.damping / present.damping, 0, 0])


def _set_friction(motor: mujoco.MjsActuator, joint: mujoco.MjsJoint, fit: AxisFit) -> None:
    model = fit.model
    nominal = fit.nominal
    to_axis = PER_SI[fit.unit] ** 2 / model.scale
    if motor.gaintype == mujoco.mjtGain.mjGAIN_DCMOTOR and motor.dynprm[BRISTLE_STIFFNESS] > 0:
        # it is part of what is fitted
        joint.frictionloss = 0.0
        factor = model.coulomb / motor.biasprm[COULOMB]
        motor.biasprm[COULOMB] = model.coulomb
        motor.biasprm[STATIC] = model.static
        motor.dynprm[[BRISTLE_STIFFNESS, BRISTLE_DAMPING]] *= factor
    else:
        joint.frictionloss = model.coulomb * PER_SI[fit.unit] / model.scale
    if nominal.viscous > 0:
        joint.damping = np.asarray(joint.damping) * model.viscous / nominal.viscous
        motor.damping = np.asarray(motor.damping) * model.viscous / nominal.viscous
    else:
        joint.damping = np.array([model.viscous * to_axis, 0, 0])


# rms of the torque that the loop adds, of the log's, up to which the machine repeats the run
LARGEST_ADDED_TORQUE = 0.1
_FREQUENCY = 8.0  # natural frequency of the loop, below the strokes [Hz]
_LARGEST_FOLLOWING_ERROR = 1e3  # following error up to which the loop goes on [mm or deg]
_MULTIPLE_SHARE = 10.0  # share of the torque from which it is said in multiples
_WIDTH = 0.004  # standard deviation of the low-pass of the torques [s]
_START_TIME = 0.3  # beginning of a run that is not compared [s]
_MOVING_SPEED = 0.02  # share of the highest speed from which an axis moves
_NO_PATH = Chain([Line((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])  # nothing is laid, so no path is compared


@dataclass(frozen=True)
class WholeRun:
    """The whole run of an axis, simulated and logged.

    Attributes:
        axis: its name.
        torque: rms of the log's low-passed torque [N·m].
        written: rms of the torque that the machine written takes beside it [N·m].
        fitted: the same with every fitted value, identified or not [N·m]; nan where it could not follow.
        nominal: the same of the nominal machine [N·m]; nan where it could not follow.
        counts: rms of the written machine's distance from the measured positions [counts of the encoder].
        missing: why it could not be simulated, empty where it was.
        lacking: terms of the friction that no machine holds.
        adopted: what the machine written takes from the log, in words; empty where that is nothing.
    """

    axis: str
    torque: float = math.nan
    written: float = math.nan
    fitted: float = math.nan
    nominal: float = math.nan
    counts: float = math.nan
    missing: str = ""
    lacking: tuple[str, ...] = ()
    adopted: str = ""

    @property
    def repeats(self) -> bool:
        """Whether the machine written repeats the run."""
        return self.written <= LARGEST_ADDED_TORQUE * self.torque

    @property
    def sentence(self) -> str:
        """Result in words."""
        if self.missing:
            return f"{self.axis}: whole run not simulated: {self.missing}"
        machine = f"the machine written, with {self.adopted} of this log," if self.adopted else "the nominal machine"
        text = (
            f"{self.axis}: simulated over the whole run under the log's torque of {self.torque:.3g} N·m rms, {machine} "
            f"takes {self._share(self.written)} more or less, {1e3 * self.written:.2g} mN·m rms, to stay within "
            f"{count_words(self.counts)} rms of the log"
        )
        if math.isfinite(self.fitted):
            text += f"; with every fitted value, identified or not, {self._share(self.fitted)}"
        if self.adopted and math.isfinite(self.nominal):
            text += f"; the nominal machine takes {self._share(self.nominal)}"
        if not self.repeats:
            text += (
                f"; must be at most {100 * LARGEST_ADDED_TORQUE:.0f} %: the "
                f"{'machine written' if self.adopted else 'nominal machine'} does not repeat the run"
            )
        if self.lacking:
            text += f"; no machine holds: {', '.join(self.lacking)}"
        return text

    def _share(self, torque: float) -> str:
        share = torque / self.torque
        return f"{times_words(share)} the torque" if share > _MULTIPLE_SHARE else f"{100 * share:.2g} %"


def whole_run(identification: Identification, log: Log) -> list[WholeRun]:
    """Return how well the machine written, every fitted value and the nominal machine repeat a log, by axis.

    Args:
        identification: of the log.
        log: of its axes.
    """
    fits = identification.fits
    log = log.longest
    try:
        written = _simulated_run(fitted_machine(identification), identification, log)
    except InputError as error:
        return [WholeRun(fit.axis, missing=str(error)) for fit in fits]

    def run_of(values: Sequence[AxisFit]) -> Run | None:
        # a machine far from the log may not exist, or not be able to follow it
        try:
            return _simulated_run(fitted_machine(identification, values), identification, log)
        except InputError:
            return None

    fitted = run_of(fits)
    nominal = run_of(()) if any(identification.adopted) else written
    return [_compared_runs(identification, log, column, written, fitted, nominal) for column in range(len(fits))]


def _simulated_run(machine: Machine, identification: Identification, log: Log) -> Run:
    """Return the run of a machine under the torque of a log.

    Raises:
        InputError: positions or speeds beyond the machine's, or a fault that ends the run.
    """
    loop = Servo.derive(
        identification.machine.axes,
        log.period,
        frequency=_FREQUENCY,
        feedforward=0.0,
        following_error_limit=_LARGEST_FOLLOWING_ERROR,
    )
    setpoints = Setpoints(
        log.period,
        log.axes,
        log.position,
        np.zeros(len(log.position), bool),
        _NO_PATH,
        torque=_effective(identification, log),
    )
    run = simulate(machine, loop, setpoints)
    if run.fault is not None:
        raise InputError(f"{machine.name}: {run.fault}")
    return run


def _effective(identification: Identification, log: Log) -> Floats:
    """Return the torque demands of a log with their delay, (n, axes) [N·m]."""
    torques = []
    index = np.arange(len(log.torque), dtype=np.float64)
    for column, fit in enumerate(identification.fits):
        # the engine's winding has a lag, which the measured torque of a motor has behind it
        axis = identification.machine.axes[identification.machine.axis_names.index(fit.axis)]
        late = fit.model.delay - (0.0 if log.held else axis.lag)
        torques.append(np.interp(index - late / log.period, index, log.torque[:, column]))
    return np.stack(torques, axis=1)


def _compared_runs(
    identification: Identification, log: Log, column: int, written: Run, fitted: Run | None, nominal: Run | None
) -> WholeRun:
    fit = identification.fits[column]
    index = identification.machine.axis_names.index(fit.axis)
    measured = log.position[:, column]
    width = _WIDTH / log.period
    speed = np.abs(gaussian_filter1d(np.gradient(measured), width))
    moving = speed > _MOVING_SPEED * float(np.quantile(speed, 0.99))
    # the simulated axis starts at rest, and the loop takes a while to bring it to a log's speed
    moving[: round(_START_TIME / log.period)] = False
    effective = _effective(identification, log)[:, column]

    def added(run: Run | None) -> float:
        if run is None:
            return math.nan
        torque = np.asarray(run.demand)[:, index] - effective
        return _rms(gaussian_filter1d(torque, width)[moving])

    resolution = identification.machine.axes[index].resolution
    distance = _rms((np.asarray(written.encoder)[:, index] - measured)[moving])
    return WholeRun(
        axis=fit.axis,
        torque=_rms(gaussian_filter1d(log.torque[:, column], width)[moving]),
        written=added(written),
        fitted=added(fitted),
        nominal=added(nominal),
        counts=distance / resolution if resolution > 0 else math.nan,
        lacking=tuple(
            words for term, words in zip(fit.law.terms, fit.law.words, strict=True) if term.kind != DIRECTION
        ),
        adopted=_adopted_words(identification.adopted[column]),
    )


def _adopted_words(names: frozenset[str]) -> str:
    words = {"inertia": "inertia", "coulomb": "friction", "offset": "constant torque", "stiffness": "mode"}
    parts = [word for name, word in words.items() if name in names]
    return " and ".join([", ".join(parts[:-1]), parts[-1]] if len(parts) > 1 else parts)


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2)))
