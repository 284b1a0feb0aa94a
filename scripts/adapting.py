"""Does adapting pay? The best constant, a classical adaptive and a learnt policy on unseen episodes of a task.

pip install -e ".[rl]"
python scripts/adapting.py TASK constant|classical            # searched on training episodes
python scripts/adapting.py TASK ppo|sac [--seed 0] [--steps 50000]
python scripts/adapting.py table                              # writes the table of docs/learning.md

Every result is a row of docs/learning.csv: the mean of each value over 100 episodes that no search or training saw.
"""

import argparse
import csv
from pathlib import Path

import gymnasium
import numpy as np
from scipy.optimize import minimize

from gantrysim.env.baselines import CLASSICAL

DOCS = Path(__file__).parents[1] / "docs"
ROWS, PAGE = DOCS / "learning.csv", DOCS / "learning.md"
BEGIN, END = "<!-- table of scripts/adapting.py -->\n", "<!-- end of the table -->"
IDS = {
    "BeadWidth": "gantrysim/BeadWidth-v1",
    "SpeedOverride": "gantrysim/SpeedOverride-v1",
    "ServoTorque": "gantrysim/ServoTorque-v1",
    "SpiralTuning": "gantrysim/SpiralTuning-v0",
}
FIGURES = {
    "BeadWidth": ("episode_width_rms", 100, "width error, rms [%]"),
    "SpeedOverride": ("episode_time_ratio", 100, "time [% of nominal]"),
    "ServoTorque": ("episode_contour_rms", 1000, "contour error, rms [µm]"),
    "SpiralTuning": ("episode_contour_rms", 1000, "contour error, rms [µm]"),
}
COSTS = {"SpiralTuning": "mean cost"}  # elsewhere the share out of tolerance
CONSTANTS = {
    "BeadWidth": ("override", np.geomspace(0.6, 2.0, 25)),
    "SpeedOverride": ("override", np.geomspace(0.1, 2.0, 14)),
    "ServoTorque": ("level", np.linspace(0.6, 1.4, 9)),
}
DERIVED = {"ServoTorque": {"level": 0.0}}  # of others as the environment starts
GAINS = {
    "BeadWidth": np.geomspace(0.02, 0.3, 9),
    "SpeedOverride": np.geomspace(3.0, 12.0, 7),
    "ServoTorque": np.geomspace(0.1, 1.0, 5),
    "SpiralTuning": np.linspace(-0.2, 0.4, 7),
}
COLUMNS = ("task", "policy", "seed", "decisions", "return", "figure", "cost", "faults")
TRAINING, UNSEEN = range(40), range(10_000, 10_100)  # seeds of episodes


def evaluated(task, policy, seeds, **settings):
    """Return the means over episodes of return, without what progress pays, figure, cost and faults."""
    env = gymnasium.make(IDS[task], **settings)
    results = []
    for seed in seeds:
        observation, _ = env.reset(seed=seed)
        total, over = 0.0, False
        while not over:
            observation, reward, terminated, truncated, info = env.step(policy(observation))
            total, over = total + reward - info.get("reward_progress", 0.0), terminated or truncated
        figure, unit, _ = FIGURES[task]
        results.append((total, unit * info[figure], info["episode_cost"], info["fault"] is not None))
    env.close()
    return np.mean(results, axis=0)


def write(task, policy, seed, decisions, values):
    new = not ROWS.exists()
    with ROWS.open("a", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        writer.writerow([task, policy, seed, decisions, *(f"{value:.5g}" for value in values)])


def fixed(task, value=None):
    """Return a policy that does not adapt, and settings: the derived one, or one with a constant value."""
    env = gymnasium.make(IDS[task]).unwrapped
    still = np.zeros(env.action_space.shape, np.float32)
    if task == "SpiralTuning":
        return lambda _: still, {"start": (1.0,) * 4 if value is None else tuple(map(float, value))}
    return lambda _: still, DERIVED.get(task, {}) if value is None else {CONSTANTS[task][0]: float(value)}


def measured(task, seeds, value=None):
    policy, settings = fixed(task, value)
    return evaluated(task, policy, seeds, **settings)


def best_gains(task, sets=100, runs=120):
    """Return the factors on the four gains that lose least: random sets on some episodes, then Nelder-Mead on all."""
    settings = gymnasium.make(IDS[task]).unwrapped.settings
    most, random = settings.gain_range, np.random.default_rng(0)

    def factors(logs):
        return tuple(np.clip(np.exp(logs), 1 / most, most).tolist())

    def loss(logs, seeds=TRAINING):
        envs = gymnasium.make_vec(IDS[task], num_envs=len(seeds), threads=1, start=factors(logs))
        envs.reset(seed=list(seeds))
        total, running = 0.0, np.ones(len(seeds), bool)
        while running.any():
            _, reward, terminated, truncated, _ = envs.step(np.zeros(envs.action_space.shape, np.float32))
            total -= reward[running].sum()
            running &= ~(terminated | truncated)
        envs.close()
        return total / len(seeds)

    found = [np.log(settings.start), *random.uniform(-np.log(most), np.log(most), (sets, 4))]
    best = min(found, key=lambda logs: loss(logs, TRAINING[:10]))
    simplex = best + np.vstack([np.zeros(4), 0.2 * np.eye(4)])
    done = minimize(loss, best, method="Nelder-Mead", options={"maxfev": runs, "initial_simplex": simplex})
    return factors(done.x)


def constant(task):
    if task == "SpiralTuning":
        best = best_gains(task)
        text = "gains " + " ".join(f"{factor:.3g}" for factor in best)
    else:
        name, values = CONSTANTS[task]
        best = max(values, key=lambda value: measured(task, TRAINING, value)[0])
        text = f"{name} {best:.3g}"
    write(task, "derived", "", 0, measured(task, UNSEEN))
    write(task, f"constant, {text}", "", 0, measured(task, UNSEEN, best))


def classical(task):
    env = gymnasium.make(IDS[task]).unwrapped
    best = max(GAINS[task], key=lambda gain: evaluated(task, CLASSICAL[task](env, gain), TRAINING)[0])
    write(task, f"classical, parameter {best:.3g}", "", 0, evaluated(task, CLASSICAL[task](env, best), UNSEEN))


def learnt(task, name, seed, steps):
    import stable_baselines3
    import torch

    torch.set_num_threads(1)
    algorithm = getattr(stable_baselines3, name.upper())
    agent = algorithm("MlpPolicy", IDS[task], seed=seed, device="cpu")
    agent.learn(steps)
    values = evaluated(task, lambda observation: agent.predict(observation, deterministic=True)[0], UNSEEN)
    write(task, name.upper(), seed, agent.num_timesteps, values)


def with_table(page, rows):
    """Return the page with the table of rows."""
    lines = []
    for task in dict.fromkeys(row["task"] for row in rows):
        own = sorted((row for row in rows if row["task"] == task), key=lambda row: (row["policy"], row["seed"]))
        base = -max(float(row["return"]) for row in own if row["policy"].startswith(("constant", "derived")))
        heads = [
            "seed",
            "decisions",
            "return",
            "loss saved",
            FIGURES[task][2],
            COSTS.get(task, "out of tolerance"),
            "faults",
        ]
        lines += [f"| {IDS[task].removeprefix('gantrysim/')} | {' | '.join(heads)} |", "|---" * (1 + len(heads)) + "|"]
        for row in own:
            saved, outside = 1 + float(row["return"]) / base, float(row["cost"])
            cells = [
                row["policy"],
                row["seed"],
                row["decisions"],
                f"{float(row['return']):.4g}",
                f"{100 * saved:.0f} %",
            ]
            cells += [f"{float(row['figure']):.4g}", f"{100 * outside:.1f} %", f"{float(row['faults']):g}"]
            lines.append(f"| {' | '.join(cells)} |")
        lines.append("")
    before, rest = page.split(BEGIN)
    return before + BEGIN + "\n" + "\n".join(lines) + "\n" + END + rest.split(END)[1]


def table():
    with ROWS.open(newline="") as file:
        PAGE.write_text(with_table(PAGE.read_text(), list(csv.DictReader(file))))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=[*FIGURES, "table"])
    parser.add_argument("policy", nargs="?", choices=["constant", "classical", "ppo", "sac"])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=50_000)
    arguments = parser.parse_args()
    if arguments.task == "table":
        table()
    elif arguments.policy in ("constant", "classical"):
        {"constant": constant, "classical": classical}[arguments.policy](arguments.task)
    else:
        learnt(arguments.task, arguments.policy, arguments.seed, arguments.steps)
