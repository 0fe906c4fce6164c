"""Recorded ranges with silences cut into them: how soon after the first range the network tracks its target again."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchmarks.common import followed
from zenoh_cbef.arrays import Bools
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import TRACKING

SECONDS = (22.0, 97.0)
"""How long the silences are, s."""

COLUMNS = (
    "set", "silence (s)", "places", "before", "at its end", "0 to 5 s after", "5 to 10 s", "worst", "tracks after (s)",
    "worst",
)  # fmt: skip

_SETTLED, _AFTER, _PLACES = 20.0, 15.0, 4
"""What has to be left before and after a silence, s, and at how many places of a recording one begins."""


def rows(name: str, settings: Mapping[str, object]) -> list[list[object]]:
    """Of each length the errors, m, median over the places, and when agents say that they track, s."""
    scenario = load("tracking", [f"{key}={value}" for key, value in settings.items()]).scenario
    world = make_world(scenario)
    heard = heard_in(Plan(scenario), world)
    found = []
    for seconds in followed(SECONDS, f"{name}, silences"):
        room = world.time[-1] - seconds - _AFTER - _SETTLED
        if room < 0.0:
            continue
        begins = _SETTLED + room * np.arange(_PLACES) / (_PLACES - 1)
        cut = [_cut(heard, (world.time > begin) & (world.time <= begin + seconds)) for begin in begins]
        traces = simulate([scenario] * _PLACES, heard=cut)
        places = [_place(*each, seconds) for each in zip(traces, begins, strict=True)]
        before, end, soon, later, again = np.array(places).T
        middle = [float(np.median(each)) for each in (before, end, soon, later)]
        found.append([name, seconds, _PLACES, *middle, later.max(), float(np.median(again)), again.max()])
    return found


def _cut(heard: Heard, silent: Bools) -> Heard:
    return Heard(heard.positions, np.where(silent, np.nan, heard.ranges), heard.age)


def _place(trace: Trace, begin: float, seconds: float) -> tuple[float, ...]:
    """RMSE before, at the end of a silence, in the five seconds after its first range, and in the next five.

    Then how long after that range all agents say that they track, s; infinite for never.
    """
    squares = np.nanmean(np.sum((trace.estimates - trace.truth)[:, :, :2] ** 2, axis=2), axis=0)
    heard = np.isfinite(trace.ranges).any(axis=0) & (trace.time > begin + seconds)
    first = float(trace.time[heard][0])
    since = trace.time - first

    def rmse(chosen: Bools) -> float:
        return float(np.sqrt(np.nanmean(squares[chosen])))

    windows: list[Bools] = [
        (trace.time > begin - 10.0) & (trace.time <= begin),
        (since >= -1.0) & (since < 0.0),
        (since >= 0.0) & (since < 5.0),
        (since >= 5.0) & (since < 10.0),
    ]
    tracks = (trace.diagnostics.status == TRACKING).all(axis=0) & (since >= 0.0)
    again = float(since[tracks][0]) if tracks.any() else np.inf
    return *map(rmse, windows), again
