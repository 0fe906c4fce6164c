"""Recorded ranging data tracked by real processes."""

from pathlib import Path

import numpy as np
import pytest

SETS = Path(__file__).parents[4] / "shared" / "data"
ERRORS = {"lias_fast": 0.1, "adip_los_B4": 0.13, "plaza2": 0.8}
"""Position RMSE of the first 120 steps, m: the centralised filter's may be luckier by a tenth, or worse by a third."""

RECORDED = {  # dt, range_std, planar height: what the sets' own description says
    "lias_fast": ("0.05", "0.07", "0.97"),
    "adip_los_B4": ("0.1", "0.09", "1.0"),
    "plaza2": ("0.25", "1.5", "0.0"),
}


def track(world, folder: Path, settings: tuple[str, str, str], steps: int) -> dict:
    dt, std, height = settings
    overrides = {
        "name": world.run,
        "target.motion": "dataset",
        "target.path": str(folder),
        "dt": dt,
        "steps": str(steps),
        "network.graph": "ring",
        "consensus.rounds": "4",
        "filter.range_std": std,
        "filter.planar_height": height,
        "filter.acceleration_std": "1.0",
    }
    options = [part for key, value in overrides.items() for part in ("--set", f"{key}={value}")]
    world.done("run", "tracking", *options, "--run", world.run, "--log", str(world.log), "--no-report")
    world.verdict()
    return world.metrics()


@pytest.mark.skipif(not SETS.is_dir(), reason="the recorded sets are not beside the project")
@pytest.mark.parametrize("name", RECORDED)
def test_a_recorded_set_runs_end_to_end(world, name):
    metrics = track(world, SETS / name, RECORDED[name], steps=120)
    assert metrics["steps"] == 120
    assert metrics["position_rmse"] < ERRORS[name]


def small_set(folder: Path) -> Path:
    """Four anchors with sparse ids around a target that walks a circle at a known height."""
    rng = np.random.default_rng(4)
    anchors = {3: (0.0, 0.0, 2.0), 17: (10.0, 0.0, 2.0), 40: (10.0, 10.0, 2.0), 99: (0.0, 10.0, 2.0)}
    times = np.arange(0.0, 8.0, 0.02)
    path = np.stack([5 + 2 * np.cos(0.5 * times), 5 + 2 * np.sin(0.5 * times), np.full_like(times, 1.0)], axis=1)
    lines = []
    for t, place in zip(times, path, strict=True):
        label = list(anchors)[int(rng.integers(4))]
        distance = np.linalg.norm(place - anchors[label])
        lines.append(f"{t:.3f},{label},{distance + rng.normal(0, 0.05):.4f}")
    folder.mkdir()
    rows = "\n".join(f"{label},{x},{y},{z}" for label, (x, y, z) in anchors.items())
    (folder / "anchors.csv").write_text("id,x,y,z\n" + rows + "\n")
    (folder / "ranges.csv").write_text("t,anchor_id,range\n" + "\n".join(lines) + "\n")
    truth = "\n".join(f"{t:.3f},{x:.4f},{y:.4f},{z:.4f}" for t, (x, y, z) in zip(times, path, strict=True))
    (folder / "truth.csv").write_text("t,x,y,z\n" + truth + "\n")
    return folder


def test_a_small_set_with_sparse_ids_and_a_known_height_is_tracked(world, tmp_path):
    metrics = track(world, small_set(tmp_path / "set"), ("0.1", "0.05", "1.0"), steps=79)
    assert metrics["position_rmse"] < 0.1
