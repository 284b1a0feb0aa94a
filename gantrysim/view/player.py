"""Plays a source in a window: keys to the clock, the clock's moment to the source, the source's tick to the window."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from gantrysim.render.readout import Readout
from gantrysim.render.scene import Scene
from gantrysim.run import Fault, Run
from gantrysim.view.chart import Chart
from gantrysim.view.clock import Clock, Pace
from gantrysim.view.keys import ACTIONS, Action
from gantrysim.view.panel import told
from gantrysim.view.push import Bodies
from gantrysim.view.source import Source
from gantrysim.view.window import Window, WindowClosedError

_PERIOD = 1 / 60  # of pictures, at best [s]
_JUMP = 1.0  # of the arrow keys [s]
_LEGEND = 10.0  # for which all keys are told at the beginning; later only while it stands [s]


class Player:
    """Plays a source until the window is closed.

    Args:
        name: of the job, to be shown.
        scene: of the machine that the source is of.
        source: of what is shown.
        window: to show it in.
        bodies: that the mouse may push; None where it cannot.
        speed: seconds shown in a second.
        timer: the wall's clock [s].
        rest: called between pictures with the time that is left [s].

    Raises:
        InputError: a speed that is not above zero.
    """

    def __init__(
        self,
        name: str,
        scene: Scene,
        source: Source,
        window: Window,
        *,
        bodies: Bodies | None = None,
        speed: float = 1.0,
        timer: Callable[[], float] = time.perf_counter,
        rest: Callable[[float], None] = time.sleep,
    ) -> None:
        self._name, self._scene, self._source, self._window = name, scene, source, window
        self._bodies, self._timer, self._rest = bodies, timer, rest
        self._pace, self._chart = Pace(), Chart()
        self._shown: tuple[Run, int] | None = None
        self._push = 0.0
        self._readout = Readout(source.run)
        # a live run may wait at gates, and last longer than is known
        end = np.inf if source.live else source.until
        self._begun = timer()
        self.clock = Clock(speed, end, since=self._begun)

    def play(self, stopped: Callable[[], bool] = lambda: False) -> Fault | None:
        """Play until the window is closed, and return the fault that ended a live run.

        Args:
            stopped: asked before every picture, whether to end without that.
        """
        try:
            while not stopped():
                begun = self._timer()
                self.picture()
                left = _PERIOD - (self._timer() - begun)
                if left > 0:
                    self._rest(left)
        except WindowClosedError:
            pass
        return self._source.fault if self._source.live else None

    def picture(self) -> None:
        """Show one picture: of now.

        Raises:
            WindowClosedError: the window is closed.
        """
        for key in self._window.pressed():
            if key in ACTIONS:
                self._do(ACTIONS[key])
        self._push_on()
        source, now = self._source, self._timer()
        wanted = self.clock.at(now)
        if not source.over or not source.live:
            source.go(wanted)
        run, tick = source.run, source.tick
        at = float(run.time[tick])
        if source.live and not self.clock.stands and at + run.period < wanted:
            # it cannot keep up: nothing is to be caught up with later
            self.clock = self.clock.moved(at, now)
        self._pace.note(now, self.clock.at(now))
        if self._shown is None or self._shown != (run, tick):
            self._window.pose(lambda: self._pose(run, tick))
            self._shown = (run, tick)
        self._say(run, tick, now)

    def _do(self, action: Action) -> None:
        now, live = self._timer(), self._source.live
        self._pace.forget()
        if action is Action.PAUSE:
            self.clock = self.clock.toggled(now)
        elif action in (Action.FASTER, Action.SLOWER):
            self.clock = self.clock.scaled(2.0 if action is Action.FASTER else 0.5, now)
        elif action is Action.START:
            self._source.restart()
            self.clock = self.clock.moved(0.0, now)
            self._shown = None
        elif not live:
            jump = _JUMP if action is Action.FORWARD else -_JUMP
            self.clock = self.clock.moved(self.clock.at(now) + jump, now)

    def _push_on(self) -> None:
        if self._bodies is None:
            return
        wrench = self._window.pushes()
        self._push = float(np.linalg.norm(wrench[:, :3].sum(axis=0)))
        self._source.push(self._bodies.handed_on(wrench, np.array(self._scene.data.xipos)))

    def _pose(self, run: Run, tick: int) -> None:
        if run is not self._scene.run:
            self._scene.show(run)
        self._scene.pose(tick)

    def _say(self, run: Run, tick: int, now: float) -> None:
        if run is not self._readout.run:
            self._readout = Readout(run)
        source, readout, clock = self._source, self._readout, self.clock
        self._chart.draw(readout.time[: tick + 1], readout.error[: tick + 1], source.until)
        panel = told(
            self._name,
            time=float(run.time[tick]),
            until=source.until,
            speed=float(readout.speed[tick]),
            error=float(readout.error[tick]),
            factor=clock.speed,
            pace=self._pace.factor,
            paused=clock.stands,
            over=source.over,
            live=source.live,
            push=self._push,
            keys=clock.stands or source.over or now - self._begun < _LEGEND,
            fault=source.fault,
        )
        self._window.show(panel, self._chart)
