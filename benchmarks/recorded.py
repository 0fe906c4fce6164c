"""Recorded ranges with one and the same filter setting: errors with biases left alone, estimated, and weighed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from rich.table import Table

from benchmarks.common import plain_table
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SETS = Path(__file__).resolve().parents[2] / "shared" / "data"
SETTINGS = {
    "lias_fast": (0.05, 0.07, 0.97, 0.07),
    "adip_los_B4": (0.05, 0.09, 1.0, 0.24),
    "plaza2": (0.25, 1.5, 0.0, 2.7),
}
"""Time step (s), range_std (m), planar height (m), and the position RMSE to reach (m)."""


def run(repeats: int) -> Iterator[Table]:
    """One row per set and setting of filter.bias; nothing is timed."""
    del repeats
    rows = []
    for name, (dt, range_std, height, wanted) in SETTINGS.items():
        if not (SETS / name).is_dir():
            rows.append([name, "not beside the repository, in ../shared/data", "", "", ""])
            continue
        for bias in ("none", "estimate", "auto"):
            overrides = {
                "target.motion": "dataset",
                "target.path": str(SETS / name),
                "dt": dt,
                "filter.range_std": range_std,
                "filter.planar_height": height,
                "filter.acceleration_std": 1.5,
                "filter.bias": bias,
            }
            scenario = load("tracking", [f"{key}={value}" for key, value in overrides.items()]).scenario
            metrics = analyze(simulate([scenario]))[0].metrics
            error, ratio = metrics["position_rmse"], metrics["ratio_to_centralized"]
            rows.append([name, bias, f"{error:.4f}", f"{wanted}" if bias == "auto" else "", f"{ratio:.3f}"])
    columns = ["set", "filter.bias", "position RMSE (m)", "at most", "ratio to centralised"]
    yield plain_table("recorded ranges, last 75 %", columns, rows)
