"""What an experiment finds, as types: the outcome of a run, and the summary that summary.json holds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Literal

from zenoh_cbef.analysis.results import Number
from zenoh_cbef.experiment.statistics import Interval
from zenoh_cbef.plain import Json

Verdict = Literal["met", "not met", "cannot be judged"]


@dataclass(frozen=True)
class Curve:
    """A run over time, or the median of a cell's runs, at no more than 100 steps: s, and errors in m."""

    time: Sequence[Number]
    position_error: Sequence[Number]
    disagreement: Sequence[Number]


@dataclass(frozen=True)
class Outcome:
    """What became of a run: its scalar metrics by dotted names and its curve, or the error that it ended with."""

    seed: int
    metrics: Mapping[str, str | float | None] = field(default_factory=dict)
    curve: Curve | None = None
    error: str | None = None


@dataclass(frozen=True)
class Failure:
    """A run that failed, and why."""

    seed: int
    error: str


@dataclass(frozen=True)
class CellSummary:
    """The runs of one cell. values: of the varied keys. metrics: by dotted names, of the runs that have them.

    shares: of what is true or false of a run (lost, twin_lost, complete ...), in which share of the runs it is true.
    """

    cell: int
    values: Mapping[str, Json]
    runs: int
    failed: int
    failures: Sequence[Failure]
    metrics: Mapping[str, Interval]
    shares: Mapping[str, float]
    curve: Curve | None


@dataclass(frozen=True)
class Judged:
    """What was found of an expectation in one cell, None where no run has such a number."""

    cell: int
    values: Mapping[str, Json]
    verdict: Verdict
    found: Interval | None

    def as_json(self) -> dict[str, Json]:
        """The judgement as summary.json has it: what was found beside the verdict."""
        told = asdict(self)
        found = told.pop("found") or {}
        return told | found


@dataclass(frozen=True)
class Expectation:
    """A limit, the cells that it is of, and whether they keep it; why: where no verdict is possible."""

    metric: str
    at_most: float | None
    at_least: float | None
    where: Mapping[str, Json]
    verdict: Verdict
    why: str
    cells: Sequence[Judged]

    @property
    def limits(self) -> dict[str, float]:
        """The limits that were given, by their keys."""
        both = {"at_most": self.at_most, "at_least": self.at_least}
        return {name: limit for name, limit in both.items() if limit is not None}

    def as_json(self) -> dict[str, Json]:
        """The expectation as summary.json has it."""
        judged = [one.as_json() for one in self.cells]
        rest = {"where": self.where, "verdict": self.verdict, "why": self.why, "cells": judged}
        return {"metric": self.metric, **self.limits, **rest}


@dataclass(frozen=True)
class Summary:
    """An experiment in its medians. varied: keys, words: of each. level: of the intervals. failed: how many runs."""

    experiment: str
    purpose: str
    engine: str
    base: str
    varied: Sequence[str]
    words: Mapping[str, str]
    level: float
    runs: int
    failed: int
    cells: Sequence[CellSummary]
    expect: Sequence[Expectation]
    verdict: Verdict

    def as_json(self) -> dict[str, Json]:
        """The summary as summary.json has it: without curves, which are in the figures."""
        cells = [{name: value for name, value in asdict(one).items() if name != "curve"} for one in self.cells]
        return {**vars(self), "cells": cells, "expect": [one.as_json() for one in self.expect]}
