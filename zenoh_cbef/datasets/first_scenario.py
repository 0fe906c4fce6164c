"""A scenario file for a recording, to run it and to edit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from zenoh_cbef.datasets.agility import agility
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import is_planar
from zenoh_cbef.datasets.scatter import scatter
from zenoh_cbef.datasets.spikes import without_spikes
from zenoh_cbef.numbers import number

_ROUND = (1.0, 2.0, 2.5, 5.0, 10.0)


def time_step(dataset: Dataset) -> float:
    """A round step near the interval of an anchor's ranges, s, or shorter for a target that turns fast.

    Between a range and the end of its step the target is taken to go straight on: in half of sqrt(sigma/q) it strays
    from that by an eighth of the noise. Steps shorter than a quarter of the interval gain little.
    """
    interval = dataset.interval or 0.1
    step, plain = _near(interval, _ROUND), without_spikes(dataset)
    quick, noise = agility(plain), scatter(plain)
    if not quick or not noise or step <= (longest := max(0.5 * math.sqrt(noise / quick), interval / 4.0)):
        return step
    return _near(longest, [each for each in _ROUND if each * _decade(longest) < 1.001 * longest])


def _decade(value: float) -> float:
    return 10.0 ** math.floor(math.log10(value))


def _near(value: float, steps: Sequence[float]) -> float:
    """The round number that is nearest to a value, of some that are multiples of its decade."""
    return float(f"{_decade(value) * min(steps, key=lambda each: abs(math.log(each * _decade(value) / value))):.3g}")


def write_scenario(dataset: Dataset, path: Path, height: float | None = None) -> Path:
    """Write it beside the recording's files. height: of the target, m, where the anchors do not tell it.

    Without it, that of the truth, or of the anchors, is taken, and the file says so.
    """
    lines = [
        f'name = "{_name(path)}"',
        f"dt = {time_step(dataset):g}",
        "",
        "[target]",
        'motion = "dataset"',
        'path = "."',
    ]
    lines += ["", "[filter]", 'range_std = "auto"  # m; give it where you know it']
    if is_planar(dataset) or height is not None:
        known, why = height, "as given"
        if known is None and dataset.has_truth:
            known, why = float(np.median(dataset.truth[:, 2])), "the truth's"
        if known is None:
            known, why = float(np.median(dataset.anchors[:, 2])), "the anchors': put in the target's"
        lines.append(f"planar_height = {number(known)}  # m, {why}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _name(path: Path) -> str:
    """The folder's name, as far as a run may have it."""
    plain = "".join(
        one if one.isascii() and (one.isalnum() or one in "-_") else "-" for one in path.resolve().parent.name
    )
    return plain.strip("-_") or "recording"
