"""Kinematics of machines, a class in a file each; the text `kinematics` of an MJCF names one."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from gantrysim.base.errors import unknown
from gantrysim.machine.kinematics.base import Coordinate, Kinematics, UnreachableError
from gantrysim.machine.kinematics.coupled import Coupled
from gantrysim.machine.kinematics.delta import Delta
from gantrysim.machine.kinematics.serial import Serial

KINEMATICS: dict[str, type[Kinematics]] = {"serial": Serial, "coupled": Coupled, "delta": Delta}
TEXT = "kinematics"  # of the MJCF's custom elements

__all__ = ["KINEMATICS", "Coordinate", "Kinematics", "UnreachableError", "kinematics_of"]


def kinematics_of(model: mujoco.MjModel, driven: Sequence[int], nozzle: int, work: int) -> Kinematics:
    """Return the kinematics that a model names, by default of axes in series; arguments as of `Kinematics.of`.

    Raises:
        InputError: an unknown name, or a model without the mechanism.
    """
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, TEXT)
    name = "serial"
    if index >= 0:
        first = int(model.text_adr[index])
        size = int(model.text_size[index])
        name = bytes(model.text_data[first : first + size - 1]).decode()
    if name not in KINEMATICS:
        raise unknown("kinematics", name, KINEMATICS)
    return KINEMATICS[name].of(model, driven, nozzle, work)
