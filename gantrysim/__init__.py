"""gantrysim: which link of a dispensing gantry's chain caused which part of the bead's error."""

import gantrysim.starting  # noqa: F401  before what takes long
from gantrysim import env, metrics  # env registers the Gymnasium environments
from gantrysim.axis import Axis
from gantrysim.batch import simulate_batch
from gantrysim.bead import Bead, BeadSettings, HeightMap
from gantrysim.budget import Budget
from gantrysim.controllers.servo import Servo, Tick
from gantrysim.dispenser import Dispenser
from gantrysim.engine import perfect_follower, simulate
from gantrysim.errors import GantryError, InputError
from gantrysim.job import Job
from gantrysim.machine import Machine
from gantrysim.needle import Needle
from gantrysim.run import Fault, Run

__version__ = "0.1.0"

__all__ = [
    "Axis",
    "Bead",
    "BeadSettings",
    "Budget",
    "Dispenser",
    "Fault",
    "GantryError",
    "HeightMap",
    "InputError",
    "Job",
    "Machine",
    "Needle",
    "Run",
    "Servo",
    "Tick",
    "env",
    "metrics",
    "perfect_follower",
    "simulate",
    "simulate_batch",
]
