"""Registration of the environments with Gymnasium, and the packages that an import loads, in fresh interpreters."""

import subprocess
import sys

import pytest

from support.soaked import suite_runs

MAKE = "env = gymnasium.make('gantrysim/SpiralTuning-v0')"
MAKE_VECTOR = "env = gymnasium.make_vec('gantrysim/SpiralTuning-v0', num_envs=2, {})"
TUNED = 25  # entries of the observation of SpiralTuning-v0
HEAVY = ("gymnasium", "pydantic", "matplotlib", "typer")


def printed(*lines):
    """Run code in a fresh interpreter in which warnings are errors; return what it prints."""
    code = "\n".join(["if __name__ == '__main__':", *(f"    {line}" for line in lines)])
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


SHAPE = "print(env.reset(seed=1)[0].shape[-1]); env.close()"


@pytest.mark.parametrize(
    ("lines", "sizes"),
    suite_runs(
        [
            (
                (
                    "import gantrysim.env",
                    "import gymnasium",
                    MAKE,
                    SHAPE,
                    MAKE.replace("SpiralTuning", "GainBandit"),
                    SHAPE,
                ),
                (TUNED, 22),
            ),
            (
                (
                    "import gymnasium",
                    "import gantrysim.env",
                    MAKE_VECTOR.format("threads=1"),
                    SHAPE,
                    MAKE_VECTOR.format("vectorization_mode='sync'"),
                    SHAPE,
                    MAKE_VECTOR.format("vectorization_mode='async'"),
                    SHAPE,
                ),
                (TUNED,) * 3,
            ),
            (("import gymnasium", MAKE.replace("gantrysim/", "gantrysim.env:gantrysim/"), SHAPE), (TUNED,)),
        ],
        0,
    ),
    ids=["gantrysim.env first, bandit", "gymnasium first, native, sync and async vectors", "module in the id"],
)
def test_an_environment_is_made_by_its_id(lines, sizes):
    assert [int(line) for line in printed(*lines).split()] == [*sizes]


@pytest.mark.parametrize(
    ("names", "unloaded"),
    [
        (["__version__"], (*HEAVY, "mujoco", "gantrysim.env")),
        (["Machine", "Servo", "simulate", "Budget", "Run"], (*HEAVY, "gantrysim.env")),
    ],
)
def test_a_public_name_loads_only_what_it_needs(names, unloaded):
    found = f"print([name for name in {unloaded} if name in sys.modules])"
    assert printed("import sys, gantrysim", *(f"gantrysim.{name}" for name in names), found) == "[]\n"
