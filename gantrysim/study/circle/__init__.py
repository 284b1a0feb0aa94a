"""The circular test of a machine."""

from gantrysim.study.circle.study import CircleStudy
