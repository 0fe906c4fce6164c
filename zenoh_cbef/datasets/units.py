"""Whether anchors, ranges and truth are in one unit, and which unit they look like."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.importing.units import LENGTHS
from zenoh_cbef.datasets.misfit import NAMES, SMALLEST, TIMES, misfit

_ODD = 10.0
"""How many times the triangle inequality must be broken before it is no noise."""
_USUAL = 0.3
"""What breaks the inequality is shorter than the lengths themselves, by about so much."""
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
        look = "looks" if self.what == "truth" else "look"
        return f"{self.why}: {self.what} {look} like {NAMES[self.unit]}; import them with {options}"


def odd_unit(dataset: Dataset) -> OddUnit | None:
    """Which lengths look like another unit; None where all fit one another."""
    clash = clash_of_units(dataset)
    known = np.isfinite(dataset.truth_at(dataset.range_time)[:, 0]) if dataset.has_truth else np.zeros(0, dtype=bool)
    now = misfit(dataset, known)
    if clash is None and not SMALLEST < now < np.inf:
        return None
    whats = _COLUMNS if known.any() else ("ranges", "anchors")
    misfits = {
        (what, unit): misfit(_scaled(dataset, what, float(LENGTHS[unit])), known) for what in whats for unit in NAMES
    }
    best = min(misfits, key=misfits.__getitem__)
    if misfits[best] < now / TIMES:
        why = f"the {best[0]} {'does' if best[0] == 'truth' else 'do'} not fit the rest" if clash is None else clash.why
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
            unit = min(NAMES, key=lambda each: abs(math.log(times * float(LENGTHS[each]) / _USUAL)))
            return OddUnit(words.format(times), what, unit)
    return None


def _scaled(dataset: Dataset, what: str, factor: float) -> Dataset:
    return replace(
        dataset,
        ranges=dataset.ranges * (factor if "ranges" in what else 1.0),
        anchors=dataset.anchors * (factor if "anchors" in what else 1.0),
        truth=dataset.truth * (factor if "truth" in what else 1.0),
    )
