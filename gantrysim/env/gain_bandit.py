"""GainBandit-v0: gains set once for a whole path, or at every decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.base.errors import InputError, finite, positive
from gantrysim.env.decision import Entry, IntervalValues, Outcome
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import SCALED, SCALED_BY, TUNED_GAINS, Source
from gantrysim.env.scalar import PathEnv
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.env.settings import PathSettings
from gantrysim.env.vector import PathVectorEnv
from gantrysim.servo.gains import GAIN_NAMES

# Largest penalties of an interval, and that of one lost by a fault, which is the larger so that no fault pays.
_CONTOUR = 6.0
_RIPPLE = 4.0
_FAULT = 12.0

_COLUMNS = np.array([GAIN_NAMES.index(name) for name in SCALED])  # of the gains that the agent sets, in a servo's row

_DECADES = 3.0  # range of errors and ripple, above and below their limits
_MEAN = 10.0  # range of mean errors [tolerances]
_SPEED_UNIT = 100.0  # [mm/s]
_SPEED_RANGE = 10.0  # of these units
_CURVATURE_UNIT = 0.1  # [1/mm]
_CURVATURE_RANGE = 10.0  # of these units


class GainBanditSettings(PathSettings):
    """Settings of `GainBanditEnv`: those of `PathSettings`, and of action and reward; by default one decision.

    Attributes:
        gain_range: largest factor by which the agent raises or lowers a gain.
        detune: divisor of the nominal gains.
        per_axis: whether every axis has its own gains.
        ripple_limit: largest torque ripple without a penalty, as a share of the drive's peak torque.

    Raises:
        InputError: a value out of bounds.
    """

    decision_interval: float = math.inf
    gain_range: float = 10.0
    detune: float = 1.0
    per_axis: bool = False
    ripple_limit: float = 0.01

    def model_post_init(self, context: Any) -> None:
        """Raise InputError for values out of bounds."""
        super().model_post_init(context)
        positive("detune", self.detune)
        positive("ripple_limit", self.ripple_limit)
        if finite("gain_range", self.gain_range) <= 1:
            raise InputError(f"gain_range = {self.gain_range:g}: must be greater than 1")


def entries(axes: Sequence[str], per_axis: bool) -> list[Entry]:
    """Return the entries of the observation, in order.

    Args:
        axes: names of the machine's axes.
        per_axis: whether every axis has gains of its own.
    """
    decades = (-_DECADES, _DECADES)
    tolerances = "log10 of tolerances"
    listed: list[Entry] = []
    for axis in axes:
        error = f"following error of {axis}"
        listed += [
            Entry(f"following_rms_{axis}", *decades, tolerances, f"RMS {error}"),
            Entry(f"following_max_{axis}", *decades, tolerances, f"largest {error}"),
            Entry(f"following_mean_{axis}", -_MEAN, _MEAN, "tolerances", f"mean {error}, signed"),
        ]
    listed += [
        Entry("contour_rms", *decades, tolerances, "RMS contour error while dispensing"),
        Entry("contour_max", *decades, tolerances, "largest contour error while dispensing"),
        Entry("contour_mean", -_MEAN, _MEAN, "tolerances", "mean contour error, positive to the left of the path"),
        Entry("speed", 0.0, _SPEED_RANGE, "100 mm/s", "path speed of the nozzle"),
        Entry(
            "curvature",
            -_CURVATURE_RANGE,
            _CURVATURE_RANGE,
            "0.1/mm",
            "path curvature at the nozzle, positive to the left",
        ),
        Entry("cos_heading", -1.0, 1.0, "1", "path direction at the nozzle, from +x"),
        Entry("sin_heading", -1.0, 1.0, "1", "path direction at the nozzle, from +x"),
    ]
    for axis in axes:
        listed += [
            Entry(f"torque_{axis}", 0.0, 1.0, "peak torques", f"largest torque demand of {axis}"),
            Entry(f"ripple_{axis}", *decades, "log10 of limits", f"torque ripple of {axis}"),
        ]
    for name in _names_of_gains(axes, per_axis):
        listed.append(Entry(f"gain_{name}", -1.0, 1.0, "1", f"action that sets {name}"))
    return [*listed, Entry("progress", 0.0, 1.0, "1", "share of the setpoints sent")]


def _names_of_gains(axes: Sequence[str], per_axis: bool) -> list[str]:
    """Return the gains that the agent sets, with the name of the axis where every axis has its own."""
    return [f"{gain}_{axis}" if per_axis else gain for gain in TUNED_GAINS for axis in (axes if per_axis else axes[:1])]


class Observer:
    """Observations of a task whose agent sets gains, in the order of `entries`.

    Values of one kind are converted together, as a decision has little time for each of NumPy's functions.

    Args:
        axes: names of the machine's axes.
        per_axis: whether every axis has gains of its own.
        tolerance: tolerance of the contour error [mm].
        ripple_limit: limit of the torque ripple, share of the peak torque.
    """

    def __init__(self, axes: Sequence[str], per_axis: bool, tolerance: float, ripple_limit: float) -> None:
        # the columns of each kind in the order in which a decision joins them, with their units
        magnitudes = {
            **{f"following_rms_{axis}": tolerance for axis in axes},
            **{f"following_max_{axis}": tolerance for axis in axes},
            "contour_rms": tolerance,
            "contour_max": tolerance,
            **{f"ripple_{axis}": ripple_limit for axis in axes},
        }
        values = {
            **{f"following_mean_{axis}": tolerance for axis in axes},
            "contour_mean": tolerance,
            "speed": _SPEED_UNIT,
            "curvature": _CURVATURE_UNIT,
            **{f"torque_{axis}": 1.0 for axis in axes},
        }
        listed = {entry.name: entry for entry in entries(axes, per_axis)}
        self._magnitude_units = np.array(list(magnitudes.values()))
        self._units = np.array(list(values.values()))
        self._lowest = np.array([listed[name].low for name in values])
        self._highest = np.array([listed[name].high for name in values])
        gains = [name for name in listed if name.startswith("gain_")]
        columns = [*magnitudes, *values, "cos_heading", "sin_heading", *gains, "progress"]
        self._order = np.array([columns.index(name) for name in listed])

    def __call__(self, measured: IntervalValues, gains: Floats, progress: Floats) -> NDArray[np.float32]:
        """Return the observations, clipped to their ranges, (n, entries).

        Args:
            measured: values of the last interval.
            gains: last action, (n, gains).
            progress: share of the setpoints sent, (n,).
        """
        contour = (measured.contour_rms[:, None], measured.contour_max[:, None])
        magnitudes = np.concatenate([measured.following_rms, measured.following_max, *contour, measured.ripple], 1)
        decades = np.log10(np.maximum(magnitudes, 1e-300) / self._magnitude_units)
        path = (measured.lateral[:, None], measured.speed[:, None], measured.curvature[:, None])
        values = np.concatenate([measured.following_mean, *path, measured.torque], 1) / self._units
        heading = measured.heading[:, None]
        parts = [
            np.minimum(np.maximum(decades, -_DECADES), _DECADES),
            np.minimum(np.maximum(values, self._lowest), self._highest),
            np.cos(heading),
            np.sin(heading),
            gains,
            progress[:, None],
        ]
        return np.concatenate(parts, 1, dtype=np.float32).take(self._order, axis=1)


class GainBatch(EpisodeBatch):
    """Places in which episodes run whose gains the agent sets; arguments as of `EpisodeBatch`."""

    settings: GainBanditSettings

    def __init__(self, settings: GainBanditSettings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, Source(settings, settings.detune))
        self._centre = np.array([self.source.servo.per_axis(name) for name in SCALED])
        self.sensitivity = SensitivityTable(self.source.machine, self.source.servo, settings.gain_range)
        self._observe = Observer(
            self.source.machine.axis_names, settings.per_axis, settings.tolerance, settings.ripple_limit
        )

    def _entries(self) -> list[Entry]:
        return entries(self.source.machine.axis_names, self.settings.per_axis)

    def _actions(self) -> list[Entry]:
        names = _names_of_gains(self.source.machine.axis_names, self.settings.per_axis)
        return [Entry(name, -1.0, 1.0, "log of `gain_range`", f"factor on the nominal {name}") for name in names]

    def observations(self) -> NDArray[np.float32]:
        progress = np.minimum(self._sent / self._setpoints, 1.0)
        return self._observe(self.measured, self._action, progress)

    def _act(self, places: Sequence[int]) -> None:
        stepped = np.array(places)
        chosen = self._action[stepped].reshape(len(places), len(TUNED_GAINS), -1)
        factors = self.settings.gain_range**chosen
        gains = self._centre * factors[:, SCALED_BY]  # (places, gains, axes)
        self._gains[stepped[:, None, None], np.arange(self._axes), _COLUMNS[:, None]] = gains

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        settings = self.settings
        measured = self.measured
        faulty, ended, undone = self._ends(advanced)
        # the episode has one decision, after which nothing is left to truncate
        alone = self.source.ticks is None
        ripple = measured.ripple.max(axis=1)
        terms: dict[str, Floats] = {
            "reward_contour": -np.minimum(np.log1p(measured.contour_rms / settings.tolerance), _CONTOUR),
            "reward_ripple": -np.clip(np.log(np.maximum(ripple / settings.ripple_limit, 1.0)), 0.0, _RIPPLE),
            "reward_fault": np.where(faulty, -_FAULT * undone, 0.0),
        }
        cost = self.sensitivity.cost(self._action.reshape(len(self.episodes), len(TUNED_GAINS), -1))
        return Outcome(
            reward=sum(terms.values(), np.zeros(len(self.episodes))),
            terminated=faulty | ended if alone else faulty,
            truncated=np.zeros_like(ended) if alone else ended,
            info={
                **terms,
                "cost": np.where(faulty, 1.0, cost),
                "contour_rms": measured.contour_rms,
                "contour_max": measured.contour_max,
                "ripple": ripple,
                "fault": self._fault_texts(faulty),
            },
            final=self._contour_values(),
        )


class GainBanditEnv(PathEnv):
    """One decision per episode: constant gains for the whole path, for black-box optimisers.

    An episode is one spiral, with fixed or random diameter, turns, thickness and speed, or the path of a job. Its
    machine is drawn from tolerances. All random values follow from the seed of `reset`. At each decision the agent sets
    gains, which hold until the next. By default the episode has one decision; with a finite `decision_interval` it has
    as many as that gives.

    Action: kp, kd, velocity_ff and acceleration_ff, each from -1 to 1, common to all axes or, with `per_axis`, one per
    axis. An action a sets a gain to nominal gain / detune * gain_range^a, where the nominal gain is derived, or that of
    the job. ki changes with kp, so the integral time kp / ki stays.

    Observation, with the tables of docs/environments.md: errors, speed and torques of the last interval, of which
    nothing is measured before the first; curvature and direction of the path; the last action; and progress. For a
    rotary axis the tolerance counts in degrees.

    Reward: the sum of three terms; `info` contains them too.

    | term | value |
    | --- | --- |
    | reward_contour | -min(log(1 + contour_rms / tolerance), 6), while dispensing |
    | reward_ripple | -min(log(max(ripple / ripple_limit, 1)), 4), of the axis with the largest ripple |
    | reward_fault | -12 for the interval of a fault and for each interval that the fault prevents |

    An interval without a fault costs at most 10, so a fault never pays. Stability affects the reward only through the
    ripple; `info["cost"]` states how far the gains exceed the tuner's limit |S| = 2 on the nominal machine: 0 up to 2,
    then max |S| / 2 - 1, and 1 from 4 on, where the loop is unstable or for a fault
    (`gantrysim.env.sensitivity.SensitivityTable`).

    `info` also contains contour_rms and contour_max [mm], 0 in an interval without dispensing; ripple, torque ripple
    while dispensing as a share of the nominal drive's peak torque (`gantrysim.metrics.torque_ripple`); fault, a text or
    None; and at the end of an episode episode_contour_rms and episode_contour_max [mm], 0 without dispensing. The
    `info` of `reset` holds the values drawn for the path and the machine. Its options "spiral" and "machine" are dicts
    with some of these values, which replace those drawn.

    A fault terminates the episode, and so does the end of the setpoints after an only decision; `info["fault"]`
    distinguishes them. With a finite `decision_interval` the end of the setpoints truncates the episode.

    Args:
        render_mode: None or "rgb_array".
        size: width and height of the pictures [pixels].
        settings: the fields of `GainBanditSettings`.

    Raises:
        InputError: a setting out of bounds.
    """

    settings_type = GainBanditSettings

    @staticmethod
    def batch(settings: GainBanditSettings, places: int, threads: int | None, ahead: bool) -> EpisodeBatch:
        return GainBatch(settings, places, threads, ahead)


class GainBanditVectorEnv(PathVectorEnv):
    """Several `GainBanditEnv` in one."""

    single = GainBanditEnv
