"""How far machines that are built to one drawing differ."""

from __future__ import annotations

from dataclasses import dataclass, fields

from gantrysim.errors import InputError, at_least, unknown

__all__ = ["Spread", "in_words"]


@dataclass(frozen=True)
class Spread:
    """How far machines differ; what is 0 does not.

    A payload lies evenly between 0 and its spread. A factor lies between 1 / (1 + spread) and 1 + spread, evenly on a
    logarithmic scale, so that half of the machines have more than the nominal one and half have less; each axis has
    its own. The default values are assumptions: friction and its viscous part vary most from machine to machine,
    with preload, seals and grease; motor constants are of a catalogue's tolerance.

    Attributes:
        payload: [kg].
        friction: of the Coulomb and static friction, relative.
        viscous: of the viscous friction, relative.
        stiffness: of the drive trains' springs, relative.
        motor_constant: of the motors, relative.
    """

    payload: float = 0.3
    friction: float = 0.5
    viscous: float = 0.5
    stiffness: float = 0.3
    motor_constant: float = 0.1

    def __post_init__(self) -> None:
        for f in fields(self):
            at_least(f"spread of {f.name}", getattr(self, f.name), 0, "kg" if f.name == "payload" else "")

    @classmethod
    def parse(cls, text: str) -> Spread:
        """Return a spread from words, as in "payload=0.5,friction=0.3"; what is left out keeps its default.

        Raises:
            InputError: words that are none of this.
        """
        values: dict[str, float] = {}
        known = [f.name for f in fields(cls)]
        for item in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (part.strip() for part in item.partition("="))
            if name not in known:
                raise unknown("spread", name, known)
            try:
                values[name] = float(value)
            except ValueError:
                raise InputError(f"spread {item}: must be {name}= and a number") from None
        return cls(**values)


def in_words(factor: str) -> str:
    """Return what a factor of `Spread` or of a study's columns is called, as in "friction of x"."""
    words = {
        "payload_kg": "payload",
        "payload": "payload",
        "friction": "friction",
        "viscous": "viscous friction",
        "stiffness": "stiffness",
        "motor_constant": "motor constant",
    }
    for name, said in words.items():
        if factor == name:
            return said
        if factor.startswith(f"{name}_"):
            return f"{said} of {factor.removeprefix(f'{name}_')}"
    return factor
