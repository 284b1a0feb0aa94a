"""Train an agent by PPO to tune a servo while it runs, from gains ten times too low, and compare it with the tuner.

pip install -e ".[rl]"
python scripts/train_ppo.py [JOB] [--steps 80000] [--budget 300]
"""

import argparse
import time
from contextlib import suppress

import gymnasium
import torch
from rich.console import Console
from rich.table import Table
from stable_baselines3 import PPO

from gantrysim import Job
from gantrysim.env.episodes import SCALED, gain_factors
from gantrysim.env.sb3 import SB3VecEnv
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.servo.stability.margins import Plant
from gantrysim.study.tuning import TuningStudy

ID = "gantrysim/GainBandit-v0"
INTERVAL = 0.1  # between decisions [s]
DETUNE = 10.0  # divisor of the job's gains
GAIN_RANGE = 100.0  # largest factor by which the agent raises or lowers a gain
ENVS, SEED = 64, 1
LEARNING = {"n_steps": 16, "batch_size": 256, "n_epochs": 10, "learning_rate": 1e-3, "gamma": 0.8, "gae_lambda": 0.9}
POLICY = {"net_arch": [64, 64], "log_std_init": -1.0}

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("job", nargs="?", default="fanuc-spiral", help="a built-in job or a TOML file")
parser.add_argument("--steps", type=int, default=80_000, help="number of decisions for training")
parser.add_argument("--budget", type=int, default=300, help="number of runs of the tuner")
arguments = parser.parse_args()


job = Job.load(arguments.job)
lower = {f"servo.{name}": [gain / DETUNE for gain in job.built_servo.per_axis(name)] for name in SCALED}
low = job.changed({**lower, "simulation.allow_unstable": True})  # with an integral term only friction holds it
settings = {"job": job, "detune": DETUNE, "gain_range": GAIN_RANGE, "spread": None, "decision_interval": INTERVAL}
runs = {f"job, gains / {DETUNE:g}": (low.run(), [low.built_servo], ""), "job": (job.run(), [job.built_servo], "")}
console = Console()

begin = time.perf_counter()
with console.status("tuning"), suppress(StopIteration):
    study = TuningStudy(low, budget=arguments.budget, robust=0, unseen=0, seed=SEED)
    rows, rounds = [], study.rounds()
    cases = next(rounds)
    while True:
        rows += study.measure_together(cases)
        cases = rounds.send(rows[-len(cases) :])
tuned = study.history(rows).best.servo
runs[f"tuner, {arguments.budget} runs"] = study.run(tuned), [tuned], f"{time.perf_counter() - begin:.0f}"

begin = time.perf_counter()
with console.status("training"):
    torch.set_num_threads(1)  # the networks are small, and the environments use all cores
    agent = PPO("MlpPolicy", SB3VecEnv(ID, ENVS, **settings), policy_kwargs=POLICY, seed=SEED, device="cpu", **LEARNING)
    agent.learn(arguments.steps)
learning = f"{time.perf_counter() - begin:.0f}"

env = gymnasium.make(ID, **settings).unwrapped
observation, _ = env.reset(seed=SEED)
servos, over = [], False
while not over:  # an episode without exploration
    action = agent.predict(observation, deterministic=True)[0]
    factors = gain_factors(action, GAIN_RANGE)
    gains = {name: tuple(factor * gain for gain in low.built_servo.per_axis(name)) for name, factor in factors.items()}
    servos.append(low.built_servo.with_values(**gains))
    observation, _, terminated, truncated, _ = env.step(action)
    over = terminated or truncated
runs[f"agent, {agent.num_timesteps} decisions"] = env.run, servos, learning

plant = Plant.of(job.built_machine, low.built_servo.period, low.built_servo.delay)
table = Table(title=f"{job.name} on {job.built_machine.name}", title_justify="left")
table.add_column("gains", no_wrap=True)
for column in (
    "contour,\nrms [µm]",
    "\nmax [µm]",
    "torque\nripple",
    "gain\nmargin",
    "phase\n[deg]",
    "peak\n|S|",
    "time\n[s]",
):
    table.add_column(column, justify="right")
for name, (run, servos, seconds) in runs.items():
    contour = Analysis(run).values.contour
    ripple = max(torque_ripple(run) / [axis.peak_torque for axis in job.built_machine.axes])
    margins = [margin for servo in servos for margin in plant.margins(servo)]
    gain, phase = (min(getattr(margin, kind) for margin in margins) for kind in ("gain", "phase"))
    peak = max(margin.sensitivity for margin in margins)
    robust = [f"{gain:.2f}", f"{phase:.0f}", f"{peak:.2f}"]
    robust = robust if all(margin.stable for margin in margins) else ["unstable", "", ""]
    errors = [f"{1e3 * contour.rms:.2f}", f"{1e3 * contour.max:.1f}"]
    table.add_row(name, *errors, f"{100 * ripple:.2f} %", *robust, seconds)
    if run.fault is not None:
        table.add_row(f"[red]{run.fault}")
console.print(table)
