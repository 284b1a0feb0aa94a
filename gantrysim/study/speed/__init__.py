"""The speed study: the fastest path speed at which a job stays within a tolerance."""

from gantrysim.study.speed.search import SpeedAnswer, answer, next_speeds
from gantrysim.study.speed.study import SpeedStudy
