"""The rooms whose answers are pinned, a module and a file each."""

from importlib import import_module

# with the tolerance of their numbers: encoder counts and friction amplify the last bit of a setpoint, so that figures
# of a run on a machine are good to half a percent
ROOMS = {
    "programs": 1e-6,
    "glue": 1e-6,
    "servos": 1e-6,
    "runs": 5e-3,
    "commands": 5e-3,
    "environments": 1e-3,
    "plots": 5e-3,
    "pages": 5e-3,
    "pictures": 5e-3,
    "designs": 1e-6,
    "mechanics": 1e-6,
    "comparisons": 5e-3,
    "exchanges": 1e-5,
    "identifications": 5e-3,
    "jobs": 1e-6,
    "workbench": 5e-3,
    "studies": 5e-3,
}


def cases_of(room):
    """What makes the answer of each case, by its name."""
    return import_module(f"pinned.{room}").CASES
