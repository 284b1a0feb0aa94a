"""Byte offsets of the fields of MuJoCo's C structs, for code that runs inside the step.

They follow from the struct declarations in MuJoCo's wheel (`mujoco.introspect`), and are verified against the addresses
that its Python bindings report before they are used.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import mujoco
from mujoco.introspect import ast_nodes, structs

from gantrysim.errors import GantryError

_SCALARS: dict[str, Any] = {
    "int": ctypes.c_int,
    "float": ctypes.c_float,
    "double": ctypes.c_double,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_void_p,
    "uint64_t": ctypes.c_uint64,
    "mjtNum": ctypes.c_double,
    "mjtSize": ctypes.c_int64,
    "mjtBool": ctypes.c_bool,
}


# struct mjWarningStat { int lastinfo; int number; }
WARNING_SIZE = 8
WARNING_NUMBER = 4


class LayoutError(GantryError, ImportError):
    """The installed MuJoCo lays out its structs otherwise than it declares."""


@dataclass(frozen=True)
class Offsets:
    """Byte offsets of the fields that the servo tick reads or writes."""

    model_nuserdata: int
    data_userdata: int
    data_ctrl: int
    data_act: int
    data_actuator_length: int
    data_actuator_velocity: int
    data_site_xpos: int
    data_xpos: int
    data_xmat: int
    data_warning: int


@cache
def offsets() -> Offsets:
    """Return the verified offsets.

    Raises:
        LayoutError: a field is not where it is declared.
    """
    found = {}
    for field in fields(Offsets):
        struct, member = field.name.split("_", 1)
        found[field.name] = int(getattr(_struct({"model": "mjModel", "data": "mjData"}[struct]), member).offset)
    layout = Offsets(**found)
    _verify(layout)
    return layout


@cache
def _struct(name: str) -> Any:
    return _structure(name, structs.STRUCTS[name].fields)


def _structure(name: str, declared: Any) -> Any:
    members = [(field.name, _ctype(field.type)) for field in declared]
    return type(name, (ctypes.Structure,), {"_fields_": members})


def _ctype(declared: Any) -> Any:
    if isinstance(declared, ast_nodes.PointerType):
        return ctypes.c_void_p
    if isinstance(declared, ast_nodes.ArrayType):
        inner = _ctype(declared.inner_type)
        for extent in reversed(declared.extents):
            inner = inner * extent
        return inner
    if isinstance(declared, ast_nodes.AnonymousStructDecl):
        return _structure("anonymous", declared.fields)
    if declared.name in _SCALARS:
        return _SCALARS[declared.name]
    if declared.name in structs.STRUCTS:
        return _struct(declared.name)
    return ctypes.c_int  # every other name is an enum


def _verify(layout: Offsets) -> None:
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body><joint name='j' type='slide'/><geom size='1'/><site name='s'/></body></worldbody>"
        "<actuator><dcmotor joint='j' motorconst='1 1' resistance='1' inductance='1 0'/></actuator></mujoco>"
    )
    spec.nuserdata = 137
    model = spec.compile()
    data = mujoco.MjData(model)
    for k, warning in enumerate(data.warning):
        warning.number = 11 + k
    wrong = []
    at = data._address + layout.data_warning + WARNING_NUMBER
    numbers = [ctypes.c_int.from_address(at + k * WARNING_SIZE).value for k in range(len(data.warning))]
    if numbers != [warning.number for warning in data.warning]:
        wrong.append("mjData.warning")
    if ctypes.c_int64.from_address(model._address + layout.model_nuserdata).value != model.nuserdata:
        wrong.append("mjModel.nuserdata")
    for field in fields(Offsets):
        member = field.name.removeprefix("data_")
        if field.name in ("model_nuserdata", "data_warning"):
            continue
        address = ctypes.c_uint64.from_address(data._address + getattr(layout, field.name)).value
        if address != getattr(data, member).ctypes.data:
            wrong.append(f"mjData.{member}")
    if wrong:
        raise LayoutError(
            f"MuJoCo {mujoco.__version__} keeps {', '.join(wrong)} elsewhere than it declares: "
            "install the version of MuJoCo that constraints.txt names"
        )
