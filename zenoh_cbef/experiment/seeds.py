"""One scenario under many seeds, simulated and analysed in batches on all cores; only its figures are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise

import numpy as np

from zenoh_cbef.analysis.divergence import refuse_divergence
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.cores import batches, spread
from zenoh_cbef.quantities import SEEDS
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.simulator import simulate

Progress = Callable[[int], None]
_Found = tuple[range, list[Metrics] | UserError]


def under(scenario: Scenario, more: Iterable[int]) -> list[Scenario]:
    """The scenario under its own seed and so many more."""
    return [scenario.changed(seed=(scenario.seed + one) % SEEDS) for one in more]


def analyses_of(runs: Sequence[Scenario], skip: float, progress: Progress | None = None) -> list[Analysis]:
    """Simulate runs that differ only in their seed, and analyse them. Raises UserError where a filter diverges.

    progress: gets each finished step.
    """
    with np.errstate(all="ignore"):  # What diverges is told in a sentence.
        traces = simulate(runs, progress=progress)
    for trace in traces:
        refuse_divergence(trace)
    with np.errstate(over="raise", divide="raise", invalid="raise"):
        return analyze(traces, skip)


def metrics_of(
    scenario: Scenario, seeds: int, skip: float, jobs: int, *, progress: Progress, tell: Callable[[str], None]
) -> list[Metrics]:
    """The metrics of a scenario under so many seeds from its own on, in their order: the same for any number of jobs.

    jobs: processes that simulate at a time, 0: one per core; what fits in one batch stays in this process. progress
    gets how many runs are finished. tell gets a sentence where one core has to do the work of all. Raises UserError
    for the first run that cannot be done.
    """
    found: dict[int, list[Metrics] | UserError] = {}
    finished = 0
    for batch, metrics in spread(partial(_metrics, scenario, skip), _batches(scenario, seeds, jobs), jobs, tell=tell):
        found[batch.start] = metrics
        finished += len(batch)
        progress(finished)
    runs = list[Metrics]()
    for _, metrics in sorted(found.items()):
        if isinstance(metrics, UserError):
            raise metrics
        runs += metrics
    return runs


def _batches(scenario: Scenario, seeds: int, jobs: int) -> list[range]:
    """Batches of nearly one size."""
    number = batches(scenario, seeds, jobs)
    edges = [place * seeds // number for place in range(number + 1)]
    return [range(*each) for each in pairwise(edges)]


def _metrics(scenario: Scenario, skip: float, batch: range) -> _Found:
    try:
        return batch, [one.metrics for one in analyses_of(under(scenario, batch), skip)]
    except UserError as error:
        return batch, error
