"""How sure filters of several motions are of themselves, where the target never, rarely or often changes its motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, plain_table
from benchmarks.stress import FIRST, cases, scenario_of
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.strong import strong
from zenoh_cbef.analysis.strong.told import told
from zenoh_cbef.analysis.yardsticks import centralized_run
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.motion import turn_rate_change
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.reference import stacked

SEEDS = 10
CASES = (
    *("circle", "small-circle", "wide-circle-two-rounds", "wide-circle-on-a-path"),
    *("straight-and-short-steps", "sharp-turns"),
)
RULES = {"as assumed": [], "filter.defaults = 13": ["filter.defaults=13"]}
CALM: dict[str, tuple[tuple[float, ...], float | str]] = {
    "several calm noises": ((0.01, 0.001, 0.0001), "auto"),
    "a chance of 0.03": ((0.002,), 0.03),
    "a chance of 0.003": ((0.002,), 0.003),
    "hardly any noise, a chance of 0.00005": ((0.00001,), 0.00005),
}
"""Tracking indices of calm motions, each of them straight and in turns, and the chance to leave a motion in a step."""

ASSUMED = 0.01
"""The index of calm motions to which the change of a turn's rate belongs."""

COLUMNS = ("case", "filter", "RMSE (m)", "NEES/d", "of the position", "of the velocity")


def keys(plan: Plan, noises: Sequence[float], switching: float | str) -> list[str]:
    """The motions that a plan assumes with other calm ones, whose rates change less, too, and another `switching`."""
    unit, change = plan.range_std / plan.scenario.dt**2, turn_rate_change(plan.scenario) or 0.0
    calm = [
        f'{{motion="{kind}",acceleration_std={index * unit!r},turn_rate_change={change * index / ASSUMED!r}}}'
        for kind in ("ncv", "turn")
        for index in noises
    ]
    _, _, *between, most = plan.models
    agile = [
        f'{{motion="{kind}",acceleration_std={one.acceleration_std!r}}}'
        for kind, one in [*(("ncv", one) for one in between), ("jump", most)]
    ]
    return ["filter.motion=imm", f"filter.models=[{','.join(calm + agile)}]", f"filter.switching={switching}"]


def run(repeats: int, seeds: int = SEEDS, first: int = FIRST) -> Iterator[Table]:
    """One table for each case; nothing is timed."""
    del repeats
    for case in CASES:
        one = scenario_of(cases()[case])
        with np.errstate(all="ignore"):
            traces = simulate(drawn(one, seeds, first))
            begin, steps = analyze(traces[:1])[0].first, len(traces[0].time)
            truth = np.stack([trace.truth for trace in traces])[:, begin:]
            said = [np.stack([getattr(trace, part)[0] for trace in traces]) for part in ("estimates", "covariances")]
            rows = [_row(case, "network, agent 0", said, truth, begin)]
            others = {name: keys(traces[0].plan, *calm) for name, calm in CALM.items()}
            for name, sets in {**RULES, **others}.items():
                plan = Plan(scenario_of(cases()[case], sets))
                beliefs = centralized_run([replace(trace, plan=plan) for trace in traces], steps)
                rows.append(_row(case, f"centralised, {name}", stacked(plan.space, beliefs), truth, begin))
            rows.append(_row(case, "strong", strong(*told(traces, steps)), truth, begin))
        yield plain_table(f"several motions: {case}, {seeds} seeds from {first}", COLUMNS, rows)


def _row(case: str, name: str, said: Sequence[Floats], truth: Floats, begin: int) -> list[object]:
    error, covariance = said[0][:, begin:, :6] - truth, said[1][:, begin:, :6, :6]
    rmse = np.sqrt((error[:, :, :3] ** 2).sum(axis=2).mean(axis=1))
    parts = slice(0, 6), slice(0, 3), slice(3, 6)
    return [case, name, float(np.median(rmse)), *(_nees(error[:, :, one], covariance[:, :, one, one]) for one in parts)]


def _nees(error: Floats, covariance: Floats) -> float:
    """Mean NEES over its ideal."""
    whitened = np.linalg.solve(covariance, error[..., None])[..., 0]
    return float(np.mean(np.sum(error * whitened, axis=-1)) / error.shape[-1])
