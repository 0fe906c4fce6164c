"""Plays messages at their times, faster or slower, pauses, steps and seeks. It knows neither log nor network."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.tools.playlist import Item

Source = Callable[[int, int], Iterator[Item]]


@dataclass(frozen=True)
class PlayerState:
    """The state of a replay. position, duration: s of the log. published: messages so far.

    state: playing, paused, stepping (while messages or steps are still to be played) or done.
    """

    state: str
    position: float
    duration: float
    rate: float
    published: int
    lap: int


class Timeline:
    """The present time of the log: a straight line from the last change on, so that errors do not add up."""

    def __init__(self, position: int, rate: float, *, runs: bool) -> None:
        self.rate, self.runs = rate, runs
        self._position, self._since = position, time.monotonic()

    def now(self) -> int:
        """The log time (ns)."""
        passed = time.monotonic() - self._since if self.runs else 0.0
        return self._position + round(1e9 * passed * self.rate)

    def change(self, *, position: int | None = None, rate: float | None = None, runs: bool | None = None) -> None:
        """Go on from the present or another position, at the same or another rate; or stand still."""
        self._position = self.now() if position is None else position
        self._since = time.monotonic()
        self.rate = self.rate if rate is None else rate
        self.runs = self.runs if runs is None else runs

    def left(self, moment: int) -> float:
        """How long it is until a log time (ns), s."""
        return self._since + (moment - self._position) / (1e9 * self.rate) - time.monotonic()


class Player:
    """Plays the messages between two log times (ns). Orders may come from any thread.

    source: gives the messages from one log time to another. publish: takes one. origin: the log time that
    positions (s) count from. loop: begin again at the end.
    """

    def __init__(
        self,
        source: Source,
        publish: Callable[[Item], None],
        *,
        origin: int,
        begin: int,
        end: int,
        rate: float = 1.0,
        loop: bool = False,
        paused: bool = False,
    ) -> None:
        self._source, self._publish = source, publish
        self._origin, self._begin, self._end, self._loop = origin, begin, end, loop
        self._line = Timeline(begin, rate, runs=False)
        self._begins_paused = paused
        self._changed = threading.Condition()
        self._sought: int | None = None
        self._stopped = self._done = False
        self._messages = self._steps = 0
        self._fresh = False
        self._highest = 0
        self._published, self._lap = 0, 1

    def run(self) -> None:
        """Play to the end, or until stopped."""
        since = self._begin
        self._line.change(runs=not self._begins_paused)
        while True:
            ended = self._play_from(since)
            with self._changed:
                if self._sought is not None:
                    since, self._sought = self._sought, None
                elif ended and self._loop:
                    since = self._begin
                    self._lap += 1
                else:
                    break
                self._highest = 0
        self._done = True

    @property
    def ended(self) -> bool:
        """Whether everything was played."""
        return self._done and not self._stopped

    def _play_from(self, since: int) -> bool:
        """Play from a log time on; whether it came to the end."""
        began = False
        for item in self._source(since, self._end):
            if not began:
                # Time stood still while the reader passed over earlier messages.
                self._arrive(since)
                began = True
            if not self._await(item):
                return False
            self._publish(item)
        return not self._stopped

    def _arrive(self, since: int) -> None:
        with self._changed:
            if self._sought is None:
                self._line.change(position=since)

    def _await(self, item: Item) -> bool:
        """Wait until a message is due; False where it is not to be played, after an order to stop or seek."""
        with self._changed:
            while not self._stopped and self._sought is None:
                if self._line.runs:
                    left = self._line.left(item.log_time)
                    if left > 0.0:
                        self._changed.wait(left)
                        continue
                elif self._allowed(item):
                    self._line.change(position=max(self._line.now(), item.log_time))
                else:
                    self._changed.wait()
                    continue
                self._highest = max(self._highest, item.step)
                self._published += 1
                return True
        return False

    def _allowed(self, item: Item) -> bool:
        """Whether a message may be played while paused: one of those asked for, or of the steps asked for.

        A step ends where a message begins a later one; the first message is played in any case.
        """
        if self._messages:
            self._messages -= 1
            return True
        if self._steps and item.step > self._highest and not self._fresh:
            self._steps -= 1
        elif self._steps:
            self._fresh = False
        return self._steps > 0

    def state(self) -> PlayerState:
        """The state of the replay."""
        with self._changed:
            pending = "stepping" if self._messages or self._steps else "paused"
            state = "done" if self._done else "playing" if self._line.runs else pending
            position = min(max(self._line.now(), self._begin), self._end) - self._origin
            duration = (self._end - self._origin) / 1e9
            return PlayerState(state, position / 1e9, duration, self._line.rate, self._published, self._lap)

    def stop(self) -> None:
        """End now."""
        with self._changed:
            self._stopped = not self._done
            self._changed.notify_all()

    def pause(self) -> None:
        """Stand still."""
        self._run(runs=False)

    def resume(self) -> None:
        """Go on."""
        self._run(runs=True)

    def toggle(self) -> None:
        """Pause or go on."""
        self._run(runs=not self._line.runs)

    def _run(self, *, runs: bool) -> None:
        with self._changed:
            self._messages = self._steps = 0
            self._line.change(runs=runs)
            self._changed.notify_all()

    def next(self, count: int = 1) -> None:
        """Play that many messages, then stand still."""
        with self._changed:
            self._line.change(runs=False)
            self._messages += count
            self._changed.notify_all()

    def step(self, count: int = 1) -> None:
        """Play on to where the next step of the run begins, that many times, then stand still."""
        with self._changed:
            self._line.change(runs=False)
            self._fresh = self._fresh or self._steps == 0
            self._steps += count
            self._changed.notify_all()

    def set_rate(self, rate: float) -> None:
        """Play at that many times real time."""
        if not 0.0 < rate < 1e6:
            raise UserError(f"a rate of {rate:g} cannot be played; give a number above 0 and below 1000000")
        with self._changed:
            self._line.change(rate=rate)
            self._changed.notify_all()

    def scale_rate(self, factor: float) -> None:
        """Play that many times faster."""
        with suppress(UserError):  # at the ends of what can be played
            self.set_rate(self._line.rate * factor)

    def seek(self, position: float) -> None:
        """Go on from a position (s) in the log."""
        moment = self._origin + round(1e9 * position)
        if not self._begin <= moment <= self._end:
            first, last = ((each - self._origin) / 1e9 for each in (self._begin, self._end))
            raise UserError(f"there is no position {position:g} s; seek from {first:g} s to {last:g} s")
        with self._changed:
            self._messages = self._steps = 0
            self._sought = moment
            self._line.change(position=moment)
            self._changed.notify_all()
