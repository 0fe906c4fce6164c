"""Medians, least and largest metrics of many runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.arrays import Floats
from zenoh_cbef.plain import Json

SUMMARIZED = {
    "position_rmse": ("position RMSE", "m"),
    "velocity_rmse": ("velocity RMSE", "m/s"),
    "ratio_to_centralized": ("ratio to centralised", ""),
    "smoothed.position_rmse": ("smoothed position", "m"),
    "smoothed.ratio_to_centralized": ("smoothed, ratio to centralised", ""),
    "smoothed.nees.average": ("smoothed NEES", ""),
    "ratio_to_strong": ("ratio to strong yardstick", ""),
    "ratio_to_bound": ("ratio to bound", ""),
    "msee.average": ("MSEE, average", ""),
    "nees.average": ("NEES", ""),
    "nees.inside": ("NEES inside its band", "%"),
    "nis.average": ("NIS", ""),
    "nis.inside": ("NIS inside its band", "%"),
    "disagreement": ("disagreement", "m"),
}
"""The metrics of a summary, each with its words and its unit."""


@dataclass(frozen=True)
class Spread:
    """One metric of many runs; p90: 90 % of them are at or below it."""

    median: float
    p90: float
    least: float
    largest: float


@dataclass(frozen=True)
class Summary:
    """Many runs that differ in their seed. spreads: by dotted names of metrics; None where no run has it.

    share_lost, share_twin_lost: in which share of them the network, and the centralised filter, lost the target.
    """

    run: str
    filter: str
    agents: int
    steps: int
    seeds: list[int]
    share_lost: float
    share_twin_lost: float
    spreads: dict[str, Spread | None]

    def as_json(self) -> dict[str, Json]:
        """The summary as `sim --json` prints it."""
        told = asdict(self)
        spreads: dict[str, Json] = told.pop("spreads")
        return told | spreads


def pick(metrics: Metrics, name: str) -> float:
    """A metric by its dotted name; NaN where the run has none."""
    value: object = metrics
    for part in name.split("."):
        value = getattr(value, part, None)
    return float(value) if isinstance(value, int | float) else float("nan")


def summarize(runs: Sequence[Metrics]) -> Summary:
    """Median, least and largest of the metrics of runs that differ in their seed."""
    first, seeds = runs[0], [one.seed for one in runs]
    spreads = {name: _spread(np.array([pick(one, name) for one in runs])) for name in SUMMARIZED}
    lost, twin_lost = (float(np.mean([getattr(one, name) for one in runs])) for name in ("lost", "twin_lost"))
    return Summary(
        run=first.run,
        filter=first.filter,
        agents=first.agents,
        steps=first.steps,
        seeds=seeds,
        share_lost=lost,
        share_twin_lost=twin_lost,
        spreads=spreads,
    )


def _spread(values: Floats) -> Spread | None:
    known = values[np.isfinite(values)]
    if not known.size:
        return None
    p90 = float(np.quantile(known, 0.9, method="higher"))
    return Spread(float(np.median(known)), p90, float(known.min()), float(known.max()))
