"""The task of the first version: at each decision the agent sets gains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gantrysim.base.arrays import Floats
from gantrysim.env.episode_batch import EpisodeBatch
from gantrysim.env.episodes import SCALED, TUNED_GAINS, Source, gain_factors
from gantrysim.env.observation import Entry, entries, observe
from gantrysim.env.outcome import Outcome
from gantrysim.env.sensitivity import SensitivityTable
from gantrysim.env.settings import Settings
from gantrysim.servo.law import GAIN_NAMES

# Largest penalties of an interval, and that of one lost by a fault, which is the larger so that no fault pays.
_CONTOUR, _RIPPLE, _FAULT = 6.0, 4.0, 12.0


class GainBatch(EpisodeBatch):
    """Places in which episodes run whose gains the agent sets; arguments as of `EpisodeBatch`."""

    settings: Settings

    def __init__(self, settings: Settings, places: int, threads: int | None, ahead: bool) -> None:
        super().__init__(settings, places, threads, ahead, Source(settings, settings.detune))
        self._centre = {name: np.array(getattr(self.source.servo, name)) for name in SCALED}
        self.sensitivity = SensitivityTable(self.source.machine, self.source.servo, settings.gain_range)

    def _entries(self) -> list[Entry]:
        return entries(self.source.machine.axis_names, self.settings.per_axis)

    def _action_size(self) -> int:
        return len(TUNED_GAINS) * (self._axes if self.settings.per_axis else 1)

    def observations(self) -> NDArray[np.float32]:
        progress = np.minimum(self._sent / self._setpoints, 1.0)
        return observe(self.measured, self._action, progress, self.settings.tolerance, self.settings.ripple_limit)

    def _apply(self, places: Sequence[int]) -> None:
        chosen = self._action[places].reshape(len(places), len(TUNED_GAINS), -1)
        for name, factor in gain_factors(np.moveaxis(chosen, 1, 0), self.settings.gain_range).items():
            self._gains[places, : self._axes, GAIN_NAMES.index(name)] = self._centre[name] * factor

    def _outcome(self, advanced: NDArray[np.bool_]) -> Outcome:
        settings, measured = self.settings, self.measured
        faulty, ended, undone = self._ends(advanced)
        alone = self.source.ticks is None  # the episode has one decision
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
