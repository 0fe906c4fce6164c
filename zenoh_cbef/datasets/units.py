"""Whether anchors, ranges and truth are in one unit, and which unit they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes, is_planar
from zenoh_cbef.datasets.importing.units import LENGTHS

_ODD = 10.0
"""How many times the triangle inequality must be broken before it is no noise."""
_TIMES, _SMALLEST = 3.0, 0.02
"""How much better another unit has to fit, where ranges miss by more than a share of the usual one."""
_USUAL = 0.3
"""What breaks the inequality is shorter than the lengths themselves, by about so much."""
_NAMES = {"mm": "millimetres", "cm": "centimetres", "ft": "feet", "in": "inches"}
_COLUMNS = {
    "ranges": ("range",),
    "anchors": ("anchors",),
    "truth": ("truth",),
    "anchors and truth": ("anchors", "truth"),
}


@dataclass(frozen=True)
class OddUnit:
    """What looks like another unit than metres. why: in words. what: "ranges", "anchors" or "truth". unit: as "mm"."""

    why: str
    what: str
    unit: str

    @property
    def said(self) -> str:
        """The sentence with its remedy."""
        options = " ".join(f"--unit {column}={self.unit}" for column in _COLUMNS[self.what])
        return f"{self.why}: {self.what} look like {_NAMES[self.unit]}; import them with {options}"


def odd_unit(dataset: Dataset) -> OddUnit | None:
    """Which lengths look like another unit; None where all fit one another."""
    clash = clash_of_units(dataset)
    known = np.isfinite(dataset.truth_at(dataset.range_time)[:, 0]) if dataset.has_truth else np.zeros(0, dtype=bool)
    now = _misfit(dataset, known)
    if clash is None and not _SMALLEST < now < np.inf:
        return None
    whats = _COLUMNS if known.any() else ("ranges", "anchors")
    misfits = {
        (what, unit): _misfit(_scaled(dataset, what, float(LENGTHS[unit])), known) for what in whats for unit in _NAMES
    }
    best = min(misfits, key=misfits.__getitem__)
    if misfits[best] < now / _TIMES:
        why = f"the {best[0]} do not fit the rest" if clash is None else clash.why
        return OddUnit(why, *best)
    return clash


def clash_of_units(dataset: Dataset) -> OddUnit | None:
    """How anchors and ranges break the triangle inequality many times; None where they do not.

    Of ranges r and s that follow one another, of anchors d apart, |r - s| <= d <= r + s, up to noise and motion.
    """
    first, second = dataset.range_anchor[:-1], dataset.range_anchor[1:]
    apart = np.linalg.norm(dataset.anchors[first] - dataset.anchors[second], axis=1)
    chosen = apart > 0.0
    if not chosen.any():
        return None
    apart, former, latter = apart[chosen], dataset.ranges[:-1][chosen], dataset.ranges[1:][chosen]
    for what, far, wide, words in (
        ("anchors", apart, former + latter, "the anchors are {:.3g} times too far apart for the ranges"),
        ("ranges", np.abs(former - latter), apart, "the ranges differ {:.3g} times too much for the anchors"),
    ):
        times = float(np.median(far / np.maximum(wide, np.finfo(float).tiny)))
        if times > _ODD:
            unit = min(_NAMES, key=lambda each: abs(math.log(times * float(LENGTHS[each]) / _USUAL)))
            return OddUnit(words.format(times), what, unit)
    return None


def _scaled(dataset: Dataset, what: str, factor: float) -> Dataset:
    return replace(
        dataset,
        ranges=dataset.ranges * (factor if "ranges" in what else 1.0),
        anchors=dataset.anchors * (factor if "anchors" in what else 1.0),
        truth=dataset.truth * (factor if "truth" in what else 1.0),
    )


def _misfit(dataset: Dataset, known: Floats) -> float:
    """By what share of the usual range ranges miss; inf where nothing tells. known: of which the truth is known."""
    usual = float(np.median(dataset.ranges))
    if usual <= 0.0:
        return math.inf
    if known.any():
        truth = dataset.truth_at(dataset.range_time[known])[:, :3]
        apart = np.linalg.norm(truth - dataset.anchors[dataset.range_anchor[known]], axis=1)
        return float(np.median(np.abs(dataset.ranges[known] - apart))) / usual
    found = fixes(dataset)
    if not found.time.size:
        return math.inf
    height = max(0.0, float(np.median(found.squared_height))) if is_planar(dataset) else 0.0
    off = float(np.median(np.abs(found.squared_height - height))) / (2.0 * usual)
    spare = found.misfit[np.isfinite(found.misfit)]
    return math.hypot(off, float(np.median(spare)) if spare.size else 0.0) / usual
