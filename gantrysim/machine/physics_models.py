"""The compiled model of a machine's physics, and the copies of it that are stepped."""

from __future__ import annotations

import copy
import hashlib
import re
import threading
from collections.abc import Callable, Iterator
from functools import cache

import mujoco
import numpy as np

from gantrysim.base.arrays import Floats
from gantrysim.machine.motors import set_for_steps

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


# Digest of a machine's physics: what its author states, without what the engine adds and what is only drawn.

# arrays of MuJoCo's model that leave the physics as they are
_LEFT_OUT = re.compile(
    r"actuator_actearly"  # which the engine sets, whatever the author states
    r"|names_map|name_\w+adr|\w+_(path|contenttype)adr"  # places of names and paths in lists of them
    r"|(tex|mat|light|skin)_\w+|\w+_(rgba|matid)|(geom|site|jnt|tendon|flex)_group|geom_castshadow|tendon_width"
)
_FLAGS = "disableflags"
_OF_ENGINE = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)


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

    A copy takes a tenth of the time in which an agent's episode is drawn, and an episode needs the stepped model alone.
    The physics of a perturbed machine is therefore made when it is first asked for.

    Args:
        physics: the model.
    """

    def __init__(self, physics: mujoco.MjModel) -> None:
        self._physics: mujoco.MjModel | None = physics
        self._unperturbed = physics
        self._reference: Floats = physics.qpos0
        self._make = physics.__copy__
        self._unused: list[mujoco.MjModel] = []
        self._stepped: dict[tuple[float, bool, bool], mujoco.MjModel] = {}

    def perturbed(self, make: Callable[[], mujoco.MjModel], model: mujoco.MjModel) -> PhysicsModels:
        """Return the models of a perturbed machine.

        Args:
            make: returns a copy of `physics` with the perturbation in its arrays.
            model: such a copy, which nobody else has; it goes to the first who needs one.
        """
        models = PhysicsModels(self.layout)
        models._physics = None
        models._reference = model.qpos0.copy()
        models._make = make
        models._unused = [model]
        return models

    @property
    def physics(self) -> mujoco.MjModel:
        """The model; always the same object."""
        if self._physics is None:
            self._physics = self._own_physics()
        return self._physics

    @property
    def layout(self) -> mujoco.MjModel:
        """A model with the joints, stops and options of `physics`, which perturbations do not change."""
        return self._unperturbed if self._physics is None else self._physics

    @property
    def reference(self) -> Floats:
        """Reference of the joints, qpos0 of `physics`, (nq,)."""
        return self._reference if self._physics is None else self._physics.qpos0

    def stepping(self, timestep: float, voltage: bool, stops: bool) -> mujoco.MjModel:
        """Return a copy of `physics` for steps of a length; see `Machine.stepping`."""
        key = timestep, voltage, stops
        if key not in self._stepped:
            model = self._own_physics()
            set_for_steps(model, *key)
            self._stepped[key] = model
        return self._stepped[key]

    def _own_physics(self) -> mujoco.MjModel:
        """Return a copy of `physics` that nobody else has."""
        if self._physics is not None:
            return copy.copy(self._physics)
        try:
            return self._unused.pop()
        except IndexError:
            return self._make()
