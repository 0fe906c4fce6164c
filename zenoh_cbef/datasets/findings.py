"""What is odd about a recording, in sentences that say the remedy."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes, is_planar
from zenoh_cbef.datasets.gaps import gap
from zenoh_cbef.datasets.units import odd_unit
from zenoh_cbef.numbers import number
from zenoh_cbef.words import counted

_TIMES = 3.0
"""How much better another order of anchors has to fit."""
_SELDOM, _OFTEN = 10.0, 1e-5
"""Intervals of an anchor's ranges, s, that are none of a receiver's."""
_WORDS = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_SMALLEST = 0.02
"""Errors below this share of the usual range are no sign of anything."""
_MANY = 40
_WHOLE = 0.99
"""A truth of so much of the time is one of all."""


def findings(dataset: Dataset) -> list[str]:
    """Sentences; none for a recording about which nothing is odd."""
    unit = odd_unit(dataset)
    wrong = ([] if unit is None else [unit.said]) + _clock(dataset)
    silence = gap(dataset)
    return wrong + [silence] * bool(silence) + _truth(dataset) + _silent(dataset) + ([] if wrong else _swapped(dataset))


def _clock(dataset: Dataset) -> list[str]:
    interval = dataset.interval
    if interval is None or _OFTEN < interval <= _SELDOM:
        return []
    if interval <= _OFTEN:
        look = "are too near to each other for seconds; say their unit, as in --unit t=s"
    else:
        unit = next((unit for unit, most in (("ms", 1e4), ("us", 1e7)) if interval <= most), "ns")
        look = f"look like {_WORDS[unit]}; import them with --unit t={unit}"
    return [f"an anchor's ranges are {number(interval)} s apart: times {look}"]


def _truth(dataset: Dataset) -> list[str]:
    if not dataset.has_truth:
        return []
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    parts = np.clip(dataset.truth_time, begin, end)
    known = dataset.knows_truth(0.5 * (parts[1:] + parts[:-1]))
    covered = float(np.diff(parts)[known].sum())
    if not dataset.knows_truth(dataset.range_time).any():
        first, last = dataset.truth_time[0], dataset.truth_time[-1]
        times = (
            f"its times go from {first:.12g} to {last:.12g} s, those of the ranges from {begin:.12g} to {end:.12g} s"
        )
        return [f"the truth is on another clock: {times}; bring both to one, or leave the truth out"]
    whole = end - begin
    if covered > _WHOLE * whole:
        return []
    return [f"the truth covers {number(covered)} of {number(whole)} s: only those are scored"]


def _silent(dataset: Dataset) -> list[str]:
    counts = np.bincount(dataset.range_anchor, minlength=len(dataset.anchors))
    said = [f"anchor {label} has no range" for label, many in zip(dataset.labels, counts, strict=True) if not many]
    apart = np.linalg.norm(dataset.anchors[:, None] - dataset.anchors[None], axis=2)
    same = [pair for pair in combinations(range(len(apart)), 2) if apart[pair] == 0.0]
    return said + [f"anchors {dataset.labels[one]} and {dataset.labels[two]} are at one place" for one, two in same]


def _swapped(dataset: Dataset) -> list[str]:
    """Two anchors whose ranges fit much better with each other's places."""
    pair = _swapped_by_truth(dataset) if dataset.has_truth else _swapped_by_fixes(dataset)
    if pair is None:
        return []
    one, two = (dataset.labels[anchor] for anchor in pair)
    return [f"anchor {one} and {two} look swapped: their ranges fit much better at each other's places"]


def _swapped_by_truth(dataset: Dataset) -> tuple[int, int] | None:
    truth = dataset.truth_at(dataset.range_time)[:, :3]
    known, count = np.isfinite(truth).all(axis=1), len(dataset.anchors)
    off = np.full((count, count), np.nan)
    for anchor in range(count):
        mine = known & (dataset.range_anchor == anchor)
        if mine.any():
            apart = np.linalg.norm(truth[mine][:, None] - dataset.anchors[None], axis=2)
            off[anchor] = np.median(np.abs(dataset.ranges[mine][:, None] - apart), axis=0)
    least = _SMALLEST * float(np.median(dataset.ranges))
    swaps = [
        pair
        for pair in combinations(range(count), 2)
        if all(off[a, a] > max(least, _TIMES * off[a, b]) for a, b in (pair, pair[::-1]))
    ]
    return max(swaps, key=lambda pair: off[pair[0], pair[0]] + off[pair[1], pair[1]], default=None)


def _swapped_by_fixes(dataset: Dataset) -> tuple[int, int] | None:
    count = len(dataset.anchors)
    if count < (4 if is_planar(dataset) else 5) or count > _MANY:
        return None

    def misfit(pair: tuple[int, ...]) -> float:
        order = np.arange(count)
        order[list(pair)] = pair[::-1]
        found = fixes(dataset, dataset.anchors[order]).misfit
        found = found[np.isfinite(found)]
        return float(np.median(found)) if found.size else np.inf

    now = misfit(())
    if not _SMALLEST * float(np.median(dataset.ranges)) < now < np.inf:
        return None
    swaps = {pair: misfit(pair) for pair in combinations(range(count), 2)}
    best = min(swaps, key=swaps.__getitem__)
    others = [off for pair, off in swaps.items() if pair != best]
    # Where several swaps fit alike, as in a rectangle, only a truth could tell which it is.
    return best if swaps[best] < now / _TIMES and swaps[best] < 0.5 * min(others) else None


def summary(dataset: Dataset) -> dict[str, str]:
    """What a recording holds, in words by quantity."""
    counts = np.bincount(dataset.range_anchor, minlength=len(dataset.anchors))
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    low, high = dataset.anchors.min(axis=0), dataset.anchors.max(axis=0)
    box = " x ".join(f"{length:.3g}" for length in high - low)
    truth = counted(len(dataset.truth), "position") if dataset.has_truth else "none: no errors are shown"
    interval = dataset.interval
    return {
        "anchors": f"{len(dataset.anchors)} in a box of {box} m" + (", at one height" if is_planar(dataset) else ""),
        "ranges": f"{len(dataset.ranges)}, {counts.min()} to {counts.max()} of an anchor",
        "lengths": "{:.3g} to {:.3g} m, median {:.3g} m".format(*np.percentile(dataset.ranges, [0, 100, 50])),
        "time": f"{number(end - begin)} s, from {begin:.12g} to {end:.12g} s",
        "an anchor's ranges": "one alone" if interval is None else f"{number(interval)} s apart",
        "truth": truth,
    }
