"""A run as viewers show it: all positions at each step, the agents' covariances, and losses on their links."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zenoh_cbef.analysis.averages import mean_over_agents, rms_over_agents
from zenoh_cbef.analysis.chi2 import chi2_quantile
from zenoh_cbef.analysis.errors import Errors
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import Event, Recording, read_recording
from zenoh_cbef.log.read.tables import Table
from zenoh_cbef.log.read.trace import trace_of
from zenoh_cbef.trace import Trace

_CONFIDENCE = 0.95
_THINNEST = 1e-3
_LATEST = 9e9
"""The latest time that fits files in which times are ns of 64 bits, s since 1970."""


@dataclass(frozen=True)
class Ellipsoids:
    """Where targets are with a probability of 95 %: half axes (n, K, 3), m, and orientations (n, K, 4) as x, y, z, w.

    NaN where an agent has no covariance.
    """

    axes: Floats
    orientation: Floats


@dataclass(frozen=True)
class SceneEvent:
    """What a node reported. time: ns since the Unix epoch, on the axis of the scene."""

    time: int
    sender: str
    kind: str
    text: str


@dataclass(frozen=True)
class Scene:
    """A run, or a stretch of it; n agents, K steps, e directed links.

    first: the number of the first step. time: (K,), ns since the Unix epoch, k dt after the start of the run, however
    fast the processes were; of a recording's ranges on that recording's clock.
    links: (e, 2), source and destination. delivered: (e, K), share of each step's messages that came in
    time, NaN where their receiver said nothing. estimate, smoothed: (K, 3), mean of the agents' positions of the
    target, m; smoothed: None where the run has none.
    """

    analysis: Errors
    first: int
    time: Ints
    links: Ints
    delivered: Floats
    ellipsoids: Ellipsoids
    estimate: Floats
    smoothed: Floats | None
    events: list[SceneEvent]

    @property
    def trace(self) -> Trace:
        """The run."""
        return self.analysis.trace

    def halves(self, row: int) -> Floats:
        """Where the half of each link is that its receiver has, in a row: (e, 2, 3), m, from there to the middle."""
        there, here = self.trace.positions[self.links.T, row]
        return np.stack([here, 0.5 * (here + there)], axis=1)

    def metrics(self) -> dict[str, Floats]:
        """Numbers of the whole network by step, (K,) each; NaN where there is none."""
        one, smoothed = self.analysis, {}
        if one.smoothed is not None:
            smoothed = {"smoothed_position_error": rms_over_agents(one.smoothed.position[one.counted])}
        return {
            "position_error": rms_over_agents(one.position_error[one.counted]),
            **smoothed,
            "velocity_error": rms_over_agents(one.velocity_error[one.counted]),
            "centralized_position_error": one.centralized_position_error,
            "nees": mean_over_agents(one.nees[one.counted]),
            "nis": mean_over_agents(one.trace.diagnostics.nis),
            "disagreement": one.disagreement,
            "delivered": mean_over_agents(self.delivered),
        }

    def agent_metrics(self, agent: int) -> dict[str, Floats]:
        """Numbers of one agent by step, (K,) each; NaN where there is none."""
        one, trace = self.analysis, self.trace
        return {
            "position_error": one.position_error[agent],
            "nees": one.nees[agent],
            "range": trace.ranges[agent],
            "range_age": np.where(np.isfinite(trace.ranges[agent]), trace.age[agent], np.nan),
            **trace.diagnostics.each(lambda values: values[agent].astype(np.float64)).named(),
            "delivered": mean_over_agents(self.delivered[self.links[:, 1] == agent]),
        }


def read_scene(path: Path, smooth: Callable[[Trace], Trace] | None = None) -> Scene:
    """Read a log for viewers. smooth: adds a smoothed path. Raises UserError where it is no log, or holds no step."""
    recording = read_recording(open_log(path))
    trace = trace_of(recording)
    return _scene_of(recording, trace if smooth is None else smooth(trace))


def _scene_of(recording: Recording, trace: Trace) -> Scene:
    logged = logged_steps(recording, len(trace.time))
    start = start_of(logged, trace)
    return scene_of(recording, analyze([trace])[0], 0, start, events_of(recording, recording.events, logged, start))


def scene_of(recording: Recording, errors: Errors, since: int, start: int, events: list[SceneEvent]) -> Scene:
    """The scene of the steps of a trace, the first of which is since + 1. start: when step 0 was, ns."""
    trace = errors.trace
    pairs = trace.edges.tolist()
    links = np.array(sorted([*pairs, *([second, first] for first, second in pairs)]), dtype=np.int64).reshape(-1, 2)
    return Scene(
        analysis=errors,
        first=since + 1,
        time=start + np.round(1e9 * trace.time).astype(np.int64),
        links=links,
        delivered=_delivered(recording, links, since, since + len(trace.time)),
        ellipsoids=ellipsoids(trace.covariances[:, :, :3, :3]),
        estimate=mean_over_agents(trace.estimates[:, :, :3]),
        smoothed=None if errors.smoothed is None else errors.smoothed.path,
        events=events,
    )


def start_of(logged: dict[int, int], trace: Trace) -> int:
    """When step 0 was, ns: on the clock of a recording that the run is of, otherwise when it was logged."""
    origin = trace.scenario.target.origin
    if origin is not None and 0.0 <= origin + trace.scenario.dt < _LATEST:
        return round(1e9 * origin)
    first = min(logged, default=0)
    return logged.get(first, 0) - round(1e9 * trace.scenario.dt * first)


def logged_steps(recording: Recording, steps: int) -> dict[int, int]:
    """When the first beacon of each step was logged, and the start signal of step 0, ns.

    Without any of these: when the first estimate of each step was.
    """
    begun = [one.logged for one in recording.signals if one.step == 0]
    found = ({0: begun[0]} if begun else {}) | _first_logged(recording.beacons, steps)
    return found or _first_logged(recording.estimates, steps)


def _first_logged(table: Table, steps: int) -> dict[int, int]:
    seen = table.seen(steps)
    there = np.flatnonzero(seen.any(axis=0))
    times = np.where(seen, table.stamps(steps).logged, np.iinfo(np.int64).max)[:, there].min(axis=0)
    return dict(zip((there + 1).tolist(), times.tolist(), strict=True))


def events_of(recording: Recording, events: list[Event], logged: dict[int, int], start: int) -> list[SceneEvent]:
    """What nodes reported; in the scene an event stands between the same steps as in the log."""
    known = sorted(logged)
    ticks = [start + round(1e9 * step * recording.header.scenario.dt) for step in known]
    times = [logged[step] for step in known]
    return [
        SceneEvent(
            max(0, int(np.interp(one.logged, times, ticks))) if known else one.logged,  # files know no earlier time
            one.message["from"],
            one.message["kind"],
            one.message["text"],
        )
        for one in events
    ]


def _delivered(recording: Recording, links: Ints, since: int, until: int) -> Floats:
    """The share of each step's messages that came in time, by link, in steps since+1 to until, (e, K)."""
    share = np.full((len(links), until - since), np.nan)
    place = {(source, destination): row for row, (source, destination) in enumerate(links.tolist())}
    for agent, receipts in enumerate(recording.receipts):
        known, new = receipts.fresh(since, until)
        came, total = new[:, 0], new[:, :3].sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            part = np.where(total > 0, came / total, np.nan)
        for at, source in enumerate(receipts.neighbours):
            if (source, agent) in place:
                share[place[source, agent], known - since - 1] = part[:, at]
    return share


def ellipsoids(covariances: Floats) -> Ellipsoids:
    """The 95 % ellipsoids of covariances (n, K, 3, 3); where a height is given, ellipses as thin discs."""
    shape = covariances.shape[:2]
    axes, orientation = np.full((*shape, 3), np.nan), np.full((*shape, 4), np.nan)
    known = np.isfinite(covariances).all(axis=(2, 3))
    values, vectors = np.linalg.eigh(covariances[known])
    # Of a left-handed set of axes no rotation is made.
    vectors[:, :, 0] *= np.sign(np.linalg.det(vectors))[:, None]
    flat = (covariances[known][:, 2, 2] == 0.0).all() if known.any() else False
    reach = np.sqrt(chi2_quantile(_CONFIDENCE, 2.0 if flat else 3.0))
    axes[known] = np.maximum(reach * np.sqrt(np.maximum(values, 0.0)), _THINNEST)
    orientation[known] = quaternions(vectors)
    return Ellipsoids(axes, orientation)


def quaternions(rotations: Floats) -> Floats:
    """Unit quaternions (m, 4) as x, y, z, w of rotation matrices (m, 3, 3).

    Bar-Itzhack (2000): the dominant eigenvector of a symmetric matrix made of the rotation's elements.
    """
    r = rotations
    k = np.empty((len(r), 4, 4))
    k[:, :3, :3] = r + r.transpose(0, 2, 1)
    diagonal = np.einsum("mii->mi", r)
    trace = diagonal.sum(axis=1)
    for axis in range(3):
        k[:, axis, axis] = 2.0 * diagonal[:, axis] - trace
    skew = np.stack([r[:, 2, 1] - r[:, 1, 2], r[:, 0, 2] - r[:, 2, 0], r[:, 1, 0] - r[:, 0, 1]], axis=1)
    k[:, 3, :3] = k[:, :3, 3] = skew
    k[:, 3, 3] = trace
    _, vectors = np.linalg.eigh(k / 3.0)
    return np.asarray(vectors[:, :, -1])
