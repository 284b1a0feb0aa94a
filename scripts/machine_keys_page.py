"""Write the tables of docs/machines.md: every key of a machine's table and the motors of the library, from the code."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from gantrysim.machine.design.library import AcServo, Motor, counts_of, encoder_names, motor_names, motor_of
from gantrysim.machine.design.table import Belt, Drive, Guides, MachineTable, Masses, Rack, Screw, Slide
from gantrysim.machine.design.urdf import UrdfAxis, UrdfNozzle, UrdfTable
from gantrysim.machine.geometry import SCREWS

PAGE = Path(__file__).parent.parent / "docs" / "machines.md"
PLACE = re.compile(r"(<!-- written by scripts/machine_keys_page.py -->\n).*?(<!-- end -->)", re.DOTALL)

TABLES: tuple[tuple[str, type[BaseModel]], ...] = (
    ("The machine", MachineTable),
    ("`[masses]`", Masses),
    ("`[x]`, `[y]`, `[z]`", Slide),
    ("`[x.guides]`", Guides),
    ("`[x.drive]`, `[belts]`", Drive),
    ('`[x.drive.transmission]`, `kind = "screw"`', Screw),
    ('`[x.drive.transmission]`, `kind = "belt"`', Belt),
    ('`[x.drive.transmission]`, `kind = "rack"`', Rack),
    ("`[x.drive.motor]`, a motor that is not in the library", Motor),
    ('`[x.drive.motor]`, `kind = "ac servo"`, by its data sheet', AcServo),
    ("The table beside a URDF", UrdfTable),
    ("`nozzle` beside a URDF", UrdfNozzle),
    ("`[x]`, `[y]`, `[z]` beside a URDF", UrdfAxis),
)


def default(value: Any) -> str:
    """Return a default as a table states it."""
    if value is None or value == {}:
        return "none"
    if isinstance(value, BaseModel):
        return "table"
    if isinstance(value, tuple):
        return f"{list(value)}"
    return f'"{value}"' if isinstance(value, str) else f"{value:g}"


def rows(model: type[BaseModel]) -> Iterator[str]:
    """Yield a row per key."""
    for name, field in model.model_fields.items():
        shown = "required" if field.is_required() else default(field.default)
        yield f"| `{name}` | {shown} | {field.description} |"


def table(listed: Iterable[str]) -> str:
    """Return a table of rows of keys, which opens from a line with their names."""
    shown = list(listed)
    names = ", ".join(row.split("`")[1] for row in shown)
    return folded(f"keys: {names}", "| key | default | meaning |\n| --- | --- | --- |\n" + "\n".join(shown) + "\n")


def folded(summary: str, text: str) -> str:
    """Return a table that opens from a line."""
    return f'<details markdown="1">\n<summary>{summary}</summary>\n\n{text}\n</details>\n'


def common(*models: type[BaseModel]) -> list[str]:
    """Return the rows that tables have alike."""
    first, *others = (list(rows(model)) for model in models)
    return [row for row in first if all(row in other for other in others)]


def motors() -> Iterator[str]:
    """Yield a row per motor of the library."""
    for name in motor_names():
        motor = motor_of(name)
        speed = motor.computed_ratings["no_load_speed"]
        stall = motor.computed_ratings["stall_torque"]
        yield (
            f"| `{name}` | {motor.kind} | {motor.voltage:g} | {motor.K:.3g} | {motor.resistance:g} | {speed:.0f} | "
            f"{stall:.3g} | {motor.continuous:.3g} | {motor.K * motor.current:.3g} | {1e6 * motor.rotor_inertia:.3g} |"
        )


def tables() -> str:
    """Return the tables of keys and of the library."""
    text = ""
    for title, model in TABLES:
        if model is Screw:
            text += f"\n### `[x.drive.transmission]`, of every kind\n\n{table(common(Screw, Belt, Rack))}"
        own = list(rows(model))
        if model in (Screw, Belt, Rack):
            own = [row for row in own if row not in common(Screw, Belt, Rack)]
        text += f"\n### {title}\n\n{table(own)}"
    text += (
        "\n### Motors of the library\n\nNo-load speed and stall torque follow from the other values, at the nominal "
        "voltage. Sources of every number: `gantrysim/machine/design/library.toml`. For an ac servo, K and the "
        "currents are those of its equivalent DC motor, see [how the values are used](#how-the-values-are-used).\n\n"
        + folded(
            f"{len(motor_names())} motors with their values",
            "| motor | kind | V | K [N·m/A] | R [ohm] | no-load [rpm] | stall [N·m] | continuous [N·m] | peak [N·m] "
            "| rotor [1e-6 kg·m²] |\n" + "| --- " * 10 + "|\n" + "\n".join(motors()) + "\n",
        )
    )
    encoders = ", ".join(f"`{name}` {counts_of(name):g}" for name in encoder_names())
    text += f"\n### Encoders of the library\n\nCounts per revolution, all four edges where incremental: {encoders}.\n"
    classes = ", ".join(f"{name} {error:g}" for name, (error, _) in SCREWS.items())
    return text + f"\nAccuracy classes of screws, error over 300 mm of travel in µm, plus or minus: {classes}.\n"


def page() -> str:
    """Return the page with its tables written anew."""
    return PLACE.sub(lambda place: place[1] + tables() + place[2], PAGE.read_text(encoding="utf-8"))


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
