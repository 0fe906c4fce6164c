"""A run as the page draws it: numbers of one step, and curves over all of them. The same for a log and a live run."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from zenoh_cbef.analysis.averages import mean_over_agents
from zenoh_cbef.analysis.faulted import faults_of, honest_agents
from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.log.read.receipts import Receipts
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.scenario.paths import places_at
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.start import unguided_seconds
from zenoh_cbef.tracking.diagnostics import NAMES
from zenoh_cbef.tracking.graph import directed
from zenoh_cbef.tracking.status import STATUSES, strokes

CURVES = ("error", "disagreement", "claimed", "nis", "lost", "late", "latency")
"""The curves of the whole network: root mean square position error (m), disagreement (m) and claimed position error
(m), mean NIS, shares of messages lost and late, mean latency (s)."""

_UPPER = np.triu_indices(3)
_KEPT = 3
"""How many steps' messages are found at least."""
_RECENT = 8
"""Steps by which the agents of one run may be apart: an agent that is further behind is away."""

Arrays = dict[str, Floats]


class Scene:
    """A recording that may still grow, seen step by step; n agents, e directed links.

    The caller keeps other threads from putting messages into the recording while a method runs.
    """

    def __init__(self, recording: Recording) -> None:
        self.recording = recording
        self._rows: dict[int, Ints] = {}
        self._kept: tuple[int, int, int, Floats] = (-1, 0, 0, np.empty((0, 0, 4)))
        self._known = {name: np.empty(0) for name in CURVES}

    @property
    def plan(self) -> Plan:
        """The plan of the run, with the faults that were injected so far."""
        return self.recording.plan

    @cached_property
    def links(self) -> Ints:
        """The directed links, (e, 2): source and destination, by destination."""
        return directed(self.recording.header.plan.edges)

    def described(self) -> dict[str, object]:
        """What does not change from step to step, for the page."""
        scenario = self.plan.scenario
        return {
            "run": self.recording.header.run,
            "scenario": scenario.name,
            "filter": scenario.filter.kind,
            "mode": scenario.timing.mode,
            "agents": scenario.count,
            "names": scenario.agents.names,
            "steps": scenario.length,
            "dt": scenario.dt,
            "rounds": self.recording.rounds_per_step,
            "links": self.links.tolist(),
            "statuses": STATUSES,
            "steered": scenario.target.motion == "manual",
            "faults": faults_of(scenario),
        }

    @property
    def newest(self) -> int:
        """The last step that all agents that take part have concluded, 0 before any."""
        estimates = self.recording.estimates
        seen = estimates.seen(estimates.last)[:, -_RECENT:]
        if not seen.size:
            return 0
        behind = np.argmax(seen[seen.any(axis=1)][:, ::-1], axis=1)
        return int(estimates.last - behind.max())

    def frame(self, step: int) -> Arrays:
        """The numbers of one step, NaN where there is nothing.

        truth: (6). place: (n, 3), m, of the agents. estimate: (n, 6). spread: (n, 6), m^2, the upper triangle of the
        position's covariance, row by row. said: (n, 3): status, s that it has lasted, NIS. drawn: (n), how
        strongly the path is drawn there, 0 to 1. links: (e, 4): how many
        messages came in time, were lost and came late in this step, and their mean latency, s.
        """
        recording, dt = self.recording, self.plan.scenario.dt
        row = max(step, 1) - 1
        covariance = recording.estimates.numbers("covariance", row + 1)[:, row].reshape(-1, 6, 6)
        said = recording.estimates.numbers("said", row + 1)[:, row]
        told = [NAMES.index(name) for name in ("status", "status_seconds", "nis")]
        return {
            "truth": recording.truth.numbers("state", row + 1)[0, row],
            "place": places_at(self.plan.scenario, np.array([step * dt]))[:, 0],
            "estimate": recording.estimates.numbers("state", row + 1)[:, row],
            "spread": covariance[:, _UPPER[0], _UPPER[1]],
            "said": said[:, told],
            "drawn": self._drawn(said),
            "links": self.fresh(row, row + 1)[:, 0],
        }

    def marks(self, step: int) -> list[str]:
        """What faults did to each message of each link in a step, (e); empty where they did nothing, or none tells."""
        found = [""] * len(self.links)
        for agent, receipts in enumerate(self.recording.receipts):
            marks, rows = receipts.marks(step), self._rows_of(agent, receipts)
            if marks is not None and len(rows) == len(marks):
                for row, mark in zip(rows.tolist(), marks, strict=True):
                    found[row] = mark
        return found

    def trail(self, step: int, length: int, most: int) -> Arrays:
        """Where target and agents' estimates were in the steps before one, oldest first.

        length: how many steps back. most: how many points. steps: (t). truth: (t, 3), m. estimates: (t, n, 4), m,
        and how strongly the path is drawn there, 0 to 1.
        """
        first, told = max(step - length, 0), self.recording.estimates
        steps = np.unique(np.linspace(first, max(step - 1, first), most).astype(np.int64))
        estimates = np.empty((0, 0, 4))
        if step:
            places = told.numbers("state", step)[:, steps, :3]
            estimates = np.concatenate([places, self._drawn(told.numbers("said", step)[:, steps])[..., None]], axis=2)
        truth = self.recording.truth.numbers("state", step)[0, steps, :3] if step else np.empty((0, 3))
        return {"steps": (steps + 1).astype(np.float64), "truth": truth, "estimates": np.moveaxis(estimates, 0, 1)}

    def _drawn(self, said: Floats) -> Floats:
        status, seconds = (said[..., NAMES.index(name)] for name in ("status", "status_seconds"))
        return strokes(status, seconds, unguided_seconds(self.plan.scenario, self.plan.first_fix_steps))

    def curves(self, since: int, until: int) -> Arrays:
        """The curves over steps since+1 to until, each (until - since,); those of a step are found once."""
        known = len(self._known[CURVES[0]])
        if until > known:
            fresh = self._curves(known, until)
            self._known = {name: np.concatenate([values, fresh[name]]) for name, values in self._known.items()}
        return {name: values[since:until] for name, values in self._known.items()}

    def _curves(self, since: int, until: int) -> Arrays:
        recording = self.recording
        honest = honest_agents(self.plan.scenario)
        states = recording.estimates.numbers("state", until)[honest, since:, :3]
        truth = recording.truth.numbers("state", until)[0, since:, :3]
        covariance = recording.estimates.numbers("covariance", until)[honest, since:].reshape(*states.shape[:2], 6, 6)
        apart = np.sum((states - mean_over_agents(states)) ** 2, axis=2)
        came, lost, late, latency = np.moveaxis(self.fresh(since, until), 2, 0)
        sent = _sum(came) + _sum(lost) + _sum(late)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = {"lost": _sum(lost) / sent, "late": _sum(late) / sent}
        return {
            "error": np.sqrt(mean_over_agents(np.asarray(np.sum((states - truth) ** 2, axis=2)))),
            "disagreement": np.sqrt(mean_over_agents(apart)),
            "claimed": np.sqrt(mean_over_agents(np.einsum("nkii->nk", covariance[:, :, :3, :3]))),
            "nis": mean_over_agents(recording.estimates.numbers("said", until)[:, since:, NAMES.index("nis")]),
            **shares,
            "latency": mean_over_agents(latency),
        }

    def fresh(self, since: int, until: int) -> Floats:
        """Messages that came, were lost and late, and their latency, of each link in each step: (e, steps, 4).

        A message that is found to be late was counted as lost before: a step's losses can then be below zero, and are
        shown as none.
        """
        # A frame, its verdict and its curves each ask for some of the same latest steps.
        told = int(np.count_nonzero(self.recording.estimates.seen(until)))
        if (until, told) != self._kept[:2] or since < self._kept[2]:
            first = max(min(since, until - _KEPT), 0)
            self._kept = until, told, first, self._fresh(first, until)
        return self._kept[3][:, since - self._kept[2] :]

    def _fresh(self, since: int, until: int) -> Floats:
        found = np.full((len(self.links), until - since, 4), np.nan)
        for agent, receipts in enumerate(self.recording.receipts):
            steps, fresh = receipts.fresh(since, until)
            rows = self._rows_of(agent, receipts)
            found[rows[:, None], steps - since - 1] = fresh.transpose(2, 0, 1)[: len(rows)]
        return np.asarray(np.maximum(found, 0.0))

    def _rows_of(self, agent: int, receipts: Receipts) -> Ints:
        """The places in `links` of the links into an agent, in the order of its counts."""
        rows = self._rows.get(agent)
        if rows is None or len(rows) != len(receipts.neighbours):
            into = self.links[:, 1] == agent
            order = {source: place for place, source in zip(np.flatnonzero(into), self.links[into, 0], strict=True)}
            rows = np.array([order[one] for one in receipts.neighbours if one in order], dtype=np.int64)
            self._rows[agent] = rows
        return rows


def _sum(values: Floats) -> Floats:
    return np.asarray(np.nansum(values, axis=0))
