"""Pictures of running episodes, with bead and work piece."""

import math
import sys
from functools import partial

import gymnasium
import imageio.v2 as imageio
import numpy as np
import pytest

from gantrysim import GantryError

from support.episodes import stepwise

SHORT = {"diameter": 48.0, "turns": 1, "thickness": 8.0, "speed": 100.0}
DASHES = """
name = "dashes"

[program]
controller = "softmc.Program"
program = '''
{moves}
'''

[dispenser]
area = 1.0
"""


def test_pictures_show_the_machine_and_the_bead_laid_so_far():
    env = stepwise(**SHORT, render_mode="rgb_array", size=(640, 480))
    env.reset(seed=1)
    first = env.render()
    glue = []
    for _ in range(3):
        for _ in range(4):
            env.step(np.zeros(4))
        picture = env.render()
        assert picture.shape == (480, 640, 3)
        assert picture.dtype == np.uint8
        red, green, blue = picture.astype(int).transpose(2, 0, 1)
        glue.append(int(((red > 130) & (red > 1.3 * green) & (green > 1.3 * blue)).sum()))
    assert glue == sorted(glue)
    assert glue[-1] > glue[0] + 50  # pixels, besides those of the syringe
    assert not np.array_equal(first, picture)
    env.reset(seed=1)
    assert np.array_equal(env.render(), first)  # one renderer for all episodes, without the last one's bead
    env.close()
    assert stepwise(**SHORT).render() is None


@pytest.mark.soak
def test_pictures_show_the_running_episode():
    pictures = []
    one, other = (stepwise(diameter=(60.0, 140.0), render_mode="rgb_array") for _ in range(2))
    for env, seed in ((one, 1), (one, 2), (other, 2)):
        env.reset(seed=seed)
        for _ in range(8):
            env.step(np.zeros(4))
        pictures.append(env.render())
    assert not np.array_equal(pictures[0], pictures[1])
    # the rings of the first episode's bead stand elsewhere than the second's own
    assert (np.abs(pictures[1].astype(int) - pictures[2]).max(axis=2) > 8).mean() < 1e-4
    one.close(), other.close()


def test_all_beads_of_an_interrupted_path_are_drawn(tmp_path):
    moves = (f"Move G1 {{{10 * k}, 0}} Dispense={k % 2}" for k in range(1, 14))
    (tmp_path / "dashes.toml").write_text(DASHES.format(moves="\n".join(moves)))
    env = stepwise(job=str(tmp_path / "dashes.toml"), render_mode="rgb_array", size=(320, 240))
    env.reset(seed=0)
    step = partial(env.step, np.zeros(env.action_space.shape, np.float32))
    step(), env.render()
    while not any(step()[2:4]):
        pass
    env.render()
    mesh = env._frames._renderer.scene.sweep.mesh(len(env.run.time) - 1)
    drawn = 1e3 * np.unique(mesh.vertices[:, 0])
    gaps = np.flatnonzero(np.diff(drawn) > 4)  # between the dashes
    assert gaps.size == 6
    assert drawn[gaps] == pytest.approx(np.arange(10, 130, 20), abs=3)
    env.close()


def test_the_first_picture_of_a_climbing_job_has_the_whole_work_piece():
    env = stepwise(job="an225-3d", render_mode="rgb_array", size=(320, 240))
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.zeros(env.action_space.shape, np.float32))
    env.render()
    model = env._frames._renderer.model
    piece = model.mesh("gantrysim work piece").id
    first, count = model.mesh_vertadr[piece], model.mesh_vertnum[piece]
    vertices = model.mesh_vert[first : first + count]
    assert np.ptp(vertices[:, 2]) > 0.9e-3 * env.run.requested.table[1][:, 2].max()
    env.close()


@pytest.mark.first
def test_an_episode_is_filmed_without_moviepy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "moviepy", None)
    env = gymnasium.make("gantrysim/SpeedOverride-v1", diameter=36.0, turns=1, thickness=9.0).unwrapped
    env.reset(seed=1)
    with pytest.raises(GantryError, match="this episode has not been stepped yet"):
        env.film(tmp_path / "none.mp4")
    for _ in range(5):
        env.step(np.zeros(1, np.float32))
    count = env.film(tmp_path / "episode.mp4", fps=50.0, speed=1.0, size=(420, 200))
    with imageio.get_reader(tmp_path / "episode.mp4") as reader:
        frames = [np.asarray(frame) for frame in reader]
    # a picture for each begun 0.02 s of the 0.1 s, and the last instant
    assert len(frames) == count >= math.ceil(50.0 * env.run.time[-1])
    assert frames[0].shape == (200, 420, 3)
    assert not np.array_equal(frames[0], frames[-1])
    assert not (tmp_path / "none.mp4").exists()
