"""The sentences of a comparison's page have the numbers of the comparison, at their limits too."""

from types import SimpleNamespace

import pytest

from gantrysim.compare.over_time import AxisDifference
from gantrysim.compare.page import _beside_wrong, _explained_share, over_time_words, share_text, thousandths
from gantrysim.metrics.error_quantities import DESCRIPTIONS


def compared(measured, simulated, difference, share, wrong=None, noise=False):
    explained = SimpleNamespace(measured=measured, simulated=simulated, difference=difference, share=share)
    parts = {"servo": DESCRIPTIONS["servo"], "structure": "encoder to nozzle"}
    return SimpleNamespace(explained=explained, explained_without_friction=wrong, parts=parts, is_all_noise=noise)


LINKS = "servo + structure (encoder to nozzle)"


@pytest.mark.parametrize(
    ("sizes", "text"),
    [
        ((0.04, 0.03, 0.01, 0.9375), f"Of {LINKS}, 40.0 µm rms measured, the simulation explains 93.7 % in mean "
         "square; 10.0 µm rms is left."),
        ((0.04, 0.03, 0.05, -0.5625), f"Of {LINKS}, 40.0 µm rms measured, the simulation explains none (−56.3 %): "
         "their difference is 50.0 µm rms."),
        ((0.0, 0.03, 0.03, None), f"Of {LINKS} there is no measured error; the simulated one is 30.0 µm rms."),
        ((0.0, 0.0, 0.0, None), f"Of {LINKS} there is no error across the path, neither measured nor simulated: it "
         "shows nothing there."),
    ],
)  # fmt: skip
def test_what_the_simulation_explains_is_said_of_the_links_compared(sizes, text):
    assert _explained_share(compared(*sizes)) == text


def test_noise_alone_is_no_share():
    text = f"Of {LINKS}, 40.0 µm rms measured, no difference is left: all is measured, and all differences are within"
    assert _explained_share(compared(0.04, 0.03, 0.01, 0.9, noise=True)) == f"{text} the noise."


@pytest.mark.parametrize(
    ("difference", "end"),
    [
        (0.001, ", and 20.0 µm rms would be left."),
        (0.02, ": these links do not tell the two apart."),
        (0.03, ": these links do not tell the two apart."),
    ],
)
def test_a_machine_without_friction_stands_beside(difference, end):
    wrong = SimpleNamespace(share=0.75, difference=0.02)
    (text,) = _beside_wrong(compared(0.04, 0.03, difference, 0.9, wrong))
    assert text == f"Without friction the same machine would explain 75.0 %{end}"
    assert _beside_wrong(compared(0.04, 0.03, difference, 0.9)) == []
    assert _beside_wrong(compared(0.04, 0.03, difference, 0.9, SimpleNamespace(share=None, difference=0.0))) == []


def sized(rms):
    return SimpleNamespace(rms=rms)


def test_what_is_measured_over_time_has_its_axes_and_what_is_not_is_said():
    rows = [
        AxisDifference("x", "following error", "µm", sized(0.05), sized(0.04), sized(0.01), sized(0.03), 0.0),
        AxisDifference("y", "following error", "µm", sized(0.02), sized(0.02), sized(0.03), sized(0.03), 0.0),
        AxisDifference("z", "following error", "µm", sized(1e-7), sized(0.002), sized(0.002), None, 0.0),
    ]
    assert over_time_words(SimpleNamespace(over_time=rows)) == [
        "Following error over time: x 50 µm rms measured, 40 simulated, difference 10 (without friction 30); y 20 µm "
        "rms measured, 20 simulated, difference 30 (without friction 30); z 0 µm rms measured, 2 simulated, "
        "difference 2.",
        "It does not tell the machine from one without friction for y.",
        "Torque over time is not measured, so not compared.",
    ]


def test_a_size_of_a_nanometre_is_written_as_none():
    assert [thousandths(size) for size in (1e-6, 1.5e-6, 0.0123456, 1.0)] == ["0", "0.0015", "12.3", "1e+03"]


def test_a_share_is_rounded_down():
    assert [share_text(share) for share in (0.9999, 1.0, 0.5006, -0.00001)] == [
        "99.9 %",
        "100.0 %",
        "50.0 %",
        "−0.1 %",
    ]
