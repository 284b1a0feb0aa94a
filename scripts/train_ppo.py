"""Train an agent by PPO to tune a servo while it runs, from gains ten times too low, and compare it with the tuner.

pip install -e ".[rl]"
python scripts/train_ppo.py [JOB] [--steps 80000] [--budget 300]
"""

import argparse
import time
from contextlib import suppress
from dataclasses import replace

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from rich.console import Console
from rich.table import Table
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from gantrysim import Job
from gantrysim.env.episodes import SCALED, gain_factors
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.stability.margins import Plant
from gantrysim.tuning import TuningStudy

ID = "gantrysim/SpiralTuning-v0"
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


class NativeVecEnv(VecEnv):
    """Adapter of the native vector environment to stable-baselines3."""

    def __init__(self, envs):
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self):
        return self.envs.reset(seed=SEED)[0]

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        observations, reward, terminated, truncated, info = self.envs.step(self.actions)
        infos = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(terminated | truncated):
            infos[k] = {"terminal_observation": info["final_obs"][k], "TimeLimit.truncated": bool(truncated[k])}
        return observations, reward.astype(np.float32), terminated | truncated, infos

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.envs, attr_name)] * self.num_envs

    def close(self):
        self.envs.close()

    set_attr = env_method = env_is_wrapped = None  # abstract in VecEnv, but not used by PPO


job = Job.load(arguments.job)
lower = {f"servo.{name}": [gain / DETUNE for gain in getattr(job.built_servo, name)] for name in SCALED}
low = job.changed({**lower, "simulation.allow_unstable": True})  # with an integral term only friction holds it
settings = {"job": job, "detune": DETUNE, "gain_range": GAIN_RANGE, "spread": None}
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
    envs = gymnasium.make_vec(ID, num_envs=ENVS, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    agent = PPO("MlpPolicy", NativeVecEnv(envs), policy_kwargs=POLICY, seed=SEED, device="cpu", **LEARNING)
    agent.learn(arguments.steps)
learning = f"{time.perf_counter() - begin:.0f}"

env = gymnasium.make(ID, **settings).unwrapped
observation, _ = env.reset(seed=SEED)
servos, over = [], False
while not over:  # an episode without exploration
    action = agent.predict(observation, deterministic=True)[0]
    factors = gain_factors(action, GAIN_RANGE)
    gains = {name: tuple(factor * gain for gain in getattr(low.built_servo, name)) for name, factor in factors.items()}
    servos.append(replace(low.built_servo, **gains))
    observation, _, terminated, truncated, _ = env.step(action)
    over = terminated or truncated
runs[f"agent, {agent.num_timesteps} decisions"] = env.run, servos, learning

plant = Plant.of(job.built_machine, low.built_servo.period, low.built_servo.delay)
table = Table(title=f"{job.name} on {job.built_machine.name}", title_justify="left")
table.add_column("gains", no_wrap=True)
for column in ("contour,\nrms [µm]", "\nmax [µm]", "torque\nripple", "least gain\nmargin", "time\n[s]"):
    table.add_column(column, justify="right")
for name, (run, servos, seconds) in runs.items():
    contour = Analysis(run).values.contour
    ripple = max(torque_ripple(run) / [axis.peak_torque for axis in job.built_machine.axes])
    margins = [margin for servo in servos for margin in plant.margins(servo)]
    least = f"{min(margin.gain for margin in margins):.2f}" if all(margin.stable for margin in margins) else "unstable"
    table.add_row(name, f"{1e3 * contour.rms:.2f}", f"{1e3 * contour.max:.1f}", f"{100 * ripple:.2f} %", least, seconds)
    if run.fault is not None:
        table.add_row(f"[red]{run.fault}")
console.print(table)
