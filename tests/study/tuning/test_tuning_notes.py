"""The notes of a search name the limits that its gains have reached, and the largest link that remains."""

from types import SimpleNamespace

import pytest

from gantrysim.study.tuning import report


@pytest.mark.parametrize(
    ("sensitivity", "ripple", "words"),
    # of a peak of 2, and a ripple of 10 % of the peak torque
    [
        (1.99, 0.05, "stability margin"),
        (2.0, 0.05, "stability margin"),
        (1.9, 0.1, "torque ripple"),
        (1.97, 0.099, "stability margin and torque ripple"),
        (1.9, 0.05, None),
        (3.0, 0.15, None),
    ],
)
def test_limits_are_reached_from_a_fiftieth_below_them_and_not_beyond(monkeypatch, sensitivity, ripple, words):
    parts = {"program": SimpleNamespace(share=0.6), "servo": SimpleNamespace(share=0.4)}
    budget = SimpleNamespace(values=SimpleNamespace(parts=parts))
    monkeypatch.setattr(report, "_budgets", lambda *_: {"tuned": budget})
    best = SimpleNamespace(servo=None, ripple=ripple)
    ended = next(iter(report._REASONS_OF_END))
    history = SimpleNamespace(best=best, runs=40, candidates=[1, 2, 3], rounds=7, skipped=5, ended=ended)
    margins = [SimpleNamespace(sensitivity=1.0), SimpleNamespace(sensitivity=sensitivity)]
    study = SimpleNamespace(
        history=lambda _: history,
        stability=SimpleNamespace(worst=lambda _: margins, peak=2.0),
        ripple=10.0,
        difference_note=lambda _: "",
        per_axis=False,
        space=SimpleNamespace(gains=("kp", "kd")),
        seed=3,
        budget=60,
    )
    notes = report.notes(study, [])
    assert [note for note in notes if note.startswith("Limiting")] == (
        [f"Limiting constraint: {words}."] if words else []
    )
    assert notes[-3] == (
        "Largest part of the tuned contour error: program, 60 % of its mean square. Tuning cannot fix program errors; "
        "the metric servo_rms is the servo's error alone."
    )
    assert notes[-2].startswith(
        "Nelder-Mead over kp, kd, one factor for all axes, seed 3: 40 runs (budget 60) of 3 candidates in 7 rounds; "
        "skipped, as no frequency met the margin: 5; ended: "
    )
