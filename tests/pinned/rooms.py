"""The rooms whose answers are pinned, a module and a file each."""

from importlib import import_module

ROOMS = ("programs", "glue", "servos")


def cases_of(room):
    """What makes the answer of each case, by its name."""
    return import_module(f"pinned.{room}").CASES
