"""The speed study: the fastest path speed at which a job stays within a tolerance."""

from gantrysim.study.speed.study import SpeedAnswer, SpeedStudy, answer, next_speeds
