"""What jobs that levers make of one job share with one another."""

from gantrysim.remedy.bench import Family

from support.remedies import rubbing, spiral_job


def test_a_servo_that_the_base_does_not_have_is_derived_once():
    base = spiral_job()
    family = Family(base)
    first = family.member(base.changed({"servo.frequency": 20.0}))
    margins = first.margins
    later = family.member(base.changed({"servo.frequency": 20.0, "program.speed": 75.0}))
    assert later.built_servo is first.built_servo
    assert later.margins is margins
    assert later.controller.programmed_speed == 75.0
    alone = spiral_job().changed({"servo.frequency": 20.0})
    assert alone.margins == margins
    assert alone.built_servo == later.built_servo


def test_another_servo_or_machine_is_not_shared():
    base = rubbing()
    family = Family(base)
    variants = ({"servo.frequency": 20.0}, {"machine": "xyz"}, {"geometry.accuracy": "C7"})
    members = [family.member(base.changed(changes)) for changes in variants]
    for changes, member in zip(variants, members, strict=True):
        alone = rubbing().changed(changes)
        assert member.built_servo == alone.built_servo
        assert (member.built_machine.geometry is None) == (alone.built_machine.geometry is None)
        again = family.member(base.changed({**changes, "program.acceleration": 900.0}))
        assert again.built_servo is member.built_servo
    assert len({id(member.built_servo) for member in (base, *members)}) == 4
