"""The tables of an experiment: all metrics of each cell, or one metric over the grid of two varied keys."""

from __future__ import annotations

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.figures import written_value
from zenoh_cbef.experiment.results import Summary
from zenoh_cbef.experiment.statistics import Interval
from zenoh_cbef.experiment.words import MEASURED, metric_words
from zenoh_cbef.pages.parts import Table

FITTING = 1
"""How many metrics of a table, with their intervals, fit a page of LaTeX beside two varied keys."""


def results_table(summary: Summary, most: int | None = None) -> Table:
    """A row for each cell, a column for each metric that figures show, or the first `most` of them."""
    metrics = [one.metric for one in MEASURED if any(one.metric in cell.metrics for cell in summary.cells)][:most]
    rows = [
        [
            *(written_value(cell.values[key]) for key in summary.varied),
            f"{cell.runs - cell.failed} of {cell.runs}",
            *(interval(cell.metrics.get(name)) for name in metrics),
        ]
        for cell in summary.cells
    ]
    caption = f"{_medians(summary)} All metrics of all runs: results.csv."
    return Table(caption, [*map(summary.words.__getitem__, summary.varied), "runs", *map(metric_words, metrics)], rows)


def metric_table(summary: Summary, metric: str) -> Table:
    """One metric: with two varied keys the second one goes across. Raises UserError where no run has it."""
    known = dict.fromkeys(name for cell in summary.cells for name in cell.metrics)
    if metric not in known:
        raise UserError(f"no run has a number {metric!r}; there are {', '.join(known)}")
    caption = f"{metric_words(metric)}. {_medians(summary)}"
    if len(summary.varied) != 2:
        rows = [
            [*(written_value(cell.values[key]) for key in summary.varied), interval(cell.metrics.get(metric))]
            for cell in summary.cells
        ]
        return Table(caption, [*map(summary.words.__getitem__, summary.varied), metric_words(metric)], rows)
    down, across = summary.varied
    grid: dict[str, dict[str, str]] = {}
    for cell in summary.cells:
        row = grid.setdefault(written_value(cell.values[down]), {})
        row[written_value(cell.values[across])] = interval(cell.metrics.get(metric))
    columns = list(dict.fromkeys(name for row in grid.values() for name in row))
    texts = all(isinstance(cell.values[across], str) for cell in summary.cells)
    heads = columns if texts else [f"{summary.words[across]} {name}" for name in columns]
    return Table(caption, [summary.words[down], *heads], [[name, *row.values()] for name, row in grid.items()])


def interval(found: Interval | None) -> str:
    """A median, in brackets its interval."""
    return "-" if found is None else f"{found.median:.4g} ({found.low:.4g} to {found.high:.4g})"


def _medians(summary: Summary) -> str:
    return f"Medians over the seeds, in brackets their {summary.level:.0%} bootstrap intervals."
