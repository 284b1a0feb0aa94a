"""The repeat study: accuracy and repeatability of a job."""

from gantrysim.study.repeat.repeats import (
    PHASES,
    RepeatCase,
    has_phase,
    measure_repeat,
    phased_setpoints,
    places_along,
)
from gantrysim.study.repeat.study import RepeatStudy
