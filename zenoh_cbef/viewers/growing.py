"""Scenes of a recording that may still grow, a stretch of steps at a time, with the numbers of the finished run."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import numpy as np

from zenoh_cbef.analysis.errors import errors_of
from zenoh_cbef.analysis.yardsticks import Yardsticks, centralized_steps
from zenoh_cbef.arrays import Floats
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.log.read.trace import stretch_of
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.diagnostics import NAMES
from zenoh_cbef.tracking.reference import Ranges, each_step
from zenoh_cbef.viewers.scene import Scene, SceneEvent, events_of, logged_steps, scene_of, start_of

_WAITS = 8
"""Steps for which a message of a run may be on its way: estimates, ranges, beacons and truth come by their own ways."""


class GrowingScene:
    """A run that is read or heard while it is shown.

    The caller keeps other threads from putting messages into the recording while a method runs. Ranges and beacons have
    to be in it, as the centralised filter runs along; smoothed paths come too late to be shown.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording, plan = recording, recording.plan
        self._start: int | None = None
        self._events: list[SceneEvent] = []
        self._fed = deque[Ranges]()
        self._beliefs = centralized_steps(plan, plan.initial_states[None], self._feed())
        self._centralized: list[Floats] = []
        self._known = True

    @property
    def reached(self) -> int:
        """The steps that the centralised filter has taken."""
        return len(self._centralized)

    def settled(self, since: int, until: int) -> int:
        """Up to which of these steps all is there that estimates tell of; others may be on their way for some steps."""
        recording, most = self._recording, max(since, until - _WAITS)
        innovation = recording.estimates.numbers("said", until)[:, most:, NAMES.index("innovation")]
        lacks = np.isfinite(innovation) & ~recording.beacons.seen(until)[:, most:]
        seen, truth = recording.estimates.seen(until)[:, most:], recording.truth.seen(until)
        lacks |= seen & ~recording.ranges.seen(until)[:, most:]
        if truth.any():  # real targets have none
            lacks |= seen & ~truth[:, most:]
        lacking = np.flatnonzero(lacks.any(axis=0))
        return most + int(lacking[0]) if len(lacking) else until

    def stretch(self, since: int, until: int, *, whole: bool = False) -> Scene:
        """Steps since+1 to until. whole: whether no further step comes, so that all events that are left belong to it.

        Costs as much as all steps that the centralised filter lacks: see `reach`.
        """
        recording = self._recording
        trace = stretch_of(recording, since, until)
        self.reach(until)
        unknown = np.full((until - since, 6, 6), np.nan)
        states = np.array(self._centralized[since:until]).reshape(-1, 6)
        errors = errors_of(trace, Yardsticks(states, np.full_like(states, np.nan), unknown), 0.0)
        if self._start is None:
            self._start = start_of(logged_steps(recording, until), trace)
        self._settle(until, self._start, whole=whole)
        first, last = (self._start + round(1e9 * trace.scenario.dt * step) for step in (since, until))
        events = [one for one in self._events if (one.time > first or not since) and (one.time <= last or whole)]
        return scene_of(recording, errors, since, self._start, events)

    def reach(self, step: int) -> None:
        """Let the centralised filter take all steps up to this one."""
        since = self.reached
        if step <= since:
            return
        trace = stretch_of(self._recording, since, step)
        count = self._measured(trace, since, step)
        space = trace.plan.space
        parts = {"positions": trace.positions, "ranges": trace.ranges, "age": trace.age}
        seen = {name: values[None, :, :count] for name, values in parts.items()}
        self._fed.extend(each_step(**seen, range_std=trace.plan.range_std))
        self._centralized += [space.embed_state(next(self._beliefs).state)[0] for _ in range(count)]
        self._centralized += [np.full(6, np.nan)] * (step - since - count)

    def _measured(self, trace: Trace, since: int, until: int) -> int:
        """How many of these steps the centralised filter can take: none from the first on that was not heard."""
        heard = np.asarray(self._recording.estimates.seen(until)[:, since:].any(axis=0))
        count = min(trace.measured_steps, len(heard) if heard.all() else int(heard.argmin())) if self._known else 0
        self._known = self._known and count == until - since
        return count

    def _feed(self) -> Iterator[Ranges]:
        while True:
            yield self._fed.popleft()

    def _settle(self, until: int, start: int, *, whole: bool) -> None:
        """Give events their times as far as the steps around them are known."""
        fresh = self._recording.events[len(self._events) :]
        if not fresh:
            return
        logged = logged_steps(self._recording, until)
        latest = max(logged.values(), default=0)
        count = len(fresh) if whole else next((at for at, one in enumerate(fresh) if one.logged > latest), len(fresh))
        self._events += events_of(self._recording, fresh[:count], logged, start)
