"""How a network begins: whether it knows how far off it is, and how close it comes to the bound, from step 1 on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rich.table import Table

from benchmarks.common import drawn, plain_table
from zenoh_cbef.analysis.yardsticks import yardsticks
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SEEDS, FIRST = 200, 5001
STEPS = (1, 2, 3, 5, 8, 10, 15, 20, 25)
CASES = {
    "tracking": ("tracking", ()),
    "far-start-told": ("tracking", ("filter.initial_position=[50,0,0]", "filter.initial_position_std=50")),
    "far-start": ("tracking", ("filter.initial_position=[7,7,7]",)),
    "three-agents": ("tracking", ("agents.count=3",)),
    "outliers, 10 %": ("outliers", ()),
    "outliers, 30 %": ("outliers", ("sensor.outlier_probability=0.3",)),
}
"""Scenarios by name; the target of the third is 12 m from where all agents believe it to be, within 1 m."""


def started(scenario: Scenario, seeds: int) -> tuple[Floats, Floats]:
    """NEES over its ideal and MSEE over the bound's in steps 1 to K, (s, K): agents' mean in each of s runs.

    The MSEE is the mean of squared errors of position and velocity of all steps so far; the bound's the same of
    what the posterior Cramer-Rao bound allows, which starts from all agents' guesses.
    """
    with np.errstate(all="ignore"):
        traces = simulate(drawn(scenario, seeds, FIRST))
    nees, errors, least = [], [], []
    kept = traces[0].plan.space.kept
    for trace, known in zip(traces, yardsticks(traces), strict=True):
        off = (trace.estimates - trace.truth)[:, :, kept]
        covariance = trace.covariances[:, :, kept[:, None], kept]
        nees.append(np.sum(off * np.linalg.solve(covariance, off[..., None])[..., 0], axis=2).mean(axis=0) / len(kept))
        errors.append(np.sum(off**2, axis=2).mean(axis=0))
        least.append(np.trace(known.bound[:, kept[:, None], kept], axis1=1, axis2=2))
    return np.array(nees), np.cumsum(errors, axis=1) / np.cumsum(least, axis=1).mean(axis=0)


def run(repeats: int, seeds: int = SEEDS) -> Iterator[Table]:
    """Two tables; nothing is timed."""
    del repeats
    columns = ("case", "filter.defaults", *(f"step {step}" for step in STEPS))
    nees, msee = [], []
    for name, (base, keys) in CASES.items():
        for rules in (3, 4):
            scenario = load(base, [*keys, f"filter.defaults={rules}", f"steps={max(STEPS)}"]).scenario
            found = started(scenario, seeds)
            shown = [name, str(rules)]
            nees.append([*shown, *(float(found[0][:, step - 1].mean()) for step in STEPS)])
            msee.append([*shown, *(float(found[1][:, step - 1].mean()) for step in STEPS)])
    yield plain_table(f"NEES over its ideal, mean of {seeds} seeds from {FIRST}", columns, nees)
    yield plain_table(f"MSEE from step 1 on over that of the bound, {seeds} seeds from {FIRST}", columns, msee)
