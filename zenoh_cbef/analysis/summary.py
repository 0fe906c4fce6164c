"""Medians, least and largest metrics of many runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

SUMMARIZED = (
    "position_rmse",
    "velocity_rmse",
    "ratio_to_centralized",
    "msee.average",
    "nees.average",
    "nees.inside",
    "nis.average",
    "nis.inside",
    "disagreement",
)


def pick(metrics: dict[str, Any], name: str) -> float:
    """A metric by its dotted name; NaN where the run has none."""
    value: Any = metrics
    for part in name.split("."):
        value = value.get(part) if isinstance(value, dict) else None
    return float("nan") if value is None else float(value)


def summarize(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Median, least and largest of the metrics of runs that differ in their seed."""
    summary: dict[str, Any] = {name: runs[0][name] for name in ("run", "filter", "agents", "steps")}
    summary["seeds"] = [one["seed"] for one in runs]
    for name in SUMMARIZED:
        values = np.array([pick(one, name) for one in runs])
        known = values[np.isfinite(values)]
        summary[name] = (
            {"median": float(np.median(known)), "least": float(known.min()), "largest": float(known.max())}
            if known.size
            else None
        )
    return summary
