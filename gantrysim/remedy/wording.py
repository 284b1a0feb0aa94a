"""A change of a job in words: from its present values to the new ones with their units, and comments on its lines."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from gantrysim.base.errors import InputError
from gantrysim.base.quantity import number_text
from gantrysim.glue.dispenser.dispenser import DEMANDS
from gantrysim.job.job import Job
from gantrysim.job.key_list import meanings_of
from gantrysim.remedy.lever import GAIN_ARROW, Trial, value_of
from gantrysim.remedy.levers.program import FASTER, SLOWER
from gantrysim.servo.laws import FRICTION

_UNIT = re.compile(r"\[([^\[\]]+)\]\.?$")
# of a meaning: what stands before its unit and its details
_BRIEF_MEANING = re.compile(r" *[\[(;:,.]")
# of a meaning: where a further phrase begins, without which it still says something
_PHRASE = re.compile(
    r" (?=(?:above|after|ahead|and|as|at|before|below|between|by|for|from|in|of|on|or|over|than|that|to|under|until|"
    r"when|where|which|while|with)\b|\")"
)
# what a key does at 0, where that is no smaller value of it
_AT_ZERO = {
    **{f"dispenser.{name}": "0: the flow follows the path speed, see area" for name in DEMANDS if name != "area"},
    "program.wait_resolution": "0: waits are exact",
}
LAW = "servo.law"
_FORM = ".4g"
_MEANING_LENGTH = 48  # characters of a meaning behind a line
_DISPENSER = "dispenser."
_DEMANDS = tuple(f"{_DISPENSER}{name}" for name in DEMANDS)
_SPEED_LEVERS = (SLOWER.name, FASTER.name)


class Keys:
    """The keys of a job in words.

    Args:
        base: the job as it is.
    """

    def __init__(self, base: Job) -> None:
        self._base = base
        self._meanings = meanings_of(base)

    def unit(self, key: str) -> str:
        """Return the unit of a key's value; empty for a ratio, a text, and an unknown key."""
        match = _UNIT.search(self._meanings.get(key, ""))
        return match[1] if match else ""

    def meaning(self, key: str) -> str:
        """Return what a key sets, in a few words; empty for an unknown one."""
        if key == LAW:
            return "control law"
        return _shortened_meaning(_BRIEF_MEANING.split(self._meanings.get(key, ""), maxsplit=1)[0])

    def before(self, key: str) -> Any:
        """Return the present value of a key, chosen or derived where the job does not give it; None if unknown."""
        table, _, leaf = key.partition(".")
        if table == "program":
            return value_of(self._base.controller.arguments(), leaf)
        value: Any = getattr(self._base, table, None)
        for name in leaf.split(".") if leaf else ():
            value = getattr(value, name, None)
        if value is None and key == "bead.gap":
            return self._base.built_machine.gap
        if value is None and table == "servo":
            return _of_servo(self._base, leaf)
        return value


def _shortened_meaning(meaning: str) -> str:
    """Return a meaning up to the last phrase that fits behind a line, and does not end with a word that opens one."""
    if len(meaning) <= _MEANING_LENGTH:
        return meaning
    ends = [match.start() for match in _PHRASE.finditer(meaning, 0, _MEANING_LENGTH + 1)]
    phrases = [meaning[:end] for end in ends if not _PHRASE.search(f" {meaning[:end].rpartition(' ')[2]} ")]
    return phrases[-1] if phrases else ""


def _of_servo(job: Job, name: str) -> Any:
    """Return the built servo's value of a gain, one number where all axes share it; None for another setting."""
    servo = job.built_servo
    try:
        values = list(servo.per_axis(name))
    except InputError:
        return None
    return values[0] if len(set(values)) == 1 else values


def comment_of(keys: Keys, key: str, value: Any) -> str:
    """Return the comment on a line to paste: the unit, the former value, and what the key sets; empty without any."""
    unit = keys.unit(key)
    former = keys.before(key)
    is_plain = isinstance(former, str | bool) or _is_numeric(former)
    parts = [unit] if unit else []
    if is_plain and former != value:
        parts.append(f"was {value_text(former)}")
    meaning = _AT_ZERO.get(key) if value == 0 else None
    if meaning is None:
        meaning = keys.meaning(key)
    return "; ".join(filter(None, (", ".join(parts), meaning)))


def notes_of_law(base: Job, improved: Job) -> Iterator[str]:
    """Yield what a line on the servo's law leaves to the machine's model: the values of friction compensation."""
    if FRICTION.name in base.built_servo.laws.names or FRICTION.name not in improved.built_servo.laws.names:
        return
    axes = ", ".join(improved.built_machine.axis_names)
    yield f"this law takes the friction of the machine's model, in the order {axes}; gantrysim identify finds yours:"
    for parameter in FRICTION.parameters:
        values = ", ".join(f"{value:.4g}" for value in improved.built_servo.per_axis(parameter.name))
        units = [parameter.unit.replace("u", axis.unit) for axis in improved.built_machine.axes]
        unit = units[0] if len(set(units)) == 1 else ", ".join(units)
        yield f"{parameter.name} = [{values}]  {unit}"


def value_text(value: Any) -> str:
    """Return a value of a key as text; equal numbers of all axes as one."""
    if _is_numbers(value):
        numbers = [f"{number:g}" for number in value]
        return numbers[0] if len(set(numbers)) == 1 else f"[{', '.join(numbers)}]"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(value_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    return f"{value:g}" if isinstance(value, int | float) else f'"{value}"'


def _is_numeric(value: Any) -> bool:
    return _is_number(value) or _is_numbers(value)


def _is_numbers(value: Any) -> bool:
    return isinstance(value, list | tuple) and bool(value) and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def words_of(trials: Sequence[Trial], base: Job, improved: Job) -> str:
    """Return levers in words, each with the values before and after, as in "acceleration 3000 → 750 mm/s²".

    Args:
        trials: levers of a combination, in the order in which they are told.
        base: the job as it is.
        improved: the job with the whole combination.
    """
    keys = Keys(base)
    after = Keys(improved)
    shown_keys: set[str] = set()
    texts = []
    for trial in trials:
        changes = {
            key: (keys.before(key), after.before(key))
            for key in trial.changes
            if key not in shown_keys and keys.before(key) != after.before(key)
        }
        shown_keys |= set(changes)
        texts.append(_lever_text(trial, changes, keys, base, improved))
    return "; ".join(texts)


def _lever_text(trial: Trial, changes: Mapping[str, tuple[Any, Any]], keys: Keys, base: Job, improved: Job) -> str:
    """Return one lever in words.

    Args:
        trial: the lever.
        changes: values before and after, by their keys.
        keys: of the job as it is.
        base: the job as it is.
        improved: the job with the whole combination.
    """
    name = trial.lever.name
    if f"{_DISPENSER}area" in changes:
        return f"{name}: {_flow_text(changes, base, improved)}"
    numbers = {
        # a value that is switched off has no size
        key: values
        for key, values in changes.items()
        if all(map(_is_numeric, values)) and not (key in _AT_ZERO and not values[1])
    }
    texts = {
        key.rpartition(".")[2].replace("_", " "): _change_text(*values, keys.unit(key))
        for key, values in numbers.items()
        if name not in _SPEED_LEVERS or key in _DEMANDS
    }
    if name in _SPEED_LEVERS:
        speeds = (base.controller.programmed_speed, improved.controller.programmed_speed)
        texts = {"speed": _change_text(*speeds, "mm/s"), **texts}
    if not texts and trial.setting.partition(" ")[0].isdecimal():
        meaning = f" ({trial.lever.meaning})" if trial.lever.meaning else ""
        return f"{name} {trial.setting}{meaning}"
    if not texts:
        return f"{name} ({trial.setting})" if trial.setting else name
    if len(texts) == 1 and name not in _SPEED_LEVERS:
        ((leaf, text),) = texts.items()
        return f"{name} {text}" if leaf in name else f"{name} ({leaf}) {text}"
    listed = ", ".join(f"{leaf} {text}" for leaf, text in texts.items())
    return listed if name in texts else f"{name}: {listed}"


def _flow_text(changes: Mapping[str, tuple[Any, Any]], base: Job, improved: Job) -> str:
    """Return how the flow is stated before and after, where it follows the path speed afterwards."""
    former = [key for key in changes if key in _DEMANDS and changes[key][0] and not changes[key][1]]
    texts = [f"{changes[key][0]:g} {DEMANDS[key.removeprefix(_DISPENSER)]} constant{GAIN_ARROW}" for key in former]
    lags = (base.dispenser.advance, improved.dispenser.advance)
    lag = f", lag compensation {_change_text(*lags, 's')}" if lags[0] != lags[1] else ""
    return f"{''.join(texts[:1])}{improved.dispenser.area:g} mm² (area) × path speed{lag}"


def _change_text(former: Any, now: Any, unit: str) -> str:
    """Return a value before and after with its unit; times in milliseconds."""
    if unit == "s":
        former = _scaled_value(former, 1e3)
        now = _scaled_value(now, 1e3)
        unit = "ms"
    return f"{_numbers_text(former)}{GAIN_ARROW}{_numbers_text(now)}{f' {unit}' if unit else ''}"


def _scaled_value(value: Any, factor: float) -> Any:
    return [factor * item for item in value] if isinstance(value, list | tuple) else factor * value


def _numbers_text(value: Any) -> str:
    numbers = [number_text(item, _FORM) for item in (value if isinstance(value, list | tuple) else [value])]
    return numbers[0] if len(set(numbers)) == 1 else ", ".join(numbers)
