"""Byte offsets of the fields of MuJoCo's C structs, for code that runs inside the step.

They follow from the struct declarations in MuJoCo's wheel (`mujoco.introspect`), and are verified against the addresses
that its Python bindings report before they are used.
"""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any

import mujoco

from gantrysim.base.errors import GantryError

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

# mjData's arrays that the servo tick reads or writes
POINTERS = (
    *("userdata", "ctrl", "qpos", "qvel", "act", "actuator_length", "actuator_velocity", "site_xpos", "xpos", "xmat"),
    *("qfrc_passive", "qfrc_applied"),
)

# struct mjWarningStat { int lastinfo; int number; }
WARNING_SIZE = 8
WARNING_NUMBER = 4


class LayoutError(GantryError, ImportError):
    """The installed MuJoCo lays out its structs otherwise than it declares."""


@cache
def offsets() -> dict[str, int]:
    """Return the verified byte offsets by field.

    Raises:
        LayoutError: a field is not where it is declared.
    """
    layout = {name: int(getattr(_struct("mjData"), name).offset) for name in (*POINTERS, "warning")}
    layout["nuserdata"] = int(_struct("mjModel").nuserdata.offset)
    _verify(layout)
    return layout


@cache
def _struct(name: str) -> Any:
    from mujoco.introspect import structs  # slow to import

    return _structure(name, structs.STRUCTS[name].fields)


def _structure(name: str, declared: Any) -> Any:
    members = [(field.name, _ctype(field.type)) for field in declared]
    return type(name, (ctypes.Structure,), {"_fields_": members})


def _ctype(declared: Any) -> Any:
    from mujoco.introspect import ast_nodes, structs

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
    # every other name is an enum
    return ctypes.c_int


def _verify(layout: dict[str, int]) -> None:
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body><joint name='j' type='slide'/><geom size='1'/><site name='s'/></body></worldbody>"
        "<actuator><dcmotor joint='j' motorconst='1 1' resistance='1' inductance='1 0'/></actuator></mujoco>"
    )
    spec.nuserdata = 137
    model = spec.compile()
    data = mujoco.MjData(model)
    for k, warning in enumerate(data.warning):
        warning.number = 11 + k
    pointers = {name: ctypes.c_uint64.from_address(data._address + layout[name]).value for name in POINTERS}
    wrong = [f"mjData.{name}" for name in POINTERS if pointers[name] != getattr(data, name).ctypes.data]
    first_number = data._address + layout["warning"] + WARNING_NUMBER
    numbers = [ctypes.c_int.from_address(first_number + k * WARNING_SIZE).value for k in range(len(data.warning))]
    if numbers != [warning.number for warning in data.warning]:
        wrong.append("mjData.warning")
    if ctypes.c_int64.from_address(model._address + layout["nuserdata"]).value != model.nuserdata:
        wrong.append("mjModel.nuserdata")
    if wrong:
        raise LayoutError(
            f"MuJoCo {mujoco.__version__} keeps {', '.join(wrong)} elsewhere than it declares: "
            "install the version of MuJoCo that constraints.txt names"
        )
