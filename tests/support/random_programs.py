"""Random programs of every controller, each from a seed: short ones, of a second or two.

A seed says all of a program: its figure, its roundings up to the length of the legs, the servo period and the machine.
What a controller refuses is drawn anew, see `RandomProgram.refused`.
"""

from dataclasses import dataclass, field

import numpy as np

from gantrysim import Machine, Servo, simulate
from gantrysim.base.errors import InputError
from gantrysim.controllers.controller import Controller

from support.corners import smooth_machine
from support.random_controllers import KINDS, Draw

PERIODS = (0.00025, 0.0005, 0.001, 0.002, 0.004)
MOST_TICKS = 8000
MOST_TRIES = 30
LONGEST = 6.0  # [s]


@dataclass
class RandomProgram:
    """A program with what runs it.

    Attributes:
        seed: from which all follows.
        kind: of `KINDS`.
        controller: the program, as its controller reads it.
        period: of the servo [s].
        machine: "smooth", without dry friction and with a fine encoder, or a built-in machine's name.
        refused: what the controller said of the programs drawn before.
    """

    seed: int
    kind: str
    controller: Controller
    period: float
    machine: str
    refused: list[str] = field(default_factory=list)

    @property
    def text(self):
        """The program, and its arguments."""
        arguments = self.controller.arguments()
        text = next((arguments.pop(name) for name in ("text", "program") if name in arguments), "")
        plain = {name: value for name, value in arguments.items() if isinstance(value, int | float | str | tuple)}
        return f"{text}\n{plain}\n{self.kind}, servo period {self.period} s, machine {self.machine}"

    def run(self, physics_step=None):
        """The record of the program."""
        machine = smooth_machine() if self.machine == "smooth" else Machine(self.machine)
        integral = {"integral_time": 0.03} if self.seed % 3 else {}
        servo = Servo.derive(machine.axes, self.period, following_error_limit=1e3, **integral)
        step = {} if physics_step is None else {"physics_step": physics_step}
        return simulate(machine, servo, self.controller.setpoints(self.period), **step)


def random_program(kind, number, duration=1.6):
    """A program of a kind, by its number from 0."""
    seed = number * len(KINDS) + list(KINDS).index(kind)
    rng = np.random.default_rng(seed)
    refused = []
    while len(refused) < MOST_TRIES:
        period = float(rng.choice(PERIODS))
        try:
            controller = KINDS[kind](Draw(rng, duration))
            if controller.duration > min(LONGEST, MOST_TICKS * period):
                raise InputError(f"duration = {controller.duration:.3g} s: too long")
            controller.setpoints(period)
        except InputError as error:
            refused.append(str(error))
            continue
        return RandomProgram(seed, kind, controller, period, machine_for(rng, controller), refused)
    raise AssertionError(f"{kind} {number}: refused {refused}")


def machine_for(rng, controller):
    if controller.commands_axes:
        return "stage"
    return "xyz" if "z" in controller.axes else str(rng.choice(["smooth", "xy"]))
