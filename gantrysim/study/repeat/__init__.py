"""The repeat study: what repeats of a job have in common, and how far they scatter."""

from gantrysim.study.repeat.repeats import (
    PHASES,
    RepeatCase,
    has_phase,
    measure_repeat,
    phased_setpoints,
    places_along,
)
from gantrysim.study.repeat.study import RepeatStudy
