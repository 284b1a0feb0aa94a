"""Every kind of path that the package has is found by its name, in whatever process."""

import inspect
import json
import math
import pkgutil
from importlib import import_module

import numpy as np
import pytest

import gantrysim
from gantrysim import InputError
from gantrysim.paths.arcs import ArcChain
from gantrysim.paths.chain import Chain
from gantrysim.paths.kinds import KINDS, kind_of, path_of
from gantrysim.paths.path import Path
from gantrysim.paths.pieces import Coil, Line
from gantrysim.paths.spirals import Involute
from gantrysim.paths.track import Track

from support.soaked import suite_runs

EXAMPLES = {
    "ArcChain": ArcChain((1, 2), 0.5, [0.1, 0, -0.02], [5, 6, 7]),
    "Chain": Chain([Line((0, 0, 0), (3, 4, 1)), Coil((3, 9, 1), (5.0, 5.0), -math.pi / 2, math.pi, 2.0)]),
    "Involute": Involute(50, 10, 2),
    "Track": Track((0, 0, 0), [(3, 4, 1), (3, 14, 1)], [0, math.pi], [(0, 0, 0), (3, 9, 1)], [0, 0], [np.eye(3)]),
}
ALONE = """
import json, sys
from gantrysim.paths.kinds import path_of
path = path_of(sys.argv[1], json.loads(sys.argv[2]))
print(type(path).__name__, repr(path.length))
"""


class Ramp(ArcChain):
    """A path of a user's own module: a line of a given length."""

    def __init__(self, length):
        super().__init__((0, 0), 0.0, [0.0], [length])

    def parameters(self):
        return {"length": self.length}


def subclasses(base):
    return {kind for direct in base.__subclasses__() for kind in (direct, *subclasses(direct))}


def record(path):
    """The parameters of a path as a record holds them."""
    return json.dumps({name: np.asarray(v).tolist() for name, v in path.parameters().items()}, default=vars)


def test_every_path_of_the_package_has_a_name_and_an_example():
    for module in pkgutil.walk_packages(gantrysim.__path__, "gantrysim."):
        if not module.name.endswith("__main__"):
            import_module(module.name)
    own = {kind for kind in subclasses(Path) if kind.__module__.startswith("gantrysim.")}
    concrete = {kind.__name__: kind for kind in own if not inspect.isabstract(kind)}
    assert concrete == KINDS
    assert {name: type(path) for name, path in EXAMPLES.items()} == KINDS


@pytest.mark.parametrize("name", suite_runs(EXAMPLES, 0))
def test_a_path_is_built_from_its_record_in_a_process_that_imported_nothing_else(fresh, tmp_path, name):
    path = EXAMPLES[name]
    done = fresh.run(ALONE, tmp_path, kind_of(path), record(path))
    assert (done.output.split(), done.error) == ([name, repr(path.length)], "")


def test_a_user_s_path_is_named_with_its_module_and_found_once_that_is_imported(fresh, tmp_path):
    name = kind_of(Ramp(5.0))
    assert name == f"{Ramp.__module__}:Ramp"
    assert type(path_of(name, {"length": 5.0})) is Ramp
    done = fresh.run(ALONE, tmp_path, name, record(Ramp(5.0)))
    assert done.status == 1
    assert f"InputError: path {name}: import {Ramp.__module__} before this record is read" in done.error


def test_a_user_s_path_with_the_name_of_one_of_the_package_stands_for_itself():
    own = type("Chain", (Ramp,), {"__module__": "my_paths"})
    assert kind_of(own(5.0)) == "my_paths:Chain"
    assert type(path_of("my_paths:Chain", {"length": 5.0})) is own
    assert path_of("Chain", EXAMPLES["Chain"].parameters()).length == EXAMPLES["Chain"].length


def test_unknown_kind_of_path_names_the_nearest_and_all():
    with pytest.raises(
        InputError, match=r"unknown path 'Involut': did you mean Involute\? known: Involute, ArcChain, Chain, Track"
    ):
        path_of("Involut", {})


def test_only_whole_paths_with_their_own_parameters_are_built():
    with pytest.raises(InputError, match=r"unknown path '_Hidden'"):
        path_of("_Hidden", {})
    with pytest.raises(InputError, match=r"path Involute: .*unexpected keyword argument 'x'"):
        path_of("Involute", {"x": 1})
