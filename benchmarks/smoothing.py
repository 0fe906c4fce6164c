"""What smoothing gains, how near agents come to a centralised smoother, and how honest they are, 50 seeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, followed, plain_table
from benchmarks.recorded import SETS, SETTINGS
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import SmoothedPath, Trace
from zenoh_cbef.tracking.smoothing import smoothed

SEEDS = 50
LAGS: tuple[float | None, ...] = (0.2, 0.5, 1.0, 2.0, None)
"""s; None: the whole run."""

CASES: dict[str, tuple[str, ...]] = {
    "tracking": ("tracking",),
    "3 rounds": ("tracking", "consensus.rounds=3"),
    "30 % loss": ("tracking", 'fault=[{kind="loss", probability=0.3}]'),
    "60 % loss": ("tracking", 'fault=[{kind="loss", probability=0.6}]'),
    "outliers": ("outliers",),
    "bias 0.3 m, estimated": ("tracking", "sensor.bias=0.3", "filter.bias=estimate"),
    "ci": ("tracking", "filter.kind=ci"),
    "circle": ("tracking", "target.motion=circle"),
}


def run(repeats: int) -> Iterator[Table]:
    """One row per case and lag, and one per recorded set; nothing is timed."""
    del repeats
    yield _simulated()
    yield _recorded()


def _simulated() -> Table:
    rows: list[list[str]] = []
    for name, (scenario, *overrides) in followed(list(CASES.items()), "cases"):
        traces = simulate(drawn(load(scenario, overrides).scenario, SEEDS))
        lags = LAGS if name == "tracking" else (1.0, None)
        rows += [[name, _named(lag), *figures(with_lag(traces, lag))] for lag in lags]
    columns = ["case", "lag", "position", "velocity", "ratio", "worst", "NEES/d"]
    return plain_table(
        "smoothed over filtered RMSE of position and velocity; ratio to the centralised smoother with the same lag, "
        "median and worst seed; mean NEES over its ideal",
        columns,
        rows,
    )


def _recorded() -> Table:
    lags, rows = (1.0, 5.0, None), list[list[str]]()
    for name, (steps, range_std, height, _) in followed(list(SETTINGS.items()), "recorded sets"):
        if not (SETS / name).is_dir():
            rows.append([name, "not beside the repository, in ../shared/data", *[""] * (len(lags) + 1)])
            continue
        keys = {"path": SETS / name, "motion": "dataset"}
        overrides = [f"target.{key}={value}" for key, value in keys.items()]
        overrides += [f"dt={steps[0]}", f"filter.range_std={range_std}", f"filter.planar_height={height}"]
        traces = simulate([load("tracking", [*overrides, "seed=1"]).scenario])
        found = [with_lag(traces, lag)[0].metrics for lag in lags]
        values = [pick(found[0], "position_rmse"), *(pick(one, "smoothed.position_rmse") for one in found)]
        ratio = pick(found[-1], "smoothed.ratio_to_centralized")
        rows.append([name, *(f"{value:.4g}" for value in values), f"{ratio:.4f}"])
    return plain_table(
        "recorded sets: position RMSE in the plane, m, last 75 %",
        ["set", "filter", *(_named(lag) for lag in lags), "ratio to the centralised smoother"],
        rows,
    )


def _named(lag: float | None) -> str:
    return "whole run" if lag is None else f"{lag:g} s"


def with_lag(traces: Sequence[Trace], lag: float | None) -> list[Analysis]:
    """The runs smoothed with a lag, s, None for their whole length, and analysed."""
    plan, steps = traces[0].plan, len(traces[0].time)
    if plan.models:  # Of what its several models know a trace has no more than position and velocity.
        waits = {"lag_seconds": steps * plan.scenario.dt if lag is None else lag}
        again = simulate([one.scenario.changed(filter=waits) for one in traces])
        return analyze(again, strongest=False)
    waited = steps if lag is None else round(lag / plan.scenario.dt)
    states, covariances = (np.concatenate([getattr(one, name) for one in traces]) for name in _PARTS)
    excess = np.concatenate([one.diagnostics.excess for one in traces])
    found = smoothed(states, covariances, plan.plain_motion, plan.space, waited, excess=excess)
    each = (part.reshape(len(traces), -1, *part.shape[1:]) for part in found)
    paths = [SmoothedPath(path, spread, waited) for path, spread in zip(*each, strict=True)]
    done = [replace(trace, smoothed=path) for trace, path in zip(traces, paths, strict=True)]
    return analyze(done, strongest=False)


_PARTS = ("estimates", "covariances")


def figures(runs: Sequence[Analysis]) -> list[str]:
    """The columns of a row."""
    ratio = _picked(runs, "smoothed.ratio_to_centralized")
    position, velocity = (
        float(np.median(_picked(runs, f"smoothed.{name}") / _picked(runs, name)))
        for name in ("position_rmse", "velocity_rmse")
    )
    honest = float(_picked(runs, "smoothed.nees.average").mean()) / len(runs[0].trace.plan.space.kept)
    return [f"{position:.3f}", f"{velocity:.3f}", f"{np.median(ratio):.4f}", f"{ratio.max():.3f}", f"{honest:.2f}"]


def _picked(runs: Sequence[Analysis], name: str) -> Floats:
    return np.array([pick(one.metrics, name) for one in runs])
