"""Scenarios that lose trackers: how often the network loses its target, and how sure it is of itself meanwhile."""

from __future__ import annotations

import importlib
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, plain_table
from benchmarks.reach import reaches
from zenoh_cbef.analysis.faulted import honest_agents
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.strong import strong
from zenoh_cbef.analysis.strong.told import told
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import SenderFault
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.status import TRACKING

CASES = Path(__file__).with_name("stress.toml")
SEEDS, FIRST = 50, 1001
SURE = 5.0
"""An agent is falsely sure that tracks, is further off than LOST allows, and than so many times what it claims."""
LOST = 3.0
"""A run is lost whose position RMSE is more than so many times that of the best centralised filter."""

COLUMNS = (
    "case", "median (m)", "p90", "max", "lost", "unaware", "twin lost", "strong lost", "ratio to strong", "worst",
    "NEES/d", "falsely sure (%)", "strong NEES/d",
)  # fmt: skip


@dataclass(frozen=True)
class Scores:
    """Of s runs of a case: position RMSE of the network and of two centralised filters, m; NEES over its ideal.

    NEES: while agents say `tracking`, where they say what their estimates are. tracking: how often they say so, of a
    run in which some agents are lost these.
    wrongly: in what share of the scored steps they say so and are falsely sure. strong_nees: of the strong yardstick
    in all scored steps.
    """

    network: Floats
    twin: Floats
    strong: Floats
    nees: Floats
    tracking: Floats
    wrongly: Floats
    strong_nees: Floats

    @property
    def best(self) -> Floats:
        """The best centralised filter's RMSE in each run."""
        return np.fmin(self.twin, self.strong)

    def lost(self, errors: Floats) -> int:
        """How many runs these RMSEs (s,) lose."""
        return int((~(errors <= LOST * self.best)).sum())

    @property
    def unaware(self) -> int:
        """How many runs the network loses though agents that are lost say `tracking` in more than half of the steps."""
        return int((~(self.network <= LOST * self.best) & (self.tracking > 0.5)).sum())

    def row(self, name: str) -> list[object]:
        """The case as a row of the table."""
        network = np.nan_to_num(self.network, nan=np.inf)
        ratio = network / self.best
        return [
            name,
            *(float(np.quantile(network, share, method="higher")) for share in (0.5, 0.9, 1.0)),
            self.lost(self.network),
            self.unaware,
            *(self.lost(errors) for errors in (self.twin, self.strong)),
            float(np.median(ratio)),
            float(ratio.max()),
            float(np.nanmean(self.nees)) if np.isfinite(self.nees).any() else None,
            100.0 * float(self.wrongly.mean()),
            float(self.strong_nees.mean()),
        ]


def cases() -> dict[str, Mapping[str, object]]:
    """All cases by name: their `set` and `wrong`."""
    found: dict[str, Mapping[str, object]] = tomllib.loads(CASES.read_text(encoding="utf-8"))
    return found


def scenario_of(case: Mapping[str, object], more: Sequence[str] = ()) -> Scenario:
    """`tracking` with the keys of a case, and more of them after those."""
    overrides = case.get("set", [])
    assert isinstance(overrides, list)
    return load("tracking", [*overrides, *more]).scenario


def scores(scenario: Scenario, wrong: str = "", seeds: int = SEEDS, first: int = FIRST) -> Scores:
    """Simulate and score the seeds of a case, from the first one on, as one batch."""
    scenarios = drawn(scenario, seeds, first)
    heard = [heard_by(Plan(one), wrong) for one in scenarios]
    with np.errstate(all="ignore"):
        traces = [believed(trace) for trace in simulate(scenarios, heard=heard)]
        runs = analyze(traces)
        twin, best_one, strong_nees = yardsticks(traces, runs[0].first)
    best = np.fmin(twin, best_one)
    return Scores(
        np.array([pick(run.metrics, "position_rmse") for run in runs]),
        twin,
        best_one,
        np.array([_nees(run) for run in runs]),
        np.array([_tracking(*each) for each in zip(runs, best, strict=True)]),
        np.array([_wrongly(*each) for each in zip(runs, best, strict=True)]),
        strong_nees,
    )


def yardsticks(traces: Sequence[Trace], first: int) -> tuple[Floats, Floats, Floats]:
    """RMSE of the twin and of the strong yardstick in each run: root mean square over agents of what reaches each.

    And the strong one's NEES over its ideal.
    """
    reached = [(run, one) for run, trace in enumerate(traces) for one in reaches(trace)]
    heard = [one.trace for _, one in reached]
    states, covariances = strong(*told(heard, len(heard[0].time)))
    twin = np.array([pick(run.metrics, "centralized.position_rmse") for run in analyze(heard)])
    run, share = np.array([run for run, _ in reached]), np.array([float(len(one.agents)) for _, one in reached])

    def over_agents(values: Floats) -> Floats:
        return np.asarray(np.bincount(run, share * values) / np.bincount(run, share))

    error = _errors(heard, states, first)
    whitened = np.linalg.solve(covariances[:, first:, : error.shape[2], : error.shape[2]], error[..., None])[..., 0]
    nees = np.mean(np.sum(error * whitened, axis=2), axis=1) / error.shape[2]
    square = np.mean(np.sum(error[:, :, : error.shape[2] // 2] ** 2, axis=2), axis=1)
    return np.sqrt(over_agents(twin**2)), np.sqrt(over_agents(square)), over_agents(nees)


def heard_by(plan: Plan, wrong: str) -> Heard:
    """What receivers measure that are wrong in a way of which the scenario says nothing."""
    heard = heard_in(plan, make_world(plan.scenario))
    if not wrong:
        return heard
    ranges = heard.ranges.copy()
    count, steps = ranges.shape
    chance = np.random.default_rng(plan.scenario.seed)
    if wrong == "liar":
        ranges[min(2, count - 1)] += 5.0
    elif wrong == "bursts":
        for agent in (0, count - 1):
            for first in chance.integers(0, steps, max(1, steps // 60)):
                ranges[agent, first : first + 20] += 10.0
    else:
        ranges += 30.0 * (chance.random(ranges.shape) < 0.4)
    return Heard(heard.positions, ranges, heard.age)


def believed(trace: Trace) -> Trace:
    """A run without the ranges of agents that lie: a centralised filter believes them no more than honest agents do."""
    liars = {agent for fault in trace.scenario.fault if isinstance(fault, SenderFault) for agent in fault.agents}
    lies = np.isin(np.arange(len(trace.ranges)), list(liars))
    return replace(trace, ranges=np.where(lies[:, None], np.nan, trace.ranges)) if liars else trace


def _errors(traces: Sequence[Trace], states: Floats, first: int) -> Floats:
    """Of position and velocity in the scored steps, (runs, steps, d)."""
    kept = traces[0].plan.space.kept
    truth = np.stack([trace.truth for trace in traces])[:, first:, kept]
    return np.asarray(states[:, first:, : len(kept)] - truth)


def _nees(run: Analysis) -> float:
    """Mean NEES over its ideal value, of agents that count in the scored window while they track.

    NaN where they never do, infinite where an estimate is not finite.
    """
    if run.metrics.status is not None:
        average = run.metrics.status["tracking"].nees
        return float("nan") if average is None else average / len(run.trace.plan.space.kept)
    found = run.metrics.nees
    average = None if found is None else found.average
    return float("inf") if average is None else average / len(run.trace.plan.space.kept)


def _tracking(run: Analysis, best: float) -> float:
    """In what share of the scored steps agents say that they track, of those that are lost; all where they do not say.

    Of agents that are in one network all are lost or none, of groups some.
    """
    honest, error = honest_agents(run.trace.scenario), run.position_error[:, run.first :]
    lost = honest & ~(np.sqrt(np.mean(error**2, axis=1)) <= LOST * best)
    said = run.trace.diagnostics.status[lost if lost.any() else honest, run.first :]
    return float((said == TRACKING).mean()) if np.isfinite(said).any() else 1.0


def _wrongly(run: Analysis, best: float) -> float:
    """In what share of the scored steps agents say that they track, or do not say, and are falsely sure."""
    axes = len(run.trace.plan.space.kept) // 2
    kept = list(run.trace.plan.space.kept[:axes])
    honest = honest_agents(run.trace.scenario)
    variance = run.trace.covariances[honest, run.first :][:, :, kept, kept].sum(axis=2)
    error, said = run.position_error[honest, run.first :], run.trace.diagnostics.status[honest, run.first :]
    off = (error > LOST * best) & (error > SURE * np.sqrt(variance))
    return float((off & (np.isnan(said) | (said == TRACKING))).mean())


def run(  # noqa: PLR0917 - one for each option
    repeats: int,
    case: str | None = None,
    seeds: int = SEEDS,
    search: int = 0,
    first: int = FIRST,
    set: Sequence[str] = (),  # noqa: A002 - the option's name
) -> Iterator[Table]:
    """One row per case; nothing is timed. search: try so many random cases instead, and keep what loses the network.

    set: keys of the scenario, KEY=VALUE, that hold in all cases.
    """
    del repeats
    if search:
        finder = importlib.import_module("benchmarks.stress_search")
        for found in finder.search(search, seed=first):
            name = finder.keep(found) or "known"
            yield plain_table(f"found: {found.case}", COLUMNS, [found.scores.row(name)])
        return
    known = cases()
    if case is not None and case not in known:
        raise UserError(f"there is no case {case!r} in {CASES.name}; there are {', '.join(known)}")
    for name in known if case is None else [case]:
        found = scores(scenario_of(known[name], set), str(known[name].get("wrong", "")), seeds, first)
        which = ", ".join([name, *set, f"{len(found.network)} seeds from {first}"])
        yield plain_table(f"stress: {which}", COLUMNS, [found.row(name)])
