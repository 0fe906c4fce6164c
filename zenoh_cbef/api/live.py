"""The estimates of a run that goes on, as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.listening import Listener
from zenoh_cbef.outside.registry import KnownRun, find_run
from zenoh_cbef.protocol.session import Connection

_PATIENCE_SECONDS = 10.0
_LOOK_SECONDS = 0.5
"""How often to look whether the run has ended while nothing comes."""
_BEGIN_SECONDS = 0.1
"""How often to look whether the run has begun."""


@dataclass(frozen=True, eq=False)
class LiveEstimate:
    """What one agent estimates in one step.

    time: s since the start. state: (6,), position and velocity, m and m/s. covariance: (6, 6), NaN where the filter
    has none. truth: (6,), NaN while the target has not told it.
    """

    agent: int
    step: int
    time: float
    state: Floats
    covariance: Floats
    truth: Floats

    @property
    def error(self) -> float:
        """Distance of the estimated position from the truth, m; NaN where the truth is not known."""
        return float(np.linalg.norm((self.state - self.truth)[:3]))


def live(
    run: str | None = None, endpoint: str | None = None, *, patience: float = _PATIENCE_SECONDS
) -> Iterator[LiveEstimate]:
    """Yield the estimates of all agents of a run that goes on, from now on, as they come; ends with the run.

    run: its name; None: the only one on this host. endpoint: of its target, such as tcp/192.168.1.5:7447; None: the run
    is on this host. patience: how long the run may take to begin, and then to answer, s. The run does not
    notice. A caller that stops early leaves the run by closing the iterator. Raises UserError where the run does not
    answer.
    """
    if run is None or endpoint is None:
        known = _awaited(run, patience)
        run, endpoints = known.name, [endpoint] if endpoint else known.endpoints
    else:
        endpoints = [endpoint]
    connection = Connection(connect=endpoints, mode="client", gossip=False)
    with Listener(run, connection, patience) as listener:
        news = _News(listener)
        while not listener.ended:
            found = news.taken(_LOOK_SECONDS)
            if not found and listener.operator.status_if_on() is None:  # the target died without a word
                break
            yield from found
        yield from news.taken(0.0)


def _awaited(run: str | None, patience: float) -> KnownRun:
    """A run of this host, also one whose processes begin just now."""
    until = time.monotonic() + patience
    while True:
        try:
            return find_run(run)
        except UserError:
            if time.monotonic() > until:
                raise
            time.sleep(_BEGIN_SECONDS)


class _News:
    """The estimates of a listener that were not handed over yet."""

    def __init__(self, listener: Listener) -> None:
        self._listener, self._recording = listener, listener.recording
        scenario = self._recording.header.scenario
        self._dt = scenario.dt
        self._taken = np.zeros((scenario.count, 0), dtype=bool)

    def taken(self, seconds: float) -> list[LiveEstimate]:
        """What is new, by step and agent; waits so long for it where there is nothing."""
        with self._listener.news:
            if not len(places := self._places()) and seconds:
                self._listener.news.wait(seconds)
                places = self._places()
            estimates, truth = self._recording.estimates, self._recording.truth
            last = self._taken.shape[1]
            states, covariances = estimates.numbers("state", last), estimates.numbers("covariance", last)
            known = truth.numbers("state", last)[0]
            found = [
                LiveEstimate(
                    agent,
                    place + 1,
                    (place + 1) * self._dt,
                    states[agent, place].copy(),
                    covariances[agent, place].reshape(6, 6).copy(),
                    known[place].copy(),
                )
                for place, agent in places.tolist()
            ]
            self._taken[places[:, 1], places[:, 0]] = True
        return found

    def _places(self) -> Ints:
        """Step, from 0, and agent of each estimate that was not taken, (m, 2), by step."""
        estimates = self._recording.estimates
        seen = estimates.seen(estimates.last)
        more = seen.shape[1] - self._taken.shape[1]
        self._taken = np.pad(self._taken, ((0, 0), (0, more)))
        return np.argwhere((seen & ~self._taken).T)
