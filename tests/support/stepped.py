"""A controller of the Move Spiral, stepped servo tick by servo tick.

Its virtual axes move tick by tick, `DPOS_real += ratio * dDPOS_virtual` with a ratio of 16 fractional bits, and a
program acts at the ticks: nothing of the controller under test is used.
"""

import cmath
import math
from dataclasses import dataclass, field

from gantrysim.controllers.trio import MoveSpiral

POSITION = 1e-9  # of setpoints against the stepped controller, after some ten thousand ticks [mm]
RELATIVE = 1e-9
SPEED = 1e-6  # relative, of the path where no limit bites
# Stepped in whole ticks the virtual speed changes at ticks alone: its way differs by dv dt / 2 in a tick, and by
# V_max dt / 2 in all; seen by the real axes, at x V_max <= V, by half a tick's way. Held to a fifth more.
STEPPED = 0.6  # of a tick's way
TABLE = 5e-4  # what the note's figures leave open
WHOLE_MS = 0.001
NEVER_BELOW = 2.0**-16


def note(**changed):
    """The example of the note: D = 120 mm, 4 turns, thickness 10 mm, V = 100 mm/s, T = 0.1 s."""
    return MoveSpiral(**{"diameter": 120, "turns": 4, "thickness": 10, "speed": 100, **changed})


def end_of(spiral):
    return complex(*spiral.generated.position(spiral.generated.length)[0, :2])


def places(setpoints):
    return setpoints.position[:, :2] @ [1, 1j]


@dataclass
class Controller:
    """The controller, servo tick by servo tick.

    `exact` has the virtual axis reach SPEED, and begin to brake, within a tick; without it the speed of a whole tick
    is that at its end, as a controller of whole ticks has it.
    """

    diameter: float
    turns: int
    thickness: float
    speed: float
    servo_period: float
    loop_period: float = 0.1
    interpreter_time: float = 0.0
    start: tuple = (0.0, 0.0)
    clockwise: bool = True
    acceleration: float = math.inf
    deceleration: float | None = None
    wait_resolution: float = 0.0
    ratio_bits: int | None = None
    as_published: bool = False
    exact: bool = True
    ratios: list = field(default_factory=list)
    due: list = field(default_factory=list)  # times at which the program is ready for each pass

    def run(self):
        dt, radius = self.servo_period, self.diameter / 2
        inner = self.diameter - 2 * self.turns * self.thickness
        change = (1 - inner / self.diameter) / (math.pi * self.diameter * self.turns / self.speed / self.loop_period)
        length = math.pi * self.diameter * (4 if self.as_published else self.turns)
        sense = -1 if self.clockwise else 1
        self.brake = self.acceleration if self.deceleration is None else self.deceleration
        self.way, self.velocity, self.stop = 0.0, 0.0, None
        place, x, awake, tick, halted = complex(*self.start), 1.0, 0.0, 0, False
        self.places, self.speeds, self.ways = [place], [0.0], [0.0]
        while self.way < length * (1 - 1e-12):
            while awake <= tick * dt * (1 + 1e-9) and not halted:
                if abs(x - change) < 1e-12 or (not self.as_published and x - change < 2**-16):
                    halted = True  # SPEED = V / 0 stops the listing; the corrected loop keeps its last x
                    break
                x -= change
                self.ratios.append(x)
                self.due.append(awake)
                wait = max(self.loop_period * x, 0.0)
                if self.wait_resolution:
                    wait = math.floor(round(wait / self.wait_resolution, 6)) * self.wait_resolution
                wait += self.interpreter_time
                awake += wait if wait > 0 else dt
            before = self.way
            self.step(dt, self.speed / abs(x), length)
            self.way = min(self.way, length)
            ratio = x if self.ratio_bits is None else round(x * 2**self.ratio_bits) / 2**self.ratio_bits
            circle = [sense * radius * cmath.exp(1j * sense * s / radius) for s in (before, self.way)]
            place += ratio * (circle[1] - circle[0])
            tick += 1
            self.places.append(place)
            self.speeds.append(self.velocity)
            self.ways.append(self.way)
        return self

    def step(self, dt, target, length):
        if not self.exact:
            self.step_whole(dt, target, length)
            return
        if self.stop is None:
            way, velocity = self.towards(dt, target)
            if velocity**2 <= 2 * self.brake * (length - way) and way < length:
                self.way, self.velocity = way, velocity
                return
            if math.isinf(self.brake):
                self.way = length
                return
            low, high = 0.0, dt  # the moment from which DECEL just suffices, by halving
            for _ in range(80):
                middle = 0.5 * (low + high)
                way, velocity = self.towards(middle, target)
                low, high = (middle, high) if velocity**2 <= 2 * self.brake * (length - way) else (low, middle)
            way, velocity = self.towards(low, target)
            velocity = min(velocity, math.sqrt(2 * self.brake * max(length - way, 0.0)))
            self.stop = low + velocity / self.brake
        self.stop -= dt
        self.way = length - 0.5 * self.brake * max(self.stop, 0.0) ** 2
        self.velocity = self.brake * max(self.stop, 0.0)

    def towards(self, dt, target):
        """Way and speed after a time at the SPEED `target`, in closed form."""
        v = self.velocity
        rate = self.acceleration if target > v else self.brake
        ramp = 0.0 if math.isinf(rate) else min(dt, abs(target - v) / rate)
        reached = target if ramp < dt or target == v else v + math.copysign(rate * ramp, target - v)
        return self.way + 0.5 * (v + reached) * ramp + reached * (dt - ramp), reached

    def step_whole(self, dt, target, length):
        low, high = self.velocity - self.brake * dt, self.velocity + self.acceleration * dt
        left = max(length - self.way, 0.0)
        # the largest speed v with v dt + v^2 / 2 d no more than is left
        stops = self.brake * (math.sqrt(dt**2 + 2 * left / self.brake) - dt)
        self.velocity = max(min(target, high, max(stops, low)), 1e-3 * self.brake * dt)
        self.way += self.velocity * dt
