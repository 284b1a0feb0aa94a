"""The repeat study: accuracy and repeatability of a job."""

from gantrysim.study.repeat.study import (
    PHASES,
    RepeatCase,
    RepeatStudy,
    has_phase,
    measure_repeat,
    phased_setpoints,
    places_along,
)
