#!/usr/bin/env python3
"""Put gantrysim beside a measured axis, the public benchmark EMPS, and write the table of docs/validation.md.

    python scripts/real_axis.py FOLDER --write

FOLDER holds emps_1.mat, emps_pulses_1.mat and emps_identify.mat: one lap, one lap with pulses of force, and the whole
run from which the published values were estimated (A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of
EMPS, 2019 Workshop on Nonlinear System Identification Benchmarks). EMPS is a slide on a ball screw, driven by a DC
motor, with its position loop at 1 kHz:

    M a = F - Fv v - Fc sign v - F0,    F = 35.15 N/V u,    u = kv (kp (qg - qm) - dq/dt) + pulses

Each row is made by the commands `gantrysim replay` and `gantrysim identify`, but for a model in this script, which
solves the equation above and shares no code with gantrysim.
"""

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.io import loadmat

from gantrysim.identify.replay import near_reversals

PAGE = Path(__file__).parent.parent / "docs" / "validation.md"
PLACE = re.compile(r"(<!-- written by scripts/real_axis.py -->\n).*?(<!-- end of real axis -->)", re.DOTALL)

PERIOD = 1e-3  # [s]
LEAD = 2.5e-3  # [m]
COUNTS = 50_000  # per turn of the screw
KP = 160.18  # [1/s]
KV = 243.45  # [V·s/m]
NEWTON_PER_VOLT = 35.15065
PULSE = 5.0695 / 5  # measured height of a pulse per unit of the file [V]
GEAR = 2 * math.pi / LEAD  # [rad/m]
FIRST = 10  # samples from which position and velocity at the start are fitted


class Slide(NamedTuple):
    """Values of the equation of motion.

    Attributes:
        mass: M, moved mass with the motor's inertia [kg].
        viscous: Fv [N·s/m].
        coulomb: Fc [N].
        offset: F0, constant force backwards [N].
    """

    mass: float
    viscous: float
    coulomb: float
    offset: float


PUBLISHED = Slide(95.109, 203.50, 20.39, -3.165)
# as if read off data sheets
GUESSED = Slide(80.0, 100.0, 30.0, 0.0)


class Lap(NamedTuple):
    """A measured lap, all (n,).

    Attributes:
        command: qg [m].
        position: qm [m].
        volts: u, with the pulses [V].
        pulses: of u [V].
    """

    command: np.ndarray
    position: np.ndarray
    volts: np.ndarray
    pulses: np.ndarray

    @classmethod
    def read(cls, file: Path) -> "Lap":
        """Return the lap of a file."""
        values = {name: np.ravel(value).astype(float) for name, value in loadmat(file).items() if name[0] != "_"}
        pulses = PULSE * values.get("pulses_N", np.zeros_like(values["qg"]))
        return cls(values["qg"], values["qm"], values["vir"], pulses)


# What gantrysim is given: a machine, the servo's law and logs.


def mjcf(slide: Slide) -> str:
    """Return the MJCF of the slide; friction has the bristles and the static share of one that a table makes."""
    rotor = 0.1 * slide.mass / GEAR**2
    coulomb = slide.coulomb / GEAR
    inertia = slide.mass / GEAR**2
    stiffness = min(coulomb / (5e-6 * GEAR), inertia * (2 * math.pi * 80) ** 2)
    damping = 2 * 0.3 * math.sqrt(stiffness * inertia)
    return f"""<mujoco model="EMPS">
  <compiler angle="radian" autolimits="true"/>
  <size nuser_sensor="1"/>
  <option timestep="0.00025" integrator="Euler"><flag contact="disable" autoreset="disable"/></option>
  <worldbody>
    <body name="work"><geom type="box" size="0.2 0.1 0.01" pos="0 0 -0.011"/></body>
    <body name="slide">
      <inertial pos="0 0 0" mass="{0.9 * slide.mass}" diaginertia="1 1 1"/>
      <joint name="x" type="slide" axis="1 0 0" range="-0.3 0.3" damping="{slide.viscous}"/>
      <site name="nozzle"/>
    </body>
  </worldbody>
  <custom><numeric name="constant_torque" data="{-slide.offset / GEAR}"/></custom>
  <actuator>
    <dcmotor name="x" joint="x" input="ff" controller="0 0 0 0 0 48" motorconst="0.06 0.06" resistance="1"
      ctrlrange="-0.5 0.5" gear="{GEAR}" armature="{rotor}"
      lugre="{stiffness} {damping} {coulomb} {coulomb} {5e-3 * GEAR}"/>
  </actuator>
  <sensor><actuatorpos name="x" actuator="x" user="{COUNTS}"/></sensor>
</mujoco>
"""


def law(tick: Any, state: np.ndarray, torque: np.ndarray) -> None:
    """Control EMPS as its own controller does: u = kv (kp e - dq/dt), with the mean of two samples as position."""
    last, before, started = state[:3]
    position = tick.measured[0]
    if not started:
        last = before = position
    speed = (position - before) / (2 * tick.period)  # [mm/s]
    torque[0] = NEWTON_PER_VOLT / GEAR * KV * 1e-3 * (KP * tick.error[0] - speed)
    state[:3] = position, last, 1.0


def write_log(file: Path, columns: dict[str, np.ndarray]) -> Path:
    """Write columns in m and N·m as a log at 1 kHz; return its file."""
    time = PERIOD * np.arange(len(next(iter(columns.values()))))
    table = {"time [s]": time, **columns}
    np.savetxt(file, np.stack(list(table.values()), 1), "%.10g", ",", header=",".join(table), comments="")
    return file


def lap_log(file: Path, lap: Lap) -> Path:
    """Write a lap as a log; return its file."""
    return write_log(
        file,
        {
            "x command [m]": lap.command,
            "x position [m]": lap.position,
            "x demand [N·m]": NEWTON_PER_VOLT / GEAR * lap.volts,
            "x disturbance [N·m]": NEWTON_PER_VOLT / GEAR * lap.pulses,
        },
    )


def gantrysim(folder: Path, *arguments: str) -> None:
    """Run a command of gantrysim in a folder, with its warnings and errors shown if it fails."""
    done = subprocess.run([sys.executable, "-m", "gantrysim", *arguments], cwd=folder, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"gantrysim {' '.join(arguments)}:\n{done.stdout}{done.stderr}")


# The other model: the equation of motion, solved exactly between two samples.


def solved(lap: Lap, slide: Slide) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and volts [V] of the slide under its controller, (n,) each.

    The force is constant between two samples, so that the speed approaches (F - F0 -+ Fc) / Fv exponentially. At speed
    zero the slide sticks while friction can hold it.
    """
    _, speed, place = np.polyfit(PERIOD * np.arange(FIRST), lap.position[:FIRST], 2)
    last = place - speed * PERIOD
    before = place - 2 * speed * PERIOD
    tau = slide.mass / slide.viscous
    positions, volts = np.empty((2, lap.command.size))
    for k, (command, pulse) in enumerate(zip(lap.command, lap.pulses, strict=True)):
        measured = round(place / (LEAD / COUNTS)) * (LEAD / COUNTS)
        positions[k] = measured
        volts[k] = KV * (KP * (command - measured) - (measured - before) / (2 * PERIOD)) + pulse
        last, before = measured, last
        force = NEWTON_PER_VOLT * volts[k] - slide.offset
        left = PERIOD
        while left > 0 and (speed or abs(force) > slide.coulomb):
            end = (force - math.copysign(slide.coulomb, speed or force)) / slide.viscous
            # the speed passes zero only if it tends to the other side
            stop = tau * math.log((speed - end) / -end) if speed * end < 0 else math.inf
            step = min(left, stop)
            decay = math.exp(-step / tau)
            place += end * step + (speed - end) * tau * (1 - decay)
            speed = 0.0 if stop <= left else end + (speed - end) * decay
            left -= step
    return positions, volts


# Rows of the table.


# by model: what it is, what was known beforehand, and on what it was fitted
MODELS = {
    "published": ("gantrysim, published values", "mass, friction, constant force", "whole run of A, by the authors"),
    "identified": (
        "gantrysim, machine of `gantrysim identify`",
        "a guess: 80 kg, 30 N, 100 N·s/m",
        "whole run of A",
    ),
    "equation": ("the equation of motion, published values", "the same as in the first row", "the same"),
    "frictionless": ("wrong on purpose: published, no friction", "mass, constant force", "none"),
    "guessed": ("wrong on purpose: the guess", "none", "none"),
}
LAPS = {"A": "A", "B": "B, not used for any fit"}


class Row(NamedTuple):
    """Differences of a model from a lap.

    Attributes:
        model: of `MODELS`.
        judged: lap on which it is judged.
        rms: of the position [µm].
        max: of the position [µm].
        near_rms: of the position around reversals [µm].
        near_max: of the position around reversals [µm].
        force: rms of the force [N].
    """

    model: str
    judged: str
    rms: float
    max: float
    near_rms: float
    near_max: float
    force: float

    def __str__(self) -> str:
        sizes = f"{self.rms:.2f}, {self.max:.1f} | {self.near_rms:.2f}, {self.near_max:.1f} | {self.force:.1f}"
        return f"| {' | '.join(MODELS[self.model])} | {LAPS[self.judged]} | {sizes} |\n"


def replayed(folder: Path, machine: Path, log: Path) -> Iterator[tuple[float, ...]]:
    """Yield sizes of the differences of a machine from a log, and of the same machine without friction, as in `Row`."""
    out = folder / "replayed"
    # the frequency is of gains that the law does not use
    servo = f"[servo]\nperiod = {PERIOD}\nfrequency = 20\nlaw = '{Path(__file__).resolve()}:law'\n"
    (folder / "emps.toml").write_text(servo, encoding="utf-8")
    gantrysim(folder, "replay", str(log), "--machine", str(machine), "--servo", "emps.toml", "--out", str(out))
    axis = json.loads((out / "replay.json").read_text(encoding="utf-8"))["axes"]["x"]
    following = axis["following_error"]
    torque = axis["torque"]["all"]
    for side in ("difference", "frictionless"):
        positions = [following[part][f"{side}_{size}_um"] for part in ("all", "reversals") for size in ("rms", "max")]
        yield *positions, 1e-3 * torque[f"{side}_rms_mNm"] * GEAR


def of_equation(lap: Lap, slide: Slide) -> tuple[float, ...]:
    """Return the same of the equation of motion."""
    positions, volts = solved(lap, slide)
    away = 1e6 * (positions - lap.position)
    near = away[near_reversals(lap.command, PERIOD, 1e-3 * float(np.ptp(lap.command)))]
    return rms(away), largest(away), rms(near), largest(near), NEWTON_PER_VOLT * rms(volts - lap.volts)


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def largest(values: np.ndarray) -> float:
    return float(np.abs(values).max())


def rows(data: Path, fit: bool) -> list[Row]:
    """Return the rows of the table, by model.

    Args:
        data: folder of the measurements.
        fit: whether to identify a machine, too, which takes longest.
    """
    laps = {"A": Lap.read(data / "emps_1.mat"), "B": Lap.read(data / "emps_pulses_1.mat")}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        machines = {"published": PUBLISHED, "guessed": GUESSED}
        files = {model: folder / f"{model}.xml" for model in machines}
        for model, slide in machines.items():
            files[model].write_text(mjcf(slide), encoding="utf-8")
        if fit:
            files["identified"] = identified(data, folder, files["guessed"])
        found = []
        for judged, lap in laps.items():
            log = lap_log(folder / f"{judged}.csv", lap)
            found.append(Row("equation", judged, *of_equation(lap, PUBLISHED)))
            for model, file in files.items():
                own, frictionless = replayed(folder, file, log)
                found.append(Row(model, judged, *own))
                if model == "published":
                    found.append(Row("frictionless", judged, *frictionless))
    order = list(MODELS)
    return sorted(found, key=lambda row: order.index(row.model))


def identified(data: Path, folder: Path, guess: Path) -> Path:
    """Return the MJCF that `gantrysim identify` writes from the whole run, beginning at a guessed machine."""
    run = loadmat(data / "emps_identify.mat")
    log = write_log(
        folder / "whole.csv",
        {
            "x position [m]": LEAD / COUNTS * np.ravel(run["qm_counts"]),
            "x demand [N·m]": NEWTON_PER_VOLT / GEAR * 5e-5 * np.ravel(run["vir"]),
        },
    )
    gantrysim(folder, "identify", str(log), "--machine", str(guess), "--out", "identified")
    return folder / "identified" / "machine.xml"


def table(found: list[Row]) -> str:
    """Return the table of the page."""
    head = (
        "model",
        "known beforehand",
        "fitted on",
        "judged on",
        "position, rms, max [µm]",
        "around reversals, rms, max [µm]",
        "force, rms [N]",
    )
    return f"\n| {' | '.join(head)} |\n|{'---|' * 4}{'---:|' * 3}\n{''.join(map(str, found))}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the measurements")
    parser.add_argument("--write", action="store_true", help="write the table into docs/validation.md")
    arguments = parser.parse_args()
    found = table(rows(arguments.folder, fit=True))
    print(found)
    if arguments.write:
        page = PAGE.read_text(encoding="utf-8")
        PAGE.write_text(PLACE.sub(lambda place: place[1] + found + place[2], page), encoding="utf-8")


if __name__ == "__main__":
    main()
