"""Train an agent to hold the bead's width while the glue thickens. Needs: pip install "gantrysim[rl]"."""

import gymnasium
import numpy as np
from stable_baselines3 import PPO

from gantrysim.env.sb3 import SB3VecEnv

TASK = "gantrysim/BeadWidth-v1"
PLACES = 16  # episodes side by side, advanced by one native call
DECISIONS = 16_384
EPISODES = 20  # of the comparison, with seeds that the training does not use

# 1. Train. Observation: a camera's width behind the nozzle, and what comes; action: a change of the pressure.
environments = SB3VecEnv(TASK, PLACES)
agent = PPO("MlpPolicy", environments, n_steps=64, batch_size=256, seed=0, device="cpu")
agent.learn(DECISIONS)


def mean_return(policy):
    """Return the mean return of a policy over the episodes of the comparison."""
    environment = gymnasium.make(TASK)
    returns = np.zeros(EPISODES)
    for episode in range(EPISODES):
        observation, _ = environment.reset(seed=1000 + episode)
        done = False
        while not done:
            observation, reward, terminated, truncated, _ = environment.step(policy(observation))
            returns[episode] += reward
            done = terminated or truncated
    return returns.mean()


# 2. Compare with the pressure left alone. A return of 0 would be a bead of exactly the wanted width.
print(f"pressure left alone: mean return {mean_return(lambda _: np.zeros(1, np.float32)):.2f}")
print(f"agent:               mean return {mean_return(lambda seen: agent.predict(seen, deterministic=True)[0]):.2f}")

# 3. Keep it.
agent.save("bead-width-agent")
