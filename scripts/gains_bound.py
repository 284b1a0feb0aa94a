"""What could adapting kp, kd and the feed-forward gains save on a machine that drifts? A bound, before any training.

python scripts/gains_bound.py [--sets 150] [--episodes 24]

Random constant gains that keep |S| <= 2 run the same episodes: spirals on machines of random payload, friction,
stiffness and motors, whose friction changes on the way. Four losses follow: with the derived gains, with the best of
the constant gains, with the best of them in each episode, and with the best of them in each interval of 20 ms, as if
a change of gains had no transient. The last two choose in hindsight, among these sets alone.
"""

import argparse

import numpy as np

from gantrysim.env.friction import ChangingFriction
from gantrysim.env.gain_bandit import GainBanditSettings, GainBatch

SPIRALS = {"diameter": (36.0, 60.0), "turns": (1, 2), "thickness": (6.0, 9.0), "speed": (40.0, 100.0)}
SETTINGS = GainBanditSettings(**SPIRALS, acceleration=2000.0, decision_interval=0.02, tolerance=0.005, gain_range=3.0)
WORST = 10.0  # tolerances: the largest loss of an interval

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--sets", type=int, default=150, help="number of sets of gains")
parser.add_argument("--episodes", type=int, default=24, help="number of episodes")
arguments = parser.parse_args()

random = np.random.default_rng(0)
batch = GainBatch(SETTINGS, arguments.episodes, 1, False)
batch.source = ChangingFriction(SETTINGS)
sets = [np.zeros(4)]  # the first is the derived one
while len(sets) < arguments.sets:
    action = random.uniform(-1, 1, 4)
    if batch.sensitivity.cost(action[None, :, None]) <= 0:
        sets.append(action)

losses = []  # by set, episode and interval; 0 once an episode is over
for action in sets:
    batch.begin({place: np.random.default_rng(place) for place in range(arguments.episodes)})
    running, rows = np.ones(arguments.episodes, bool), []
    while running.any():
        outcome = batch.advance(np.tile(action, (arguments.episodes, 1)), running)
        loss = np.minimum(outcome.info["contour_rms"] / SETTINGS.tolerance, WORST) / WORST
        rows.append(np.where(running, loss + WORST * outcome.terminated, 0.0))
        running &= ~(outcome.terminated | outcome.truncated)
    losses.append(np.array(rows).T)
longest = max(one.shape[1] for one in losses)
loss = np.array([np.pad(one, ((0, 0), (0, longest - one.shape[1]))) for one in losses])

whole = loss.sum(axis=2)
best = int(whole.mean(axis=1).argmin())
constant = whole[best].mean()
found = {
    "derived": whole[0].mean(),
    f"best constant, action {np.round(sets[best], 2).tolist()}": constant,
    "best of each episode": whole.min(axis=0).mean(),
    "best of each interval": loss.min(axis=0).sum(axis=1).mean(),
}
for name, value in found.items():
    print(f"{name}: loss {value:.4g}, {100 * (1 - value / constant):.0f} % less than the best constant")
