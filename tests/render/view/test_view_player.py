"""The player, with a window that only records what it shows."""

import numpy as np
import pytest

from gantrysim import simulate
from gantrysim.base.errors import InputError
from gantrysim.engine.simulation import Simulation
from gantrysim.metrics.analysis import Analysis
from gantrysim.paths.arcs import ArcChain
from gantrysim.record.setpoints import Setpoints
from gantrysim.render.scene import Scene
from gantrysim.render.view.player import Player, WallClock
from gantrysim.render.view.source import Bodies, Live, Playback, Replay
from gantrysim.render.view.window import WindowClosedError

from support.runs import PERIOD, plain

SPACE, RIGHT, LEFT, DOWN, UP, BACKSPACE, HOME = 32, 262, 263, 264, 265, 259, 268
FRAME = 0.0625  # [s], exact in binary
EVER = 1e9  # [s]

# a circle of 20 mm, at full speed from its first tick
CIRCLE = Setpoints.along(ArcChain((20.0, 0.0), 0.5 * np.pi, [0.05], [42 * np.pi]), 100.0, PERIOD)


class Paper:
    """A window: keys to come, and forces, by picture; what is shown is taken down."""

    def __init__(self, scene, pictures=1000, keys=(), pushes=()):
        self.scene, self.left = scene, pictures
        self.coming, self.forces = dict(keys), dict(pushes)
        self.shown, self.posed, self.charts = [], 0, []

    def take_pressed_keys(self):
        if len(self.shown) == self.left:
            raise WindowClosedError
        return self.coming.get(len(self.shown), [])

    def pose(self, change):
        change()
        self.posed += 1

    def show(self, texts, chart):
        rows = {left: right for left, right in texts.values if left} | {"state": texts.values[-1][1]}
        rows["fault"] = " ".join(row[1] for row in texts.fault)
        rows["keys"] = len(texts.keys)
        rows["qpos"] = self.scene.data.qpos.copy()
        rows["run"] = self.scene.run
        points = chart.figure.linepnt[0]
        rows["peak"] = float(chart.figure.linedata[0, 1 : 2 * points : 2].max())
        rows["mark"] = float(chart.figure.linedata[np.flatnonzero(chart.figure.linepnt)[-1], 0])
        self.shown.append(rows)

    def pushes(self):
        return self.forces.get(len(self.shown), np.zeros((self.scene.model.nbody, 6)))

    def close(self):
        raise AssertionError("who opened it closes it")

    def column(self, name):
        return [rows.get(name) for rows in self.shown]

    @property
    def times(self):
        return [float(rows["time"].split()[0]) for rows in self.shown]


class Wall:
    """A clock that goes on by a frame at every rest, and by what a source's work takes."""

    def __init__(self):
        self.now, self.rests = 100.0, []

    def __call__(self):
        return self.now

    def rest(self, left):
        self.rests.append(left)
        self.now += FRAME


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    from conftest import RIGID, RIGID_DEFAULTS

    from gantrysim import Machine

    file = tmp_path_factory.mktemp("rigid") / "rigid.xml"
    file.write_text(RIGID.format(**RIGID_DEFAULTS))
    machine = Machine(file)
    servo = plain(machine, feedforward=0.0)  # so that the circle shrinks
    run = simulate(machine, servo, CIRCLE)
    return machine, servo, run, Scene(machine, run)


def replayed(made, speed=1.0, **paper):
    _, _, run, scene = made
    wall, source = Wall(), Replay(run)
    window = Paper(scene, **paper)
    player = Player(Playback("circle", scene, source), window, speed=speed, wall=WallClock(wall, wall.rest))
    assert player.play() is None
    return window


def live(made, speed=1.0, servo=None, source=None, **paper):
    machine, standard, _, scene = made
    wall = Wall()
    simulation = Simulation.of(machine, servo or standard, CIRCLE)
    source = source(simulation, wall) if source else Live(simulation, patience=EVER, timer=wall)
    window = Paper(scene, **paper)
    bodies = Bodies(scene.model, simulation.model)
    player = Player(Playback("circle", scene, source, bodies), window, speed=speed, wall=WallClock(wall, wall.rest))
    return window, source, player.play()


@pytest.mark.parametrize("speed", [0.5, 1.0, 4.0])
def test_replay_keeps_time_with_the_wall_and_stays_at_its_end(made, speed):
    machine, _, run, _ = made
    window = replayed(made, speed, pictures=40)
    moments = [min(k * FRAME * speed, run.time[-1]) for k in range(40)]
    ticks = [int(moment / PERIOD + 1e-6) for moment in moments]
    assert window.times == pytest.approx([run.time[tick] for tick in ticks], abs=0.0051)
    for rows, tick in zip(window.shown, ticks, strict=True):
        assert np.array_equal(rows["qpos"], machine.to_qpos(run.encoder[tick]))
        assert rows["mark"] == pytest.approx(run.time[tick])
    assert window.posed == len(set(ticks))  # a picture that is there already is not drawn again
    over = [tick == len(run.time) - 1 for tick in ticks]
    assert [state == "ended" for state in window.column("state")] == over
    assert any(over) is (speed >= 1.0)


def test_replay_shows_the_values_of_the_record(made):
    _, _, run, _ = made
    window = replayed(made, pictures=20)
    analysis = Analysis(run)
    error = dict(zip(analysis.ticks.tolist(), 1e3 * analysis.nozzle.distance, strict=True))
    speed = np.linalg.norm(np.gradient(run.nozzle, PERIOD, axis=0), axis=1)
    for k in range(1, 20):
        tick = int(k * FRAME / PERIOD + 1e-6)
        assert window.shown[k]["contour error"] == (f"{error[tick]:.1f} micron" if tick in error else "dispenser off")
        assert window.shown[k]["path speed"] == f"{speed[tick]:.1f} mm/s"
        assert window.shown[k]["peak"] == pytest.approx(max(error[j] for j in range(tick + 1)), rel=1e-5)
    assert len(set(window.column("contour error"))) > 10
    assert set(window.column("replay")) == {"circle"}


def test_space_pauses_and_resumes(made):
    window = replayed(made, pictures=20, keys={4: [SPACE], 10: [SPACE]})
    expected = [min(k, 4) if k < 10 else k - 6 for k in range(20)]
    assert window.times == pytest.approx([k * FRAME for k in expected], abs=0.0051)
    assert [state == "paused" for state in window.column("state")] == [4 <= k < 10 for k in range(20)]


def test_arrows_go_back_and_forward_and_home_to_the_start(made):
    _, _, run, _ = made
    keys = {4: [RIGHT], 8: [LEFT], 12: [HOME], 14: [LEFT], 16: [RIGHT, RIGHT], 18: [BACKSPACE, SPACE], 20: [RIGHT]}
    times = replayed(made, pictures=22, keys=keys).times
    end = run.time[-1]
    assert times[3:5] == pytest.approx([3 * FRAME, 4 * FRAME + 1.0], abs=0.0051)
    assert times[8] == pytest.approx(min(8 * FRAME + 1.0, end) - 1.0, abs=0.0051)
    assert times[12:15] == pytest.approx([0.0, FRAME, 0.0], abs=0.0051)
    assert times[16] == pytest.approx(end, abs=0.0051)
    assert times[18:22] == pytest.approx([0.0, 0.0, 1.0, 1.0], abs=0.0051)


def test_arrows_double_and_halve_the_speed(made):
    keys = {4: [UP], 6: [DOWN, DOWN], 10: [SPACE, UP, UP], 20: [DOWN, DOWN, DOWN, SPACE], 40: [UP]}
    window = replayed(made, pictures=42, keys=keys)
    factors = [1] * 4 + [2] * 2 + [0.5] * 4 + [0] * 10 + [0.25] * 20 + [0.5]
    assert np.diff(window.times) == pytest.approx(FRAME * np.array(factors), abs=0.0101)
    said = ["1 x"] * 4 + ["2 x"] * 2 + ["0.5 x"] * 4 + ["2 x"] * 10 + ["0.25 x"] * 20 + ["0.5 x"] * 2
    assert window.column("speed") == said


def test_home_redraws_what_the_viewer_may_have_reset(made):
    assert replayed(made, pictures=6, keys={0: [SPACE]}).posed == 1
    assert replayed(made, pictures=6, keys={0: [SPACE], 3: [BACKSPACE]}).posed == 2


def test_other_keys_are_ignored(made):
    assert replayed(made, pictures=5, keys={2: [ord("A"), 256, 290]}).times == replayed(made, pictures=5).times


def test_keys_are_listed_at_the_beginning_and_while_paused(made):
    window = replayed(made, speed=1e-3, pictures=170, keys={164: [SPACE], 168: [SPACE]})
    many, one = window.shown[0]["keys"], window.shown[163]["keys"]
    assert many > 4
    assert one == 1
    assert window.column("keys") == [many] * 160 + [one] * 4 + [many] * 4 + [one] * 2
    over = replayed(made, pictures=170)
    assert set(over.column("keys")) == {many}


def test_live_run_keeps_time_with_the_wall(made):
    machine, _, run, _ = made
    window, source, fault = live(made, pictures=40)
    assert fault is None
    assert source.over
    for k, rows in enumerate(window.shown):
        tick = min(int(k * FRAME / PERIOD + 1e-6), len(run.time) - 1)
        assert np.array_equal(rows["qpos"], machine.to_qpos(run.encoder[tick]))
    assert np.array_equal(source.run.nozzle, run.nozzle)
    lengths = [len(run.time) for run in window.column("run")]
    assert lengths == [min(int(k * FRAME / PERIOD + 1e-6) + 1, len(run.time)) for k in range(40)]
    assert window.shown[-1]["state"] == "ended"
    assert set(window.column("live")) == {"circle"}


def test_live_run_pauses_and_restarts_but_does_not_go_back(made):
    window, _, _ = live(made, pictures=14, keys={3: [SPACE], 5: [SPACE], 7: [LEFT], 8: [RIGHT], 10: [HOME]})
    expected = [0, 1, 2, 3, 3, 3, 4, 5, 6, 7, 0, 1, 2, 3]
    assert window.times == pytest.approx([k * FRAME for k in expected], abs=0.0051)


def test_ended_live_run_restarts(made):
    window, source, _ = live(made, pictures=40, keys={35: [BACKSPACE]})
    assert window.shown[34]["state"] == "ended"
    assert window.times[35:] == pytest.approx([k * FRAME for k in range(5)], abs=0.0051)
    assert not source.over


def test_live_run_that_cannot_keep_up_shows_its_actual_speed(made):
    class Slow(Live):
        """Steps 10 ms and then has lost patience."""

        def go(self, moment):
            super().go(min(moment, self.tick * PERIOD + 0.01))

    window, source, _ = live(made, 2.0, source=lambda simulation, wall: Slow(simulation, patience=EVER), pictures=60)
    times = window.times
    assert np.diff(times) == pytest.approx(0.01, abs=0.0051)
    assert window.column("speed")[:10] == ["2 x"] * 10
    assert window.shown[40]["speed"] == f"2 x, actual {0.01 / FRAME:.2g} x"
    assert not source.over


def test_live_run_does_not_catch_up_with_what_it_has_missed(made):
    class Hesitant(Live):
        calls = 0

        def go(self, moment):
            self.calls += 1
            super().go(min(moment, self.tick * PERIOD + 0.01) if 5 <= self.calls < 10 else moment)

    window, _, _ = live(made, source=lambda simulation, wall: Hesitant(simulation, patience=EVER), pictures=15)
    steps = [FRAME] * 3 + [0.01] * 5 + [FRAME] * 6
    assert np.diff(window.times) == pytest.approx(steps, abs=0.0101)


def test_live_run_continues_beyond_its_expected_end(made):
    def short(simulation, wall):
        source = Live(simulation, patience=EVER, timer=wall)
        source.until = 0.5
        return source

    window, source, _ = live(made, source=short, pictures=40)
    assert source.over
    assert window.shown[4]["time"].endswith("of 0.50 s")
    assert window.times[-1] > 1.0


def test_a_fault_ends_a_live_run_and_is_shown_and_returned(made):
    machine = made[0]
    servo = plain(machine, following_error_limit=0.02, feedforward=0.0)
    window, source, fault = live(made, servo=servo, pictures=20)
    assert fault is not None
    assert fault == source.fault
    assert window.shown[0]["fault"] == ""
    assert window.shown[-1]["fault"] == str(fault)
    assert window.shown[-1]["state"] == "ended"


def test_a_replayed_fault_is_shown_at_its_end_alone(made):
    machine, _, _, _ = made
    run = simulate(machine, plain(machine, following_error_limit=0.02, feedforward=0.0), CIRCLE)
    assert run.fault is not None
    scene, wall = Scene(machine, run), Wall()
    window = Paper(scene, pictures=int(run.time[-1] / FRAME) + 3)
    assert Player(Playback("circle", scene, Replay(run)), window, wall=WallClock(wall, wall.rest)).play() is None
    said = window.column("fault")
    assert len(run.time) > 1
    assert said[0] == ""
    assert said[-1] == str(run.fault)


def test_the_mouse_pushes_the_simulated_machine(made):
    _machine, _, run, scene = made
    wrench = np.zeros((scene.model.nbody, 6))
    wrench[scene.model.body("carriage").id] = (0.0, 30.0, 40.0, 7.0, 8.0, 9.0)  # its guides hold the torque
    window, source, _ = live(made, pictures=12, pushes=dict.fromkeys(range(4, 7), wrench))
    assert [row is not None for row in window.column("push")] == [4 <= k < 7 for k in range(12)]
    assert window.shown[5]["push"] == "50 N"
    moved = np.abs(source.run.motor - run.motor[: len(source.run.time)])
    began = int(3 * FRAME / PERIOD) + 1  # ticks until the picture before
    assert not moved[:began].any()
    assert moved[began:, 1].max() > 1e-3
    assert moved[:, 0].max() < 1e-6 * moved[:, 1].max()
    assert not source.forces.any()


def test_a_replay_ignores_pushes(made):
    window = replayed(made, pictures=3, pushes={1: "no forces at all"})
    assert window.column("push") == [None] * 3


def test_zero_speed_is_refused(made):
    _, _, run, scene = made
    with pytest.raises(InputError, match=r"^speed = 0: must be greater than 0$"):
        Player(Playback("circle", scene, Replay(run)), Paper(scene), speed=0.0)


def test_the_player_rests_until_the_next_picture(made):
    _, _, run, scene = made
    wall = Wall()

    class Busy(Paper):
        def show(self, texts, chart):
            super().show(texts, chart)
            wall.now += 0.01 if len(self.shown) < 3 else 0.1

    window = Busy(scene, pictures=6)
    Player(Playback("circle", scene, Replay(run)), window, wall=WallClock(wall, wall.rest)).play()
    assert wall.rests == pytest.approx([1 / 60 - 0.01] * 2)
