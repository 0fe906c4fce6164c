"""Recorded ranges with one and the same filter setting, and what becomes of the errors when one thing is varied.

Then the same with silences cut into them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks import silences
from benchmarks.common import followed, plain_table
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Bools
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import Trace

SETS = Path(__file__).resolve().parents[2] / "shared" / "data"
SETTINGS = {
    "lias_fast": ((0.05, 0.1), 0.07, 0.97, 0.07),
    "adip_los_B4": ((0.05, 0.1), 0.09, 1.0, 0.24),
    "plaza2": ((0.25, 0.1), 1.5, 0.0, 1.0),
}
"""Time steps (s), the usual one first, range_std (m), planar height (m), and the position RMSE to reach (m)."""

SILENT = 2.0
"""How long after the last range errors are those of silence, s: no tracker can know then how the target moves."""

VARIED: dict[str, tuple[object, ...]] = {
    "filter.bias": ("none", "estimate", "auto"),
    "dt": (),
    "filter.acceleration_std": (1.5,),
    "filter.range_std": ("auto",),
}
"""What is varied, one at a time; dt: the set's others. filter.range_std also half and double of the set's."""

WRONG = (0.5, 2.0)
"""Times what the noise is that filters are told."""


def run(repeats: int) -> Iterator[Table]:
    """One row per set and setting that is varied, from the usual one, then one per silence; nothing is timed."""
    del repeats
    rows, silent = list[list[str]](), list[list[object]]()
    for name, (steps, range_std, height, wanted) in SETTINGS.items():
        if not (SETS / name).is_dir():
            rows.append([name, "not beside the repository, in ../shared/data", "", "", "", "", ""])
            continue
        usual = {
            "target.motion": "dataset",
            "target.path": str(SETS / name),
            "dt": steps[0],
            "filter.range_std": range_std,
            "filter.planar_height": height,
        }
        told = [factor * range_std for factor in WRONG]
        varied = [(key, value) for key, values in VARIED.items() for value in values or steps[1:]]
        for key, value in followed([*varied, *(("filter.range_std", one) for one in told)], name):
            near, far, ratio, nees = errors(usual | {key: value})
            # What is wanted is wanted of biases as they are by default, and of the noise as it is.
            limit = "" if value in told or (key == "filter.bias" and value != "auto") else f"{wanted}"
            rows.append([name, f"{key} = {value}", f"{near:.4f}", limit, number(far), f"{ratio:.3f}", f"{nees:.2f}"])
        silent += silences.rows(name, usual)
    columns = ["set", "setting", "RMSE in the plane (m)", "at most", "in silence (m)", "ratio to centralised", "NEES/d"]
    yield plain_table("recorded ranges, last 75 %", columns, rows)
    yield plain_table("silences cut into them, error in the plane (m)", silences.COLUMNS, silent)


def errors(settings: Mapping[str, object]) -> tuple[float, float, float, float]:
    """Position RMSE (m) of `tracking` with other keys within SILENT of a range, after that, the ratio of all, and NEES.

    The ratio is to the centralised filter. NEES: within SILENT of a range, over its ideal.
    """
    scenario = load("tracking", [f"{key}={value}" for key, value in settings.items()]).scenario
    found = analyze(simulate([scenario]), strongest=False)[0]
    squares = found.position_error[:, found.first :] ** 2
    silent = silent_steps(found.trace)[found.first :] & np.isfinite(squares).any(axis=0)
    near, far = (
        float(np.sqrt(np.nanmean(squares[:, chosen]))) if chosen.any() else np.nan for chosen in (~silent, silent)
    )
    nees = float(np.nanmean(found.nees[:, found.first :][:, ~silent])) / len(found.trace.plan.space.kept)
    return near, far, pick(found.metrics, "ratio_to_centralized"), nees


def silent_steps(trace: Trace) -> Bools:
    """The steps (K,) before which no agent had a range for longer than SILENT."""
    heard = np.isfinite(trace.ranges).any(axis=0)
    last = np.maximum.accumulate(np.where(heard, trace.time, -np.inf))
    return np.asarray(trace.time - last > SILENT)
