"""Recorded ranges with one and the same filter setting, and what becomes of the errors when one thing is varied."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from rich.table import Table

from benchmarks.common import plain_table
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate

SETS = Path(__file__).resolve().parents[2] / "shared" / "data"
SETTINGS = {
    "lias_fast": ((0.05, 0.1), 0.07, 0.97, 0.07),
    "adip_los_B4": ((0.05, 0.1), 0.09, 1.0, 0.24),
    "plaza2": ((0.25, 0.1), 1.5, 0.0, 2.7),
}
"""Time steps (s), the usual one first, range_std (m), planar height (m), and the position RMSE to reach (m)."""

VARIED: dict[str, tuple[object, ...]] = {
    "filter.bias": ("none", "estimate", "auto"),
    "dt": (),
    "filter.acceleration_std": (1.5,),
    "filter.range_std": ("auto",),
}
"""What is varied, one at a time; dt: the set's others."""


def run(repeats: int) -> Iterator[Table]:
    """One row per set and setting that is varied, from the usual one; nothing is timed."""
    del repeats
    rows = []
    for name, (steps, range_std, height, wanted) in SETTINGS.items():
        if not (SETS / name).is_dir():
            rows.append([name, "not beside the repository, in ../shared/data", "", "", ""])
            continue
        usual = {
            "target.motion": "dataset",
            "target.path": str(SETS / name),
            "dt": steps[0],
            "filter.range_std": range_std,
            "filter.planar_height": height,
            "filter.acceleration_std": 1.0,
        }
        for key, values in VARIED.items():
            for value in values or steps[1:]:
                error, ratio = errors(usual | {key: value})
                # What is wanted is wanted of biases as they are by default.
                limit = "" if key == "filter.bias" and value != "auto" else f"{wanted}"
                rows.append([name, f"{key} = {value}", f"{error:.4f}", limit, f"{ratio:.3f}"])
    columns = ["set", "setting", "RMSE in the plane (m)", "at most", "ratio to centralised"]
    yield plain_table("recorded ranges, last 75 %", columns, rows)


def errors(settings: Mapping[str, object]) -> tuple[float, float]:
    """Position RMSE (m) and its ratio to the centralised filter's, of `tracking` with other keys."""
    scenario = load("tracking", [f"{key}={value}" for key, value in settings.items()]).scenario
    metrics = analyze(simulate([scenario]))[0].metrics
    return pick(metrics, "position_rmse"), pick(metrics, "ratio_to_centralized")
