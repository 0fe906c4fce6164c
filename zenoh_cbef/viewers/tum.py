"""A run as trajectories in the form of the TUM RGB-D benchmark, which evo and others read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.viewers.scene import Scene
from zenoh_cbef.writing import make_folder, whole


def write_tum(scene: Scene, output: Path) -> list[Path]:
    """Write a folder of files, one for the truth, one for each agent's estimates; returns them.

    A line is "time x y z qx qy qz qw", s and m; a point has no attitude, so the quaternion is that of no turn. Steps
    without a number are left out, and so is a file without a line. Raises UserError where they cannot be written.
    """
    trace = scene.trace
    paths = {"truth": trace.truth} | {f"agent_{agent}": one for agent, one in enumerate(trace.estimates)}
    if trace.smoothed is not None:
        paths |= {f"agent_{agent}_smoothed": one for agent, one in enumerate(trace.smoothed.states)}
    make_folder(output)
    written = []
    for name, states in paths.items():
        lines = _lines(scene, states)
        if lines:
            written.append(output / f"{name}.tum")
            with whole(written[-1]) as fresh:
                fresh.write_text("".join(lines), encoding="ascii")
    return written


def _lines(scene: Scene, states: Floats) -> list[str]:
    """The lines of states (K, 6)."""
    places = zip(scene.time.tolist(), states[:, :3], strict=True)
    return [
        f"{time // 10**9}.{time % 10**9:09d} " + " ".join(f"{value:.17g}" for value in place.tolist()) + " 0 0 0 1\n"
        for time, place in places
        if np.isfinite(place).all()
    ]
