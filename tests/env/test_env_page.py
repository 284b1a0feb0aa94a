"""The table of docs/learning.md is what its rows give, and a task is registered only if adapting pays."""

import csv
import re
import runpy
import sys
from pathlib import Path

import gymnasium
import pytest

from gantrysim.env import registry

ROOT = Path(__file__).parents[2]
TASKS = {"BeadWidth": "v1", "SpeedOverride": "v1", "ServoTorque": "v1", "SpiralTuning": "v0"}


@pytest.fixture(scope="module")
def rows():
    with (ROOT / "docs/learning.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_the_page_shows_the_rows(rows):
    page = (ROOT / "docs/learning.md").read_text()
    assert runpy.run_path(str(ROOT / "scripts/adapting.py"))["with_table"](page, rows) == page
    for row in rows:
        assert f"| {row['policy']} | {row['seed']} | {row['decisions']} | {float(row['return']):.4g} |" in page


def test_the_tables_of_the_environments_are_up_to_date():
    page = runpy.run_path(str(ROOT / "scripts/environments_page.py"))["page"]
    assert page() == (ROOT / "docs/environments.md").read_text(), "run python scripts/environments_page.py"


def test_the_tables_have_a_row_for_each_entry_of_the_spaces():
    page = (ROOT / "docs/environments.md").read_text()
    sections = dict(re.findall(r"^## (\S+-v\d)\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL))
    assert set(sections) == set(registry.TASKS)
    for name, text in sections.items():
        env = gymnasium.make(f"gantrysim/{name}").unwrapped
        action, observation = re.findall(r"(?:^\| \d+ \|.*\n)+", text, re.MULTILINE)
        for table, space, names in (
            (action, env.action_space, env.action_names),
            (observation, env.observation_space, env.observation_names),
        ):
            rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
            assert [row[1] for row in rows] == [f"`{entry}`" for entry in names]
            assert [float(row[4]) for row in rows] == space.low.tolist()
            assert [float(row[5]) for row in rows] == space.high.tolist()


@pytest.mark.parametrize("task", TASKS)
def test_a_registered_task_has_something_adaptive_that_loses_a_fifth_less_than_the_best_constant(rows, task):
    assert f"gantrysim/{task}-{TASKS[task]}" in gymnasium.registry
    losses = {(row["policy"], row["seed"]): -float(row["return"]) for row in rows if row["task"] == task}
    fixed = [loss for (policy, _), loss in losses.items() if policy.startswith(("constant", "derived"))]
    classical = [loss for (policy, _), loss in losses.items() if policy.startswith("classical")]
    assert len(fixed) == 2
    assert min(classical) < 0.8 * min(fixed)


def test_the_width_learnt_with_the_librarys_defaults_beats_the_derived_override(rows):
    own = [row for row in rows if row["task"] == "BeadWidth"]
    (derived,) = (float(row["return"]) for row in own if row["policy"] == "derived")
    learnt = [row for row in own if row["policy"] in ("PPO", "SAC")]
    assert len(learnt) == 6  # three seeds of each
    for row in learnt:
        assert float(row["return"]) > derived
        assert int(row["decisions"]) < 52_000  # 50 000, in whole rollouts


def test_the_speed_learnt_with_the_librarys_defaults_beats_the_best_constant(rows):
    own = [row for row in rows if row["task"] == "SpeedOverride"]
    fixed = [float(row["return"]) for row in own if row["policy"].startswith(("constant", "derived"))]
    learnt = [row for row in own if row["policy"] == "PPO"]
    assert len(learnt) == 3
    for row in learnt:
        assert float(row["return"]) > max(fixed)
        assert int(row["decisions"]) < 52_000


def test_no_choice_in_hindsight_is_worse_than_a_narrower_one(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gains_bound.py", "--sets", "4", "--episodes", "2"])
    runpy.run_path(str(ROOT / "scripts/gains_bound.py"))
    losses = [float(found) for found in re.findall(r"loss ([\d.]+)", capsys.readouterr().out)]
    assert len(losses) == 4
    assert losses == sorted(losses, reverse=True)
    assert losses[-1] > 0
