"""The circular test of a machine."""

from gantrysim.study.circle.rows import circle_row
from gantrysim.study.circle.study import CircleStudy
