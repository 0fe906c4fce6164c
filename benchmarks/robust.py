"""Errors with failing sensors and agents, over 50 seeds, in simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from benchmarks.common import Row, analyses, below, results
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.reference import centralized_beliefs, each_step

SEEDS, GRAPHS = 50, 1000
AGENTS = 6
LIES = {
    "5 m off": 'mode="constant"',
    "0.1 m off": 'mode="constant", magnitude=0.1',
    "random, 5 m": 'mode="random"',
    "drift, 0.1 m/s": 'mode="drift", magnitude=0.1',
    "ten times as certain": 'mode="scale", magnitude=10.0',
    "messages of 10 steps ago": 'mode="replay"',
}
RECEIVERS = {
    "nothing wrong": "fault=[]",
    **{
        name: f"fault=[{{kind={keys}, agents={agents}, from=8.0, until=20.0}}]"
        for name, keys, agents in (
            ("bias 2 m", '"sensor-bias", bias=2.0', [3]),
            ("bias 0.5 m", '"sensor-bias", bias=0.5', [3]),
            ("stuck", '"sensor-stuck"', [3]),
            ("spikes, every range", '"sensor-spikes", probability=1.0', [3]),
            ("spikes, 30 %", '"sensor-spikes", probability=0.3', [3]),
            ("two, bias 2 m", '"sensor-bias", bias=2.0', [1, 3]),
        )
    },
    "all, 30 % outliers": "sensor.outlier_probability=0.3",
    "none, but a wrong start": "filter.initial_position=[8.0, -8.0, 4.0]",
}
GIVEN = "filter.start=given"
PLAIN = ("consensus.isolate=false",)
DENSE = ("agents.count=10", "network.probability=0.8")


def spread(values: Floats) -> str:
    """Median and worst."""
    return f"{number(float(np.median(values)))}, worst {number(float(values.max()))}"


def ratios(runs: Sequence[Analysis]) -> Floats:
    """Position RMSE over that of the centralised filter, per seed; infinite where no estimate was finite."""
    return np.array([run.metrics.ratio_to_centralized or np.inf for run in runs])


def liars(seeds: int = SEEDS) -> Iterator[Row]:
    """One agent of ten sends wrong values throughout; the other nine against a filter that has all ten ranges."""
    clean = ratios(analyses("tracking", [*DENSE, "consensus.trim=1"], seeds=seeds))
    yield Row("no liar, F = 1", spread(clean))
    for name, keys in LIES.items():
        fault = f'fault=[{{kind="byzantine", agents=[3], {keys}}}]'
        plain, trimmed = (
            ratios(analyses("tracking", [*DENSE, *PLAIN, f"consensus.trim={trim}", fault], seeds=seeds))
            for trim in (0, 1)
        )
        worst = f", worst {number(float(trimmed.max()))}; without trimming {number(float(np.median(plain)))}"
        yield below(f"{name}, F = 1, median", float(np.median(trimmed)), 1.3, note=worst)


def sparse_liars(seeds: int = SEEDS) -> Iterator[Row]:
    """One agent of six lies throughout, density 0.5; the other five against a filter that has their five ranges."""
    drawn = load("tracking").scenario
    parted = [not _joined(network.edges(drawn.changed(seed=seed))) for seed in range(1, GRAPHS + 1)]
    yield Row(f"graphs of {GRAPHS} that agent 3 parts", f"{np.mean(parted):.1%}")
    for name, keys in LIES.items():
        fault = f'fault=[{{kind="byzantine", agents=[3], {keys}}}]'
        for way, more in (("plain", PLAIN), ("F = 1", (*PLAIN, "consensus.trim=1")), ("isolated", ())):
            runs = analyses("tracking", [*more, fault], seeds=seeds)
            ratio = np.array([run.metrics.position_rmse or np.inf for run in runs]) / _honest_central(runs)
            split = np.array([not _joined(run.trace.edges) for run in runs])
            note = f"; below 1.3 in {(ratio < 1.3).sum()}, the liar parts the others in {split.sum()}"
            whole = f"{note}, worst of the rest {number(float(ratio[~split].max()))}"
            yield Row(f"{name}, {way}: median", spread(ratio) + whole)


def _honest_central(runs: Sequence[Analysis]) -> Floats:
    """Position RMSE of a centralised filter without the ranges of agent 3, per seed."""
    plan = runs[0].trace.plan
    seen = {part: np.stack([getattr(run.trace, part) for run in runs]) for part in ("positions", "ranges", "age")}
    seen["ranges"][:, 3] = np.nan
    starts = np.stack([np.delete(run.trace.initial, 3, axis=0).mean(axis=0) for run in runs])
    initial = Belief(starts, np.broadcast_to(plan.initial_covariance, (len(runs), 6, 6)))
    steps = each_step(**seen, range_std=plan.range_std)
    beliefs = centralized_beliefs(initial, plan.motion, plan.space, steps, xi=np.inf)
    places = np.stack([belief.state[:, :3] for belief in beliefs], axis=1)
    errors = places - np.stack([run.trace.truth[:, :3] for run in runs])
    return np.asarray(np.sqrt((errors[:, runs[0].first :] ** 2).sum(axis=2).mean(axis=1)))


def _joined(edges: graph.Edges) -> bool:
    """Whether the agents other than 3 reach each other without it."""
    return len(graph.components(AGENTS, edges[(edges != 3).all(axis=1)])) == 2


def outliers(seeds: int = SEEDS) -> Iterator[Row]:
    """Ranges too long by an exponential error of 5 m on average, against a centralised filter on clean ranges."""
    plain = analyses("outliers", ["sensor.outlier_probability=0.0", "filter.kind=icf"], seeds=seeds)
    clean = np.array([pick(run.metrics, "centralized.position_rmse") for run in plain])
    for share, limit, worst in ((0.1, 1.2, None), (0.3, 1.8, 4.0)):
        for saturation in ("redescending", "bounded"):
            keys = [f"sensor.outlier_probability={share}", f"filter.saturation={saturation}"]
            runs = analyses("outliers", keys, seeds=seeds)
            factor = np.array([run.metrics.position_rmse or np.inf for run in runs]) / clean
            nees = float(np.median([pick(run.metrics, "nees.average") for run in runs]))
            name = f"{share:.0%} outliers, {saturation}"
            yield below(f"{name}, median", float(np.median(factor)), limit, note=f"; NEES {number(nees)}")
            yield (
                Row(f"{name}, worst seed", number(float(factor.max())))
                if worst is None
                else below(f"{name}, worst seed", float(factor.max()), worst)
            )


def lost(seeds: int = SEEDS) -> Iterator[Row]:
    """All agents begin 12 m from the target and believe it within 1 m."""
    for share in (0.0, 0.3):
        for recovery in ("false", "true"):
            keys = [
                "filter.initial_position=[8.0, -8.0, 4.0]",
                GIVEN,
                f"sensor.outlier_probability={share}",
            ]
            runs = analyses("tracking", [*keys, f"filter.recovery={recovery}"], seeds=seeds)
            error = np.array([np.sqrt((run.position_error**2).mean(axis=0)) for run in runs])
            name = f"{share:.0%} outliers, recovery = {recovery}"
            yield Row(f"{name}: after 3 s, m", spread(error[:, 29]))
            yield Row(f"{name}: after 10 s, m", spread(error[:, 99]))
            yield Row(f"{name}: seeds beyond 1 m in the end", str(int((error[:, -1] > 1.0).sum())))


def cut_off(seeds: int = SEEDS) -> Iterator[Row]:
    """Agent 2 of six hears no other agent, and no other agent hears it, from 8 s to 20 s."""
    fault = 'fault=[{kind="loss", probability=1.0, links="agent:2", from=8.0, until=20.0}]'
    runs, others = analyses("tracking", [fault], seeds=seeds), [0, 1, 3, 4, 5]
    yield Row("NEES while cut off (ideal 6)", spread(np.array([run.nees[2, 100:199].mean() for run in runs])))
    yield Row("NEES afterwards", spread(np.array([run.nees[2, 210:].mean() for run in runs])))
    for name, agents in (("the agent", [2]), ("the others", others)):
        rmse = [np.sqrt((run.position_error[agents, 100:199] ** 2).mean()) for run in runs]
        yield Row(f"position RMSE of {name} meanwhile, m", spread(np.array(rmse)))


def wrong_receiver(seeds: int = SEEDS) -> Iterator[Row]:
    """Receivers of six agents are wrong from 8 s to 20 s: with distrust against without."""
    for name, keys in RECEIVERS.items():
        false, true = (
            np.array(
                [
                    run.position_error
                    for run in analyses("tracking", [keys, GIVEN, f"filter.distrust={value}"], seeds=seeds)
                ]
            )
            for value in ("false", "true")
        )
        for when, steps in (("during", slice(79, 199)), ("after", slice(199, None))):
            before, now = (np.sqrt((error[:, :, steps] ** 2).mean(axis=(1, 2))) for error in (false, true))
            beyond = f"; beyond 1 m: {(now > 1.0).sum()} seeds in place of {(before > 1.0).sum()}"
            yield Row(f"{name}, {when}", spread(now / before) + beyond)


def late(seeds: int = SEEDS) -> Iterator[Row]:
    """All messages take nearly a step, or a step on average: own value in place, against old estimates predicted."""
    own, lagged = "filter.kind=ci", ["filter.kind=ci", "consensus.lag=1"]
    settings = {
        "sicf": [],
        "ci": [own],
        "ci, lag 1, one round": [*lagged, "consensus.rounds=1"],
        "ci, lag 1, ten rounds": lagged,
        "ci, lag 2, one round": [own, "consensus.lag=2", "consensus.rounds=1"],
    }
    yield Row("no delay, ci, one round: position RMSE, m", spread(_rmse([own, "consensus.rounds=1"], seeds)[0]))
    for name, keys in {
        "90 ms": "milliseconds=90.0",
        "exponential": 'milliseconds=100.0, distribution="exponential"',
    }.items():
        for setting, overrides in settings.items():
            error, nees = _rmse([f'fault=[{{kind="delay", {keys}}}]', *overrides], seeds)
            yield Row(f"{name}, {setting}: position RMSE, m", f"{spread(error)}; NEES {number(float(np.median(nees)))}")


def _rmse(keys: Sequence[str], seeds: int) -> tuple[Floats, Floats]:
    metrics = [run.metrics for run in analyses("tracking", keys, seeds=seeds)]
    errors, nees = ([pick(one, name) for one in metrics] for name in ("position_rmse", "nees.average"))
    return np.array(errors), np.array(nees)


def run(repeats: int) -> Iterator[Table]:
    """Deterministic, so `repeats` is not used."""
    del repeats
    yield results(f"outliers: position RMSE / clean centralised, {SEEDS} seeds", list(outliers()))
    yield results(f"a wrong start: position RMSE, {SEEDS} seeds", list(lost()))
    yield results(f"an agent cut off, {SEEDS} seeds", list(cut_off()))
    yield results(
        f"receivers that stay wrong: position RMSE with distrust / without, {SEEDS} seeds", list(wrong_receiver())
    )
    yield results(f"messages that come steps late, {SEEDS} seeds", list(late()))
    yield results(f"an agent of ten lies: position RMSE / centralised, {SEEDS} seeds", list(liars()))
    yield results(f"an agent of six lies: position RMSE / honest centralised, {SEEDS} seeds", list(sparse_liars()))
