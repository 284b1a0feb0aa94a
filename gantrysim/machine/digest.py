"""Digest of a machine's physics: what its author states, without what the engine adds and what is only drawn."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from functools import cache

import mujoco
import numpy as np

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
    for name, value in _parts(model):
        array = np.asarray(value)
        if not array.size:  # such as of elements that the model has none of
            continue
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return digest.hexdigest()


def _parts(model: mujoco.MjModel) -> Iterator[tuple[str, object]]:
    """Yield the names and values of what counts."""
    for name in _arrays():
        yield name, getattr(model, name)
    for name in dir(model.opt):
        value = getattr(model.opt, name)
        if not name.startswith("_") and not callable(value):
            yield f"opt.{name}", value & ~_OF_ENGINE if name == _FLAGS else value
    yield "stat.meaninertia", model.stat.meaninertia  # by which the solver measures its error
    _, *names = model.names.split(b"\0")
    yield "names", b"\0".join(names)
    yield "text_data", model.text_data


@cache
def _arrays() -> tuple[str, ...]:
    """Return the names of the arrays that count."""
    empty = mujoco.MjSpec().compile()
    public = [name for name in dir(empty) if not name.startswith("_") and not _LEFT_OUT.fullmatch(name)]
    return tuple(name for name in public if isinstance(getattr(empty, name), np.ndarray))
