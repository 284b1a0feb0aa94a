"""Other parts: a faster servo, finer encoders, a better accuracy class."""

from __future__ import annotations

from gantrysim.machine.geometry import SCREWS
from gantrysim.remedy.lever import Effort, Lever, Setting, State, milliseconds, rounded_number
from gantrysim.results.verdict import PATH, STABILITY

_DIVISORS = (2, 4)
_COUNTS = (4, 16)
_CLASSES = 2  # finer ones that are tried


def _periods(state: State) -> list[Setting] | str:
    period = state.job.built_servo.period
    values = [rounded_number(period / divisor) for divisor in _DIVISORS]
    return [Setting(milliseconds(value), {"servo.period": value}) for value in values]


def _encoders(state: State) -> list[Setting] | str:
    counts = state.job.built_servo.per_axis("resolution")
    if not any(counts):
        return "the encoders are exact"
    return [
        Setting(f"counts / {divisor}", {"servo.resolution": [rounded_number(count / divisor) for count in counts]})
        for divisor in _COUNTS
    ]


def _accuracy(state: State) -> list[Setting] | str:
    geometry = state.job.geometry
    if geometry is None:
        return "the machine's geometry is ideal in this job"
    if geometry.accuracy is None:
        return "the job gives the errors of the geometry one by one, without a class"
    # a class is a letter of its standard and a number, smaller for a finer machine
    family = [name for name in SCREWS if name[0] == geometry.accuracy[0]]
    finer = [name for name in family if int(name[1:]) < int(geometry.accuracy[1:])]
    finer.sort(key=lambda name: -int(name[1:]))
    if not finer:
        return f"{geometry.accuracy} is the finest class of its standard"
    return [Setting(name, {"geometry.accuracy": name}) for name in finer[:_CLASSES]]


SERVO_PERIOD = Lever(
    name="servo period",
    meaning="time between two samples of the servo, with gains designed for it",
    cost="a faster controller",
    rows=(PATH, STABILITY),
    settings=_periods,
    causes=("sampling", "friction"),
    effort=Effort.HARDWARE,
)
ENCODER = Lever(
    name="encoder",
    meaning="counts of the encoders",
    cost="other encoders",
    rows=(PATH,),
    settings=_encoders,
    causes=("counts",),
    effort=Effort.HARDWARE,
)
ACCURACY_CLASS = Lever(
    name="accuracy class",
    meaning="accuracy class of screws and guides",
    cost="another machine",
    rows=(PATH,),
    settings=_accuracy,
    causes=("geometry",),
    effort=Effort.HARDWARE,
)
