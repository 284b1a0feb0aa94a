"""Drive and encoder of an axis, as the servo knows them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, NamedTuple, TypedDict

from gantrysim.servo.gains import PerAxis, parameters_of
from gantrysim.servo.stability.motion import MODES, Drives

LOOPS = {"velocity", "position"}  # modes of drives that close loops themselves
DRIVE_PERIOD = 1.25e-4  # of the loops in the drives [s]
FEEDBACKS = ("motor", "load", "none")


class DriveSettings(NamedTuple):
    """Drive and encoder of one axis, each value with its unit, in which u is the axis' own, mm or deg, and its meaning.

    Attributes:
        torque_limit: largest torque demand [N·m].
        feedback: where the encoder is: on the "motor", or on the "load" behind the axis' compliance; "none" of a
            stepper in open loop, of which the servo knows the microsteps that it has sent.
        mode: command mode of the drive: "torque"; "velocity", where the law's output is a velocity [u/s], kp is in 1/s,
            and all other gains have u/s in place of N·m; "position", where the drive works the law itself; or
            "stepper", of a stepper in open loop, which takes no gains.
    """

    current_bandwidth: Annotated[
        float, "Hz", "bandwidth of the drive's current loop; 0 for none, which leaves the winding's own lag"
    ] = 0.0
    encoder_noise: Annotated[float, "u", "white noise of the encoder, rms per sample"] = 0.0
    interpolation_error: Annotated[float, "u", "amplitude of the encoder's error once per signal period"] = 0.0
    interpolation_error_twice: Annotated[float, "u", "amplitude of the encoder's error twice per signal period"] = 0.0
    signal_period: Annotated[float, "u", "axis travel per signal period of the encoder"] = 0.0
    velocity_gain: Annotated[
        float, "N·m·s/u", "proportional gain of a velocity loop in the drive, torque per velocity error"
    ] = 0.0
    velocity_time: Annotated[float, "s", "integral time of a velocity loop in the drive; 0 for no integral term"] = 0.0
    torque_limit: Annotated[float, "N·m", "largest torque demand, by default the drive's limit"] = float("inf")
    resolution: Annotated[
        float, "u", "axis travel per encoder count, by default the machine's; 0 for an exact encoder"
    ] = 0.0
    feedback: Annotated[str, "", "place of the encoder: motor, load or none"] = FEEDBACKS[0]
    mode: Annotated[str, "", "command mode of the drive: torque, velocity, position or stepper"] = MODES[0]

    @property
    def ideal_encoder(self) -> bool:
        """Whether the encoder only counts."""
        return not (self.encoder_noise or self.interpolation_error or self.interpolation_error_twice)


class GivenDrives(TypedDict, total=False):
    """What `Servo.derive` takes of the drives as keywords, for editors and type checkers."""

    current_bandwidth: PerAxis
    encoder_noise: PerAxis
    interpolation_error: PerAxis
    interpolation_error_twice: PerAxis
    signal_period: PerAxis
    velocity_gain: PerAxis
    velocity_time: PerAxis
    torque_limit: PerAxis
    resolution: PerAxis


WORDS = {"feedback": FEEDBACKS, "mode": MODES}  # values that are words, and what they may be
DRIVE = tuple(parameter for parameter in parameters_of(DriveSettings) if parameter.name not in WORDS)


def drives_in_loops(settings: Sequence[DriveSettings], period: float) -> Drives:
    """Return the dynamics of drives inside the loops.

    Args:
        settings: of every axis.
        period: of the loops in the drives [s].
    """
    modes = tuple(drive.mode for drive in settings)
    load = tuple(drive.feedback == "load" for drive in settings)
    bandwidth = tuple(drive.current_bandwidth for drive in settings)
    loops: tuple[tuple[float, float], ...] = ()
    if "velocity" in modes:
        loops = tuple(
            (drive.velocity_gain, 1 / drive.velocity_time if drive.velocity_time else 0.0) for drive in settings
        )
    return Drives(
        load if any(load) else (),
        bandwidth if any(bandwidth) else (),
        modes if set(modes) != {MODES[0]} else (),
        loops,
        period if LOOPS & set(modes) else 0.0,
    )
