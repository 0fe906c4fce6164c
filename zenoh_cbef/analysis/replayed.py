"""A run as the report's map plays it: at most some hundred moments, each with its verdict."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.averages import rms_over_agents
from zenoh_cbef.analysis.claimed import claimed_position_error
from zenoh_cbef.analysis.faulted import faults_of
from zenoh_cbef.analysis.figures import agent_names
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.nearest import nearest
from zenoh_cbef.analysis.standing import strokes_of
from zenoh_cbef.analysis.verdict import RECENT, WINDOW, Moment, Verdict, parts, verdict
from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.pages.packing import framed
from zenoh_cbef.protocol.slow import AGAIN_SECONDS, SLOW
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.trace import began
from zenoh_cbef.tracking.status import STATUSES

_MOST_NUMBERS, _MOST_MOMENTS, _FEWEST_MOMENTS = 36_000, 300, 40
_UPPER = np.triu_indices(3)


def replayed(analysis: Analysis) -> bytes:
    """The scene of a run with all its moments, as `scene/seen.js` plays it; of a large network a part."""
    near = nearest(analysis)
    trace, (until, counts) = near.trace, _passed(near)
    rows, links = until - 1, np.stack([trace.links.source, trace.links.destination], axis=1)
    told = {
        "dt": trace.scenario.dt,
        "names": agent_names(near),
        "links": links.tolist(),
        "statuses": STATUSES,
        "faults": faults_of(trace.scenario),
        "counted": trace.passing is not None,
        "verdicts": [list(one) for one in _verdicts(analysis, until)],
    }
    moves = np.nanmax(np.ptp(trace.positions, axis=1), initial=0.0) > 0.0
    covariances = trace.covariances[:, rows]
    arrays = {
        "step": until.astype(np.float64),
        "truth": trace.truth[rows, :3],
        "place": np.moveaxis(trace.positions[:, rows if moves else rows[:1]], 0, 1),
        "estimate": np.moveaxis(trace.estimates[:, rows, :3], 0, 1),
        "spread": np.moveaxis(covariances[:, :, _UPPER[0], _UPPER[1]], 0, 1),
        "drawn": strokes_of(trace)[:, rows].T,
        "status": trace.diagnostics.status[:, rows].T.astype(np.float64),
        "passed": np.moveaxis(counts, 1, 0),
    }
    return framed(told, arrays)


def _passed(analysis: Analysis) -> tuple[Ints, Floats]:
    """The last steps of the moments, (B,), and what passed in each, (e, B, 4); NaN where no log tells."""
    trace, steps = analysis.trace, len(analysis.trace.time)
    if trace.passing is not None:
        return trace.passing.until, trace.passing.counts
    each = max(len(trace.links.source), len(trace.estimates))
    most = min(steps, _MOST_MOMENTS, max(_FEWEST_MOMENTS, _MOST_NUMBERS // each))
    until = np.unique(np.linspace(0, steps, most + 1).round().astype(np.int64)[1:])
    return until, np.full((len(trace.links.source), len(until), 4), np.nan)


def _verdicts(analysis: Analysis, until: Ints) -> list[Verdict]:
    """What each moment looks like, of all agents."""
    trace, passing = analysis.trace, analysis.trace.passing
    links = np.stack([trace.links.source, trace.links.destination], axis=1)
    there = np.isfinite(trace.estimates[:, :, 0])
    errors = analysis.position_error, claimed_position_error(trace)
    error, claimed = (rms_over_agents(each[analysis.counted]) for each in errors)
    slow = _slow(analysis)
    found = []
    for place, step in enumerate(until.tolist()):
        row, recent = step - 1, slice(max(step - WINDOW, 0), step)
        stretch = step - (int(until[place - 1]) if place else 0)
        late = [name for at, name in slow if 0.0 <= trace.time[row] - at < AGAIN_SECONDS]
        moment = Moment(
            states=trace.diagnostics.status[:, row],
            seconds=trace.diagnostics.status_seconds[:, row],
            there=there[:, row],
            honest=analysis.counted,
            error=error[recent],
            claimed=claimed[recent],
            apart=float(analysis.disagreement[row]),
            parts=1 if passing is None else parts(links, _came(passing.counts, place, stretch), there[:, row]),
            slow=late[-1] if late else "",
            names=trace.scenario.agents.names,
        )
        found.append(verdict(moment))
    return found


def _came(counts: Floats, place: int, stretch: int) -> Bools:
    """Which links carried messages lately, (e,): all, where no agent tells."""
    lately = counts[:, max(place + 1 - -(-RECENT // stretch), 0) : place + 1, 0]
    return np.asarray(np.isnan(counts[:, :, 0]).all() | (np.nansum(lately, axis=1) > 0.0))


def _slow(analysis: Analysis) -> list[tuple[float, str]]:
    """Which processes said when (run time, s) that they do not keep up."""
    events = analysis.trace.events
    start = began(events)
    if start is None:
        return []
    told = [(one.get("sent"), str(one.get("from"))) for one in events if one.get("kind") == SLOW]
    return [(1e-9 * at - start, in_words(name)) for at, name in told if isinstance(at, int)]
