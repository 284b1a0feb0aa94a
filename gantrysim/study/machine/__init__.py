"""The machine study: the yield of a job over machines that differ, and the dominant factor."""

from gantrysim.machine.tolerances import Tolerances
from gantrysim.study.machine.study import MachineStudy
