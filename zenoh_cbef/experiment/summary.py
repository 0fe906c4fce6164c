"""Medians of the runs of every cell, and whether they meet the expectations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.results import Number
from zenoh_cbef.experiment.cells import Cell, selected
from zenoh_cbef.experiment.file import Expect, Written
from zenoh_cbef.experiment.numbers import check_number
from zenoh_cbef.experiment.results import (
    CellSummary,
    Curve,
    Expectation,
    Failure,
    Judged,
    Outcome,
    Summary,
    Verdict,
)
from zenoh_cbef.experiment.statistics import LEVEL, median_interval
from zenoh_cbef.experiment.words import key_words

EXIT_STATUS: dict[Verdict, int] = {"met": 0, "not met": 1, "cannot be judged": 2}


def summarize(written: Written, cells: Sequence[Cell], outcomes: Sequence[Sequence[Outcome]]) -> Summary:
    """Cells with medians and intervals, expectations, verdict."""
    told = [_cell(cell, runs) for cell, runs in zip(cells, outcomes, strict=True)]
    expectations = [_judge(one, cells, told) for one in written.experiment.expect]
    failed = sum(cell.failed for cell in told)
    return Summary(
        experiment=written.name,
        purpose=written.purpose,
        engine=written.experiment.engine,
        base=written.experiment.base,
        varied=[one.key for one in written.experiment.vary],
        words=key_words(cells),
        level=LEVEL,
        runs=sum(cell.runs for cell in told),
        failed=failed,
        cells=told,
        expect=expectations,
        verdict=_verdict([one.verdict for one in expectations], failed),
    )


def check_expectations(written: Written, cells: Sequence[Cell]) -> None:
    """Refuse, before anything runs, an expectation that selects no cell, or of what is no number of a run."""
    for one in written.experiment.expect:
        selected(cells, one.where, one.metric)
        check_number(one.metric, "expect.metric")


def _cell(cell: Cell, runs: Sequence[Outcome]) -> CellSummary:
    good = [one for one in runs if one.error is None]
    metrics, shares = {}, {}
    for name in dict.fromkeys(name for one in good for name in one.metrics):
        values = [one.metrics.get(name) for one in good]
        known = [float(value) for value in values if isinstance(value, int | float) and not isinstance(value, bool)]
        if known:
            metrics[name] = median_interval(known)
        told = [value for value in values if isinstance(value, bool)]
        if told:
            shares[name] = told.count(True) / len(told)
    failures = [Failure(one.seed, one.error) for one in runs if one.error is not None]
    return CellSummary(
        cell=cell.index,
        values=cell.values,
        runs=len(runs),
        failed=len(failures),
        failures=failures,
        metrics=metrics,
        shares=shares,
        curve=_curve(good),
    )


def _curve(runs: Sequence[Outcome]) -> Curve | None:
    """The median over the runs at each step; None where runs differ in length."""
    curves = [one.curve for one in runs if one.curve is not None]
    if not curves or any(one.time != curves[0].time for one in curves):
        return None
    position, disagreement = (
        _medians([getattr(one, name) for one in curves]) for name in ("position_error", "disagreement")
    )
    return Curve(curves[0].time, position, disagreement)


def _medians(curves: Sequence[Sequence[Number]]) -> list[Number]:
    values = np.array(curves, dtype=np.float64)
    known = np.atleast_1d(np.isfinite(values).any(axis=0))
    middle = np.nanmedian(np.where(known, values, 0.0), axis=0)
    return [value if there else None for value, there in zip(middle.tolist(), known, strict=True)]


def _judge(expect: Expect, cells: Sequence[Cell], told: Sequence[CellSummary]) -> Expectation:
    """Compare the medians of the selected cells with the limits; a cell with a failed run cannot be judged."""
    judged = []
    for cell in selected(cells, expect.where, expect.metric):
        found = told[cell.index].metrics.get(expect.metric)
        verdict: Verdict = "cannot be judged"
        if found is not None and found.runs == told[cell.index].runs:
            verdict = "met" if expect.holds(found.median) else "not met"
        judged.append(Judged(cell.index, cell.values, verdict, found))
    verdict = _verdict([one.verdict for one in judged], 0)
    why = _why(judged, expect, told)
    return Expectation(expect.metric, expect.at_most, expect.at_least, expect.where, verdict, why, judged)


def _why(judged: Sequence[Judged], expect: Expect, told: Sequence[CellSummary]) -> str:
    """Why a verdict is not possible: no run has the metric, or runs failed."""
    known = {name for one in told for name in one.metrics}
    if known and expect.metric not in known:
        return "no run has such a number; results.csv has their names"
    if any(one.verdict == "cannot be judged" for one in judged):
        return "runs failed or have no such number"
    return ""


def _verdict(verdicts: Sequence[Verdict], failed: int) -> Verdict:
    """The worst of the expectations' verdicts; without expectations, "met" where no run failed."""
    if "not met" in verdicts:
        return "not met"
    if "cannot be judged" in verdicts or (not verdicts and failed):
        return "cannot be judged"
    return "met"
