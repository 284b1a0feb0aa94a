"""The machine study: how many machines that differ keep a job within its tolerance, and which factor matters."""

from gantrysim.machine.tolerances import Tolerances
from gantrysim.study.machine.study import MachineStudy
