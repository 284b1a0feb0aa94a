"""Deliberate faults as values: what they refuse, say and become as tables."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gantrysim import InputError
from gantrysim.faults import (
    KINDS,
    AirBubble,
    BusSag,
    CloggedNozzle,
    DrippingNozzle,
    EncoderDropout,
    EncoderGlitch,
    EncoderSlip,
    InjectedFault,
    LostPackets,
    OpenWinding,
    SlippingAxis,
    StuckAxis,
    fault_of,
)
from gantrysim.faults.fault import FaultAxis

TEXTS = {
    EncoderDropout(time=1, axis="x"): "encoder dropout on axis x at t = 1.0000 s: position frozen until the end",
    EncoderGlitch(time=1, axis="x", counts=-5): "encoder glitch on axis x at t = 1.0000 s: −5 counts for 1 servo tick",
    EncoderGlitch(time=0, axis="x", counts=5, ticks=3): "encoder glitch on axis x at t = 0.0000 s: +5 counts for 3 "
    "servo ticks",
    EncoderSlip(time=0.5, axis="y", counts=100): "encoder slip on axis y at t = 0.5000 s: +100 counts until the end",
    StuckAxis(time=1, axis="x", duration=0.2): "stuck axis x at t = 1.0000 s: seized for 0.2 s",
    StuckAxis(time=1, axis="x", friction=7): "stuck axis x at t = 1.0000 s: friction 7 N or N·m until the end",
    SlippingAxis(time=1, axis="x", offset=0.1): "slipping axis x at t = 1.0000 s: the axis lags its motor by 0.1 mm or "
    "deg until the end",
    OpenWinding(time=1, axis="x"): "open winding on axis x at t = 1.0000 s: no current until the end",
    BusSag(time=1, share=0.25): "bus sag at t = 1.0000 s: 25 % of the bus voltage until the end",
    LostPackets(time=1, ticks=4): "lost packets at t = 1.0000 s: no setpoint for 4 servo ticks, the drive holds the "
    "last one",
    CloggedNozzle(time=1, share=0.2, duration=3): "clogged nozzle at t = 1.0000 s: 20 % of the flow for 3 s",
    DrippingNozzle(time=1, flow=2): "dripping nozzle at t = 1.0000 s: 2 mm³/s while the valve is closed, until the end",
    AirBubble(time=1, volume=2): "air bubble at t = 1.0000 s: 2 mm³ of air",
    AirBubble(time=1, volume=2, pressure=101.325): "air bubble at t = 1.0000 s: 2 mm³ of air, then a surge of 2 mm³",
}


@pytest.mark.parametrize(("fault", "text"), TEXTS.items())
def test_a_fault_says_what_it_does_and_is_made_again_of_its_table(fault, text):
    assert str(fault) == text
    assert fault_of(fault.table()) == fault
    assert fault.acts


def test_every_kind_is_among_them():
    assert {fault.kind for fault in TEXTS} == set(KINDS)
    made = {kind for base in InjectedFault.__subclasses__() for kind in (base, *base.__subclasses__())}
    assert {kind for kind in made if "kind" in vars(kind)} == set(KINDS.values())


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda: OpenWinding(time=-1, axis="x"), "fault open winding: time = -1 s: must be at least 0 s"),
        (lambda: OpenWinding(time=math.nan, axis="x"), "fault open winding: time = nan s: must be finite"),
        (
            lambda: OpenWinding(time=1, axis="x", duration=-1),
            "fault open winding: duration = -1 s: must be at least 0 s",
        ),
        (
            lambda: OpenWinding(time=1, axis="x", duration=math.nan),
            "fault open winding: duration = nan s: must be finite",
        ),
        (lambda: BusSag(time=1, share=1.5), "fault bus sag: share = 1.5: must be 0 to 1"),
        (lambda: CloggedNozzle(time=1, share=-0.1), "fault clogged nozzle: share = -0.1: must be 0 to 1"),
        (
            lambda: EncoderSlip(time=1, axis="x", counts=1.5),
            "fault encoder slip: counts = 1.5: must be a whole number",
        ),
        (
            lambda: EncoderGlitch(time=1, axis="x", counts=1, ticks=-1),
            "fault encoder glitch: ticks = -1: must be at least 0",
        ),
        (
            lambda: StuckAxis(time=1, axis="x", friction=-1),
            "fault stuck axis: friction = -1 N or N·m: must be at least 0 N or N·m",
        ),
        (
            lambda: SlippingAxis(time=1, axis="x", offset=math.inf),
            "fault slipping axis: offset = inf mm or deg: must be finite",
        ),
        (lambda: DrippingNozzle(time=1, flow=-1), "fault dripping nozzle: flow = -1 mm³/s: must be at least 0 mm³/s"),
        (lambda: AirBubble(time=1, volume=-1), "fault air bubble: volume = -1 mm³: must be at least 0 mm³"),
        (
            lambda: AirBubble(time=1, volume=1, recovery=0),
            "fault air bubble: recovery = 0 s: must be greater than 0 s",
        ),
        (
            lambda: LostPackets(time=1, ticks=1, drive="guess"),
            "fault lost packets: unknown drive 'guess': known: extrapolate, hold",
        ),
        (lambda: fault_of([3]), r"fault \[3\]: must be a table of its values"),
        (lambda: fault_of({"kind": "bus surge"}), r"unknown fault 'bus surge': did you mean bus sag\? known: .*"),
    ],
)
def test_values_out_of_bounds_are_refused(make, text):
    with pytest.raises(InputError, match=f"^{text}$"):
        make()


@given(st.integers(0, 10**6), st.integers(0, 10**4), st.sampled_from([0.00025, 0.001, 0.008]))
def test_a_fault_at_a_tick_begins_with_it_and_lasts_its_ticks(begin, count, period):
    fault = OpenWinding(time=begin * period, axis="x", duration=count * period)
    assert fault.acting(period) == (begin, begin + count)
    glitch = EncoderGlitch(time=begin * period, axis="x", counts=1, ticks=count)
    assert glitch.acting(period) == (begin, begin + count)
    between = dataclasses.replace(fault, time=(begin + 0.5) * period)
    assert between.acting(period) == (begin + 1, begin + 1 + count)


SERVO = FaultAxis("cell", "x", 0.01, 48.0, "position", delayed=False)
STEPPER = SERVO._replace(name="z", mode="stepper")
IDEAL = SERVO._replace(name="y", bus_voltage=math.inf)


@pytest.mark.parametrize(
    ("fault", "axis", "value"),
    [
        (OpenWinding(time=1, axis="x"), SERVO, 0.0),
        (OpenWinding(time=1, axis="z"), STEPPER, "axis z is a stepper in open loop"),
        (BusSag(time=1, share=0.25), SERVO, 12.0),
        (BusSag(time=1, share=0.25), STEPPER, None),
        (BusSag(time=1, share=0.25), IDEAL, None),
        (BusSag(time=1, share=0.25, axis="z"), STEPPER, "axis z is a stepper in open loop"),
        (BusSag(time=1, share=0.25, axis="y"), IDEAL, "axis y is an ideal torque source, it has no bus"),
        (EncoderGlitch(time=1, axis="x", counts=-5), SERVO, -0.05),
        (EncoderSlip(time=1, axis="x", counts=3), SERVO, 0.03),
        (EncoderSlip(time=1, axis="x", counts=3), SERVO._replace(resolution=0.0), "encoder"),
        (SlippingAxis(time=1, axis="x", offset=0.1), SERVO, 0.1),
        (StuckAxis(time=1, axis="x"), SERVO, 0.0),
    ],
)
def test_a_fault_acts_on_its_axis_and_among_all_on_those_that_can_have_it(fault, axis, value):
    axes = (SERVO, IDEAL, STEPPER)
    if isinstance(value, str):
        with pytest.raises(InputError, match=value):
            fault.tick_value(axis, axes)
    else:
        assert fault.tick_value(axis, axes) == (value if value is None else pytest.approx(value, rel=1e-15))


def test_a_fault_of_all_axes_that_none_can_have_is_refused():
    sag = BusSag(time=1, share=0.25)
    with pytest.raises(InputError, match="stepper in open loop"):
        sag.tick_value(STEPPER, (STEPPER,))
    with pytest.raises(InputError, match="ideal torque source"):
        sag.tick_value(IDEAL, (IDEAL, IDEAL))


@pytest.mark.parametrize("fault", list(TEXTS), ids=lambda fault: fault.kind)
def test_every_kind_begins_at_a_time_from_zero_on(fault):
    assert dataclasses.replace(fault, time=0.0).time == 0.0
    for time, bound in ((-1e-9, "must be at least 0 s"), (math.inf, "must be finite")):
        with pytest.raises(InputError, match=f"^fault {fault.kind}: time = .*: {bound}"):
            dataclasses.replace(fault, time=time)
