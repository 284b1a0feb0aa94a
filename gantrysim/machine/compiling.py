"""Compiling an MJCF into the model that is rendered and that of its physics, and the copies of it that are stepped."""

from __future__ import annotations

import copy
import hashlib
import math
import re
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from gantrysim.base.errors import InputError, between, unknown
from gantrysim.base.input_files import check_regular
from gantrysim.machine.model_arrays import ModelArrays
from gantrysim.machine.motors import set_for_steps
from gantrysim.machine.row import ROW_NUMBERS

_thread = threading.local()  # .data: a state of a model of the sizes .sizes, kept because allocating one is slow


def scratch_data(model: mujoco.MjModel) -> mujoco.MjData:
    """Return a state of this thread that fits a model, reset, to be overwritten until the next call."""
    sizes = tuple(getattr(model, name) for name in _sizes())
    if getattr(_thread, "sizes", None) != sizes:
        _thread.sizes = sizes
        _thread.data = mujoco.MjData(model)
    mujoco.mj_resetData(model, _thread.data)
    return _thread.data


@cache
def _sizes() -> tuple[str, ...]:
    """Return the names of the numbers of elements of a model."""
    empty = mujoco.MjSpec().compile()
    return tuple(name for name in dir(empty) if name.startswith("n") and isinstance(getattr(empty, name), int))


# Renaming of elements of an MJCF to the names that a machine needs.

_OBJECT = mujoco.mjtObj

# Digest of a machine's physics: what its author states, without what the engine adds and what is only drawn.

# arrays of MuJoCo's model that leave the physics as they are
_LEFT_OUT = re.compile(
    r"actuator_actearly"  # which the engine sets, whatever the author states
    r"|names_map|name_\w+adr|\w+_(path|contenttype)adr"  # places of names and paths in lists of them
    r"|(tex|mat|light|skin)_\w+|\w+_(rgba|matid)|(geom|site|jnt|tendon|flex)_group|geom_castshadow|tendon_width"
)
_FLAGS = "disableflags"
_OF_ENGINE = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


def rename(spec: mujoco.MjSpec, names: Mapping[str, str]) -> None:
    """Rename elements of an MJCF before its compilation, with what refers to them.

    Args:
        spec: changed in place.
        names: from the name that is needed to the one in the MJCF: "nozzle" of a site, "work" of a body, "needle" of a
            geom, any other of an actuator, whose joint and encoder take it too.

    Raises:
        InputError: an element that the MJCF lacks, a name that is taken, or a joint that a tendon names.
    """
    for new, old in names.items():
        if new in ("nozzle", "work", "needle"):
            kind, elements = {
                "nozzle": (_OBJECT.mjOBJ_SITE, spec.sites),
                "work": (_OBJECT.mjOBJ_BODY, spec.bodies),
                "needle": (_OBJECT.mjOBJ_GEOM, spec.geoms),
            }[new]
            _rename(spec, kind, elements, new, old)
        else:
            _rename_axis(spec, new, old)


def _rename_axis(spec: mujoco.MjSpec, new: str, old: str) -> None:
    actuator = _element(spec.actuators, "actuator", new, old)
    joint = actuator.target
    if actuator.trntype != mujoco.mjtTrn.mjTRN_JOINT:
        raise InputError(
            f'names.{new}: actuator {old!r} drives no joint, but {joint!r}: give it joint="...", a slide or hinge'
        )
    # a path element of a tendon keeps the name that it was made with
    for tendon in spec.tendons:
        if any(getattr(wrap.target, "name", None) == joint for wrap in tendon.path):
            raise InputError(
                f"names.{new}: joint {joint!r} is part of tendon {tendon.name!r}: rename joint and actuator "
                f"in the MJCF to {new!r}"
            )
    for sensor in spec.sensors:
        if sensor.type == mujoco.mjtSensor.mjSENS_ACTUATORPOS and sensor.objname == old:
            _free(spec.sensors, "sensor", new, sensor)
            sensor.name = new
    _rename(spec, _OBJECT.mjOBJ_JOINT, spec.joints, new, joint)
    _rename(spec, _OBJECT.mjOBJ_ACTUATOR, spec.actuators, new, old)


def _rename(spec: mujoco.MjSpec, kind: mujoco.mjtObj, elements: Sequence[Any], new: str, old: str) -> None:
    label = {"SITE": "site", "BODY": "body", "GEOM": "geom", "JOINT": "joint", "ACTUATOR": "actuator"}
    element = _element(elements, label[kind.name.rpartition("_")[2]], new, old)
    element.name = new
    for sensor in spec.sensors:
        if sensor.objtype == kind and sensor.objname == old:
            sensor.objname = new
        if sensor.reftype == kind and sensor.refname == old:
            sensor.refname = new
    for equality in spec.equalities:
        # only other equalities state the kind of the elements that they join
        joins_joints = equality.type == mujoco.mjtEq.mjEQ_JOINT
        if (kind == _OBJECT.mjOBJ_JOINT and joins_joints) or (not joins_joints and equality.objtype == kind):
            for end in ("name1", "name2"):
                if getattr(equality, end) == old:
                    setattr(equality, end, new)
    if kind == _OBJECT.mjOBJ_JOINT:
        for actuator in spec.actuators:
            if actuator.target == old:
                actuator.target = new
    if kind == _OBJECT.mjOBJ_BODY:
        for camera_or_light in (*spec.cameras, *spec.lights):
            if camera_or_light.targetbody == old:
                camera_or_light.targetbody = new
        for pair in spec.excludes:
            for end in ("bodyname1", "bodyname2"):
                if getattr(pair, end) == old:
                    setattr(pair, end, new)


def _element(elements: Sequence[Any], label: str, new: str, old: str) -> Any:
    """Return an element by its name, or raise InputError; the new name must be free."""
    for element in elements:
        if element.name == old:
            _free(elements, label, new, element)
            return element
    if not any(element.name for element in elements):
        raise InputError(f'names.{new}: the MJCF names no {label}: add <{label} name="{old}"/>, or a name to one')
    try:
        raise unknown(label, old, [element.name for element in elements if element.name])
    except InputError as error:
        raise InputError(f"names.{new}: {error}") from None


def _free(elements: Sequence[Any], label: str, new: str, element: Any) -> None:
    if any(other.name == new and other is not element for other in elements):
        raise InputError(f"names.{new}: the MJCF has another {label} {new!r}: rename that one in the MJCF")


# Bounds on sizes in an MJCF, checked before MuJoCo reads it: a few characters can ask for minutes or gigabytes.

_MOST_ELEMENTS = 20_000  # copies by replicate, composite and flexcomp counted each time
_MOST_CELLS = 100_000_000  # of height fields and textures together: as floats 400 MB
_MOST_MEMORY = 4e9  # of <size memory>, [bytes]
_MOST_USER = 100_000  # user values of an element, or of the simulation
_NESTED_FILES = 10  # files that include one another
_SUFFIX = {"k": 2.0**10, "m": 2.0**20, "g": 2.0**30, "t": 2.0**40, "p": 2.0**50, "e": 2.0**60}
_COPIES = ("replicate", "composite", "flexcomp")
_CELLS = {"hfield": ("nrow", "ncol"), "texture": ("width", "height")}


def check_sizes(file: Path) -> None:
    """Check sizes and files that an MJCF states, included files among them.

    A file that is no XML passes: MuJoCo's own message describes the mistake.

    Raises:
        InputError: too many elements or cells, too much memory, or a named file that is no regular one.
    """
    try:
        root = ElementTree.parse(file).getroot()
    except (ElementTree.ParseError, ValueError, OSError):
        return
    elements = 0.0
    cells = 0.0
    for element, copies in _elements(root, file.parent, 1.0, 1):
        elements += copies
        if element.tag in _CELLS:
            cells += math.prod(_number(element, name) for name in _CELLS[element.tag])
        _check_memory(element)
        _check_file(element, root, file.parent)
        if elements > _MOST_ELEMENTS:
            raise InputError(f"has more than {_MOST_ELEMENTS} elements, copies counted each time: must have fewer")
        if cells > _MOST_CELLS:
            raise InputError(
                f"its height fields and textures have {cells:.3g} cells: must have at most {_MOST_CELLS:.3g}"
            )


def _elements(parent: Element, folder: Path, copies: float, depth: int) -> Iterator[tuple[Element, float]]:
    """Yield all elements, of included files too, with the number of times that each is copied."""
    for child in parent:
        if child.tag == "include" and child.get("file"):
            included = folder / str(child.get("file"))
            check_regular(included)
            if depth < _NESTED_FILES and included.is_file():
                try:
                    root = ElementTree.parse(included).getroot()
                except (ElementTree.ParseError, ValueError, OSError):
                    continue
                yield from _elements(root, folder, copies, depth + 1)
            continue
        count = math.prod(_numbers(child.get("count", "1"))) if child.tag in _COPIES else 1.0
        yield child, copies * count
        yield from _elements(child, folder, copies * count, depth)


def _check_memory(element: Element) -> None:
    if element.tag != "size":
        return
    for name, text in element.attrib.items():
        if name == "memory":
            memory = _memory(text)
            if memory > _MOST_MEMORY:
                raise InputError(f"size memory = {text[:20]}: must be at most {_MOST_MEMORY:.3g} bytes")
        elif _number(element, name) > _MOST_USER:
            raise InputError(f"size {name[:20]} = {text[:20]}: must be at most {_MOST_USER}")


def _memory(text: str) -> float:
    """Return a size such as "10M" in bytes, 0 for a text that is not a size."""
    plain = text.strip().lower()
    factor = _SUFFIX.get(plain[-1:], 1.0)
    numbers = _numbers(plain[:-1] if plain[-1:] in _SUFFIX else plain)
    return numbers[0] * factor if numbers else 0.0


def _check_file(element: Element, root: Element, folder: Path) -> None:
    """Refuse a mesh, texture or height field in a file that is no regular one, which MuJoCo would wait for."""
    name = element.get("file")
    if not name:
        return
    asset_folders = [""]
    for compiler in root.iter("compiler"):
        asset_folders += [compiler.get(key, "") for key in ("assetdir", "meshdir", "texturedir")]
    for asset_folder in asset_folders:
        check_regular(folder / asset_folder / name)


def _number(element: Element, name: str) -> float:
    return max(_numbers(element.get(name, "")), default=0.0)


def _numbers(text: str) -> list[float]:
    """Return the numbers of an attribute, without those that are none, which MuJoCo refuses."""
    numbers = []
    for word in text.split()[:10]:
        try:
            numbers.append(max(float(word), 0.0))
        except ValueError:
            continue
    return numbers


_TIMESTEPS = 1e-7, 1.0  # [s]


def compile_mjcf(
    source: Path | mujoco.MjSpec, names: Mapping[str, str] | None = None
) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """Return an MJCF and its compiled model, with room for the servo's row and without MuJoCo's automatic reset.

    Args:
        source: file or MJCF.
        names: new names of elements, given before the compilation, see `rename`.
    """
    try:
        spec = _read(source) if isinstance(source, Path) else source
        rename(spec, names or {})
        spec.nuserdata = max(int(spec.nuserdata), ROW_NUMBERS)
        with warnings.catch_warnings():
            # MuJoCo's bindings warn of a singular inertia by it
            warnings.simplefilter("error", UserWarning)
            compiled = spec.compile()
    except InputError:
        raise
    except UserWarning as warning:
        raise InputError(f"MuJoCo warns: {' '.join(str(warning).split())}") from None
    except (ValueError, mujoco.FatalError) as error:
        raise InputError(" ".join(str(error).split())) from None
    if compiled.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_ACTUATION or compiled.opt.disableactuator:
        raise InputError("disables its actuators; the servo needs them")
    if compiled.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
        raise InputError(
            'integrator RK4 calls the servo four times a step: give <option integrator="implicitfast"/>, or Euler'
        )
    between("timestep", compiled.opt.timestep, *_TIMESTEPS, "s")
    compiled.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    _no_force_early(compiled)
    return spec, compiled


def _read(source: Path) -> mujoco.MjSpec:
    """Return the MJCF in a file, or the MJCF of a machine from its table in a TOML file, alone or beside a URDF."""
    if source.suffix.lower() in (".toml", ".urdf"):
        # slow to import, and for tables alone
        from gantrysim.machine.design.build import mjcf_in

        return mujoco.MjSpec.from_string(mjcf_in(source))
    check_sizes(source)
    return mujoco.MjSpec.from_file(str(source))


def _no_force_early(compiled: mujoco.MjModel) -> None:
    """Take a dcmotor's force from its current at the beginning of a step.

    MuJoCo compiles it to be taken from the current at the end. With semi-implicit Euler, whose positions lead by half a
    step, motion is then about a step early, and every loop seems more stable than it is. From the beginning, the force
    is late by the half step by which positions are early, and the error falls with the square of the step.
    """
    compiled.actuator_actearly[:] = False


def without_visuals(spec: mujoco.MjSpec, compiled: mujoco.MjModel) -> mujoco.MjModel:
    """Return a compiled model without visual-only elements; its dynamics are the same to the last bit.

    Steps need not place these geoms, cameras and lights, and copies hold no textures. MuJoCo keeps a geom that defines
    a body's inertia; if a sensor uses a camera, the result is the compiled model itself.
    """
    # a second compilation, as MuJoCo cannot remove elements from a compiled model
    bare = spec.copy()
    bare.compiler.discardvisual = True
    bare.visual = mujoco.MjSpec().visual
    # nan: to be computed. An array, as MuJoCo would drop an interrupt while it converts a list
    bare.stat.center = np.full(3, np.nan)
    bare.stat.extent = np.nan
    bare.stat.meansize = np.nan
    for element in (*bare.cameras, *bare.lights):
        bare.delete(element)
    try:
        physics = bare.compile()
    except (ValueError, mujoco.FatalError):  # such as of a sensor whose camera is gone
        return compiled
    physics.opt.disableflags = compiled.opt.disableflags
    _no_force_early(physics)
    return physics


def digest_of(model: mujoco.MjModel) -> str:
    """Return the SHA-256 of the physics of a compiled model.

    Arrays count with their shapes, so that numbers of elements need not be counted; sizes of memory and of user data,
    which the engine has for itself, are left out. Names of elements count, as they say which joint is which axis. The
    model's own name does not, nor do the paths of its files.
    """
    digest = hashlib.sha256()
    for name, value in _digested_values(model):
        array = np.asarray(value)
        # such as of elements that the model has none of
        if not array.size:
            continue
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _digested_values(model: mujoco.MjModel) -> Iterator[tuple[str, object]]:
    """Yield the names and values of what counts."""
    for name in _arrays():
        yield name, getattr(model, name)
    for name in dir(model.opt):
        value = getattr(model.opt, name)
        if not name.startswith("_") and not callable(value):
            yield f"opt.{name}", value & ~_OF_ENGINE if name == _FLAGS else value
    # by which the solver measures its error
    yield "stat.meaninertia", model.stat.meaninertia
    _, *names = model.names.split(b"\0")
    yield "names", b"\0".join(names)
    yield "text_data", model.text_data


@cache
def _arrays() -> tuple[str, ...]:
    """Return the names of the arrays that count."""
    empty = mujoco.MjSpec().compile()
    public = [name for name in dir(empty) if not name.startswith("_") and not _LEFT_OUT.fullmatch(name)]
    return tuple(name for name in public if isinstance(getattr(empty, name), np.ndarray))


class PhysicsModels:
    """The model of a machine's physics, and copies of it for steps of some length.

    The models of a perturbed machine are made when they are first asked for: a copy takes long beside all else that an
    agent's episode or a case of a study needs, and the compiled loop needs none.

    Args:
        physics: the model.
    """

    def __init__(self, physics: mujoco.MjModel) -> None:
        self._physics: mujoco.MjModel | None = physics
        self._unperturbed = physics
        self._arrays: mujoco.MjModel | ModelArrays | None = physics
        self._make = physics.__copy__
        self._make_arrays: Callable[[], ModelArrays] | None = None
        self._stepped: dict[tuple[float, bool, bool], mujoco.MjModel] = {}

    def perturbed(self, make: Callable[[], mujoco.MjModel], arrays: Callable[[], ModelArrays]) -> PhysicsModels:
        """Return the models of a perturbed machine.

        Args:
            make: returns a copy of `physics` with the perturbation in its arrays.
            arrays: returns those of such a copy.
        """
        models = PhysicsModels(self.layout)
        models._physics = None
        models._arrays = None
        models._make_arrays = arrays
        models._make = make
        return models

    @property
    def physics(self) -> mujoco.MjModel:
        """The model; always the same object."""
        if self._physics is None:
            self._physics = self._make()
        return self._physics

    @property
    def layout(self) -> mujoco.MjModel:
        """A model with the joints, stops and options of `physics`, which perturbations do not change."""
        return self._unperturbed if self._physics is None else self._physics

    @property
    def arrays(self) -> mujoco.MjModel | ModelArrays:
        """What `physics` has in its arrays, but for those that MuJoCo derives from the masses."""
        if self._physics is not None:
            return self._physics
        if self._arrays is None:
            assert self._make_arrays is not None
            self._arrays = self._make_arrays()
        return self._arrays

    def stepping(self, timestep: float, voltage: bool, stops: bool) -> mujoco.MjModel:
        """Return a copy of `physics` for steps of a length; see `Machine.stepping`."""
        key = timestep, voltage, stops
        if key not in self._stepped:
            model = self._make() if self._physics is None else copy.copy(self._physics)
            set_for_steps(model, *key)
            self._stepped[key] = model
        return self._stepped[key]
