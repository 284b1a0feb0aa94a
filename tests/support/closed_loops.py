"""Closed loops of a servo on a linear machine, tick by tick, written by hand: poles and sensitivity without margins.

Nothing of `gantrysim.servo.stability` but the continuous motion is used. All axes are in one system, whether they move
each other or not; only where drives of several modes are on one machine is each axis by itself.
"""

# ruff: noqa: N803, N806 - matrices bear the letters of the equations

import math

import numpy as np
from scipy.linalg import expm

# Of the magnitude of a pole: three and more lie together near 1 where a loop is some 10,000 times slower than its
# ticks, and move by the cube root of rounding.
ROUNDING = 2e-5
ANGLES = np.pi * np.logspace(-5, 0, 500)


def held(A, B, time):
    """Effect of the state and of a held input on the state after a time."""
    n, m = B.shape
    joint = np.zeros((n + m, n + m))
    joint[:n, :n], joint[:n, n:] = A, B
    effect = expm(joint * time)
    return effect[:n, :n], effect[:n, n:]


class ClosedLoops:
    """The servo's tick as a matrix, by what it makes of every unit state.

    Args:
        motion: of the axes.
        servo: with these axes.
        axes: numbers of the axes that the motion has.
    """

    def __init__(self, motion, servo, axes):
        self.servo, self.axes = servo, list(axes)
        (self.mode,) = {servo.modes[a] for a in axes}
        self.motors = motion.C
        motion = motion.driven(servo.loop_drives.of_axes(axes))
        self.C = motion.C
        self.m, self.n = self.C.shape
        self.laws = servo.compensators() if servo.laws.names != ("pid",) else None
        self.period = servo.drive_period if self.mode == "position" else servo.period
        delay = 0.0 if self.mode == "position" else servo.delay
        self.late = 0 if self.mode == "position" or self.laws is not None else servo.feedback_delay
        if self.mode == "velocity":
            self.t = servo.drive_period
            self.steps = round(self.period / self.t)
            self.first = math.ceil(delay / self.t - 1e-6)  # sample of the drive at which the new demand enters
            self.step = held(motion.A, motion.B, self.t)
        else:
            self.before, self.after = held(motion.A, motion.B, delay), held(motion.A, motion.B, self.period - delay)
        self.size = len(self._start())

    def _start(self):
        """Sizes of the parts of the state, by name."""
        m = self.m
        self.parts = {"x": self.n, "sum": m}
        if self.laws is not None:
            self.parts = {"x": self.n, "law": sum(len(self.laws[a].A) for a in self.axes)}
        else:
            self.parts |= {"error": m, "late": m * self.late}
        self.parts["demand"] = m
        if self.mode == "velocity":
            self.parts |= {"motor": m, "integral": m}
        elif self.laws is None:
            self.parts["notch"] = 2 * m
        return np.zeros(sum(self.parts.values()))

    def _split(self, state):
        ends = np.cumsum(list(self.parts.values()))
        return dict(zip(self.parts, np.split(state, ends[:-1]), strict=True))

    def tick(self, state, disturbance, factors):
        """State after a tick, and demand that the machine gets in it, with a disturbance added to the demand."""
        s = self._split(state)
        measured = self.C @ s["x"]
        if self.late:
            queue = s["late"].reshape(self.late, self.m)
            measured, s["late"] = queue[0], np.concatenate([queue[1:].ravel(), measured])
        demand = (self._pid(s, -measured) if self.laws is None else self._other(s, -measured)) * factors + disturbance
        if self.mode == "velocity":
            self._drive(s, demand)
        else:
            x = self.before[0] @ s["x"] + self.before[1] @ s["demand"]
            s["x"] = self.after[0] @ x + self.after[1] @ demand
        s["demand"] = demand
        return np.concatenate([s[name] for name in self.parts]), demand

    def _pid(self, s, error):
        """kp e + ki T sum(e) + kd de/T, and the notch."""
        kp, ki, kd = (np.array([self.servo.per_axis(name)[a] for a in self.axes]) for name in ("kp", "ki", "kd"))
        s["sum"] = s["sum"] + self.period * error
        out = kp * error + ki * s["sum"] + kd * (error - s["error"]) / self.period
        s["error"] = error
        if self.mode != "velocity":
            first, second = s["notch"].reshape(2, self.m)
            b0, b1, b2, a1, a2 = np.array([self.servo.filters[a] for a in self.axes]).T
            value, out = out, b0 * out + first
            s["notch"] = np.concatenate([b1 * value - a1 * out + second, b2 * value - a2 * out])
        return out

    def _other(self, s, error):
        """Laws other than PID, as the servo's linear model of them; the lateness of the feedback is in it."""
        states, out, start = s["law"].copy(), np.zeros(self.m), 0
        for i, a in enumerate(self.axes):
            law = self.laws[a]
            own = slice(start, start + len(law.A))
            out[i] = law.C @ s["law"][own] + law.D * error[i]
            states[own] = law.A @ s["law"][own] + law.B * error[i]
            start = own.stop
        s["law"] = states
        return out

    def _drive(self, s, demand):
        """The velocity loops' own samples: K (w - v + sum(w - v) t / Ti)."""
        gain = np.array([self.servo.drives[a].velocity_gain for a in self.axes])
        rate = np.array(
            [1 / self.servo.drives[a].velocity_time if self.servo.drives[a].velocity_time else 0.0 for a in self.axes]
        )
        for j in range(self.steps):
            motor = self.motors @ s["x"]
            lack = (demand if j >= self.first else s["demand"]) - (motor - s["motor"]) / self.t
            s["integral"] = s["integral"] + self.t * lack
            s["x"] = self.step[0] @ s["x"] + self.step[1] @ (gain * (lack + rate * s["integral"]))
            s["motor"] = motor

    def matrices(self, factors=None):
        """A, B, C, D from a disturbance of the demands to the demands."""
        factors = np.ones(self.m) if factors is None else factors
        states, none = np.eye(self.size), np.zeros(self.m)
        A, C = zip(*(self.tick(state, none, factors) for state in states), strict=True)
        B, D = zip(*(self.tick(np.zeros(self.size), one, factors) for one in np.eye(self.m)), strict=True)
        return np.array(A).T, np.array(B).T, np.array(C).T, np.array(D).T

    def radius(self, factors=None):
        """Largest magnitude of a pole; that of a sum without gain is none."""
        A = self.matrices(factors)[0]
        if self.laws is None:
            keep = np.ones(self.size, bool)
            for i, a in enumerate(self.axes):
                keep[self.n + i] = bool(self.servo.gains[a].ki)
            A = A[np.ix_(keep, keep)]
        return np.abs(np.linalg.eigvals(A)).max()

    def peaks(self):
        """Peak of |S| of each axis: of the demand over what is added to it."""
        A, B, C, D = self.matrices()
        poles = np.linalg.eigvals(A)
        near = np.angle(poles[(poles.imag > 0) & (np.abs(poles) > 0.5)])
        fine = np.concatenate([near * factor for factor in (0.98, 0.99, 0.995, 1.0, 1.005, 1.01, 1.02)])
        angles = np.concatenate([ANGLES, fine[fine < np.pi]])
        peak = np.zeros(self.m)
        for some in np.array_split(angles, max(1, len(angles) // 100)):
            z = np.exp(1j * some)[:, None, None]
            S = D + C @ np.linalg.solve(z * np.eye(len(A)) - A, np.broadcast_to(B, (len(some), *B.shape)))
            peak = np.maximum(peak, np.abs(np.einsum("nii->ni", S)).max(axis=0))
        return peak


def loops_of(machine, servo):
    """The closed loops of a machine: all in one, or of each axis where drives have several modes; not of steppers."""
    if len(set(servo.modes)) == 1:
        if servo.modes[0] == "stepper":
            return []
        return [ClosedLoops(machine.motion(), servo, range(len(machine.axes)))]
    return [ClosedLoops(axis.motion, servo, [a]) for a, axis in enumerate(machine.axes) if servo.modes[a] != "stepper"]


def shortfall(machine, servo, factor=1.98, peak=2.0 * (1 + 2e-3)):
    """What of its margins a servo does not keep, in words; empty if it keeps all.

    Args:
        machine: the machine.
        servo: its servo.
        factor: on the gains of each axis, and of all, up to which it must be stable.
        peak: largest |S|.
    """
    for loops in loops_of(machine, servo):
        many = [np.eye(loops.m)[i] for i in range(loops.m)]
        for more in np.linspace(1.0, factor, 5):
            scales = [*(1 + (more - 1) * unit for unit in many), np.full(loops.m, more)]
            for scale in scales:
                radius = loops.radius(scale)
                if not radius < 1 + ROUNDING:
                    return f"a pole of {radius:.9f} with gains times {scale}"
        peaks = loops.peaks()
        if peaks.max() > peak:
            return f"a peak of |S| of {peaks}"
    return ""
