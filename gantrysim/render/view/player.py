"""Player: keys set the clock, the clock's moment drives the source, and the window shows the source's tick."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gantrysim.record.run import Run
from gantrysim.record.run_file import Fault
from gantrysim.render.telemetry import Telemetry
from gantrysim.render.view.clock import Clock, Pace
from gantrysim.render.view.source import Playback
from gantrysim.render.view.texts import Chart, ViewState, moment_texts
from gantrysim.render.view.window import ViewerWindow, WindowClosedError

# GLFW's key codes
_SPACE_KEY = 32
_BACKSPACE = 259
_RIGHT = 262
_LEFT = 263
_DOWN = 264
_UP_KEY = 265
_HOME = 268
_PERIOD = 1 / 60  # of pictures, at best [s]
_ARROW_JUMP = 1.0  # of the arrow keys [s]
_ALL_KEYS = 10.0  # for which all keys are listed at the beginning; later only while paused [s]


class WallClock(NamedTuple):
    """The time of the viewer, which tests replace.

    Attributes:
        now: returns the time [s].
        wait: waits for a time [s].
    """

    now: Callable[[], float] = time.perf_counter
    wait: Callable[[float], None] = time.sleep


_WALL = WallClock()


class Player:
    """Plays a run until the window is closed.

    Args:
        playback: the run.
        window: to show it in.
        speed: seconds shown per second.
        wall: the time between pictures.

    Raises:
        InputError: a speed that is not above zero.
    """

    def __init__(
        self,
        playback: Playback,
        window: ViewerWindow,
        *,
        speed: float = 1.0,
        wall: WallClock = _WALL,
    ) -> None:
        source = playback.source
        self._name = playback.name
        self._scene = playback.scene
        self._source = source
        self._window = window
        self._bodies = playback.bodies
        self._wall = wall
        self._pace = Pace()
        self._chart = Chart()
        self._shown: tuple[Run, int] | None = None
        self._push = 0.0
        self._telemetry = Telemetry(source.run)
        # waiting at gates may prolong a live run
        end = np.inf if source.live else source.until
        self._start = wall.now()
        self.clock = Clock(speed, end, since=self._start)

    def play(self, stopped: Callable[[], bool] = lambda: False) -> Fault | None:
        """Play until the window is closed or `stopped` returns True; return the fault that ended a live run."""
        try:
            while not stopped():
                start = self._wall.now()
                self.picture()
                remaining = _PERIOD - (self._wall.now() - start)
                if remaining > 0:
                    self._wall.wait(remaining)
        except WindowClosedError:
            pass
        return self._source.fault if self._source.live else None

    def picture(self) -> None:
        """Show the picture of now.

        Raises:
            WindowClosedError: the window is closed.
        """
        for key in self._window.take_pressed_keys():
            self._act(key)
        self._apply_pushes()
        source = self._source
        now = self._wall.now()
        moment = self.clock.at(now)
        if not source.over or not source.live:
            source.go(moment)
        run = source.run
        tick = source.tick
        reached = float(run.time[tick])
        if source.live and not self.clock.is_paused and reached + run.period < moment:
            # too slow: the clock waits, so that no time has to be made up later
            self.clock = self.clock.moved(reached, now)
        self._pace.note(now, self.clock.at(now))
        if self._shown != (run, tick):
            self._window.pose(lambda: self._pose(run, tick))
            self._shown = (run, tick)
        self._show(run, tick, now)

    def _act(self, key: int) -> None:
        now = self._wall.now()
        if key == _SPACE_KEY:
            self.clock = self.clock.toggled(now)
        elif key in (_UP_KEY, _DOWN):
            self.clock = self.clock.scaled(2.0 if key == _UP_KEY else 0.5, now)
        elif key in (_HOME, _BACKSPACE):
            self._source.restart()
            self.clock = self.clock.moved(0.0, now)
            self._shown = None
        elif key in (_LEFT, _RIGHT) and not self._source.live:
            self.clock = self.clock.moved(self.clock.at(now) + (_ARROW_JUMP if key == _RIGHT else -_ARROW_JUMP), now)
        else:
            return
        self._pace.reset()

    def _apply_pushes(self) -> None:
        if self._bodies is None:
            return
        wrench = self._window.pushes()
        self._push = float(np.linalg.norm(wrench[:, :3].sum(axis=0)))
        self._source.push(self._bodies.transferred(wrench, np.array(self._scene.data.xipos)))

    def _pose(self, run: Run, tick: int) -> None:
        if run is not self._scene.run:
            self._scene.show(run)
        self._scene.pose(tick)

    def _show(self, run: Run, tick: int, now: float) -> None:
        if run is not self._telemetry.run:
            self._telemetry = Telemetry(run)
        source = self._source
        telemetry = self._telemetry
        clock = self.clock
        self._chart.draw(telemetry.time[: tick + 1], telemetry.error[: tick + 1], source.until)
        keys = clock.is_paused or source.over or now - self._start < _ALL_KEYS
        view = ViewState(clock, self._pace.factor, self._push, keys)
        texts = moment_texts(self._name, source, telemetry, view)
        self._window.show(texts, self._chart)
