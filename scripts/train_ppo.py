"""Train an agent by PPO that tunes a servo as it runs, from gains ten times too low, and hold it against the tuner.

pip install -e ".[rl]"
python scripts/train_ppo.py [JOB] [--steps 80000] [--budget 300]
"""

import argparse
import time
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode, VectorEnv
from rich.console import Console
from rich.progress import Progress
from rich.table import Table
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from gantrysim import Job, Run, Servo
from gantrysim.metrics.analysis import Analysis, torque_ripple
from gantrysim.stability.margins import Plant
from gantrysim.tuning import TuningStudy

ID = "gantrysim/SpiralTuning-v0"
DETUNE = 10.0  # by which all gains of the job are divided
REACH = 100.0  # factor to either side by which the agent can change them
DETUNED = ("kp", "ki", "kd", "velocity_ff", "acceleration_ff")
ENVS, SEED = 64, 1
LEARNING = {"n_steps": 16, "batch_size": 256, "n_epochs": 10, "learning_rate": 1e-3, "gamma": 0.8, "gae_lambda": 0.9}
POLICY = {"net_arch": [64, 64], "log_std_init": -1.0}


class EpisodeBatch(VecEnv):
    """The native vector environment as stable-baselines3 wants it."""

    def __init__(self, envs: VectorEnv) -> None:
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> np.ndarray:
        return self.envs.reset(seed=SEED)[0]

    def step_async(self, actions: np.ndarray) -> None:
        self.actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        observations, reward, terminated, truncated, info = self.envs.step(self.actions)
        told: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(terminated | truncated):
            told[k] = {"terminal_observation": info["final_obs"][k], "TimeLimit.truncated": bool(truncated[k])}
        return observations, reward.astype(np.float32), terminated | truncated, told

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        return [getattr(self.envs, attr_name)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        return [getattr(self.envs, method_name)(*args, **kwargs)] * self.num_envs

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        return [False] * self.num_envs


def found(study: TuningStudy) -> Servo:
    """Return the servo that the tuner finds, in this process and without a report."""
    rows, rounds = [], study.rounds()
    cases = next(rounds)
    while True:
        rows += study.measure_together(cases)
        try:
            cases = rounds.send(rows[-len(cases) :])
        except StopIteration:
            return study.history(rows).best.servo


def learnt(steps: int) -> PPO:
    """Return the agent after so many decisions."""
    envs = gymnasium.make_vec(ID, num_envs=ENVS, autoreset_mode=AutoresetMode.SAME_STEP, **settings)
    torch.set_num_threads(1)  # its nets are small, and the cores are the environments'
    agent = PPO("MlpPolicy", EpisodeBatch(envs), policy_kwargs=POLICY, seed=SEED, device="cpu", **LEARNING)
    with Progress(console=console) as progress:
        task = progress.add_task("learn", total=steps)

        def tell(names: dict[str, Any], _: dict[str, Any]) -> bool:
            progress.update(task, completed=names["self"].num_timesteps)
            return True

        return agent.learn(steps, callback=tell)


def played(agent: PPO) -> tuple[Run, list[Servo]]:
    """Return the record of the agent's episode without exploration, and the servo of every decision."""
    env = gymnasium.make(ID, **settings)
    observation, _ = env.reset(seed=SEED)
    servos, over = [], False
    while not over:
        action = agent.predict(observation, deterministic=True)[0]
        kp, kd, velocity_ff, acceleration_ff = REACH ** action.astype(float)
        factors = {"kp": kp, "ki": kp, "kd": kd, "velocity_ff": velocity_ff, "acceleration_ff": acceleration_ff}
        servos.append(scaled(low.built_servo, factors))
        observation, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
    return env.unwrapped.run, servos


def scaled(servo: Servo, factors: dict[str, float]) -> Servo:
    gains = {name: [factor * gain for gain in getattr(servo, name)] for name, factor in factors.items()}
    return replace(servo, **gains)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("job", nargs="?", default="fanuc-spiral", help="a built-in job or a TOML file")
parser.add_argument("--steps", type=int, default=80_000, help="decisions that PPO learns from")
parser.add_argument("--budget", type=int, default=300, help="runs of the tuner")
arguments = parser.parse_args()
console = Console()

job = Job.load(arguments.job)
gains = {name: [gain / DETUNE for gain in getattr(job.built_servo, name)] for name in DETUNED}
low = job.changed({f"servo.{name}": values for name, values in gains.items()})
settings = {"job": job, "detune": DETUNE, "gain_range": REACH, "spread": None}

begin = time.perf_counter()
study = TuningStudy(low, budget=arguments.budget, robust=0, unseen=0, seed=SEED)
with console.status("tune"):
    tuned = found(study)
tuning, begin = time.perf_counter() - begin, time.perf_counter()
agent = learnt(arguments.steps)
learning = time.perf_counter() - begin

runs = {
    f"job's, divided by {DETUNE:g}": (low.run(), [low.built_servo], 0.0),
    "job's": (job.run(), [job.built_servo], 0.0),
    f"tuner's, {arguments.budget} runs": (study.run(tuned), [tuned], tuning),
    f"agent's, {agent.num_timesteps} decisions": (*played(agent), learning),
}

plant = Plant.of(job.built_machine, low.built_servo.period, low.built_servo.delay)
peak = [axis.peak_torque for axis in job.built_machine.axes]
table = Table(title=f"{job.name} on {job.built_machine.name}", title_justify="left")
table.add_column("gains", no_wrap=True)
for column in ("contour,\nrms [µm]", "\nmax [µm]", "torque\nripple", "least gain\nmargin", "found\nin [s]"):
    table.add_column(column, justify="right")
for name, (run, servos, seconds) in runs.items():
    contour = Analysis(run).values.contour
    ripple = max(torque_ripple(run) / peak)
    loops = [loop for servo in servos for loop in plant.margins(servo)]
    reserve = f"{min(loop.gain for loop in loops):.2f}" if all(loop.stable for loop in loops) else "unstable"
    figures = f"{1e3 * contour.rms:.2f}", f"{1e3 * contour.max:.1f}", f"{100 * ripple:.2f} %", reserve
    table.add_row(name, *figures, f"{seconds:.0f}" if seconds else "")
    if run.fault is not None:
        table.add_row(f"[red]{run.fault}")
console.print(table)
