"""What is odd about a recording, in sentences that say the remedy."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets.anchorwise import scaled_anchors, stuck_anchors
from zenoh_cbef.datasets.axes import exchanged_axes
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import is_planar
from zenoh_cbef.datasets.gaps import gap
from zenoh_cbef.datasets.lateness import lateness
from zenoh_cbef.datasets.passes import copied, overlaid
from zenoh_cbef.datasets.sparse import strays
from zenoh_cbef.datasets.swaps import swapped
from zenoh_cbef.datasets.units import odd_unit
from zenoh_cbef.numbers import number
from zenoh_cbef.words import counted

_SELDOM, _OFTEN = 10.0, 1e-5
"""Intervals of an anchor's ranges, s, that are none of a receiver's."""
_WORDS = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_NEAR, _IN_SPACE = 0.1, 4
"""Anchors are near a plane that are off it by less than this share of their extent along it; so many are in space."""
_OFTEN_ALIKE = 10
"""So many ranges that are equal to the last digit, and the largest by far, are no ranges."""
_WHOLE = 0.99
"""A truth of so much of the time is one of all."""


def findings(dataset: Dataset) -> list[str]:
    """Sentences; none for a recording about which nothing is odd."""
    unknowns = 4 if is_planar(dataset) else 6
    if len(dataset.ranges) < unknowns:
        few = f"{counted(len(dataset.ranges), 'range')} cannot determine position and velocity, {unknowns} unknowns"
        return [f"{few}; import more of the recording", *_silent(dataset)]
    twice = copied(dataset) or overlaid(dataset)
    wrong = stuck_anchors(dataset) or scaled_anchors(dataset) or _unit(dataset)
    wrong += _clock(dataset) + _marks(dataset)
    silence = gap(dataset)
    wrong = wrong or _exchanged(dataset)
    late = None if wrong or not dataset.has_truth else lateness(dataset)
    rest = [] if wrong or late is not None else [*swapped(dataset), *_between(dataset)]
    told = [*twice, *wrong, *[silence] * bool(silence), *_truth(dataset, late), *_silent(dataset), *rest]
    # Of anchors at one height an import asks for the target's.
    return told if is_planar(dataset) else told + mirrored(dataset.anchors)


def _unit(dataset: Dataset) -> list[str]:
    unit = odd_unit(dataset)
    return [] if unit is None else [unit.said]


def _exchanged(dataset: Dataset) -> list[str]:
    axes = exchanged_axes(dataset) if dataset.has_truth else None
    return [f"the truth fits the ranges with its {' and '.join(axes)} exchanged: exchange the columns"] if axes else []


def _marks(dataset: Dataset) -> list[str]:
    """A number that receivers write where they measured nothing, as 65.535: the largest, often the same, far beyond."""
    most = float(dataset.ranges.max())
    count, others = int((dataset.ranges == most).sum()), dataset.ranges[dataset.ranges < most]
    if count < _OFTEN_ALIKE or not len(others) or most < 2.0 * float(others.max()):
        return []
    said = f"{counted(count, 'range')} are {number(most)} m, and all others below {number(float(others.max()))} m"
    return [f"{said}: leave out what says that nothing was measured"]


def mirrored(anchors: Floats, near: float = 0.0) -> list[str]:
    """Whether anchors in space, (n, 3), m, are so near one plane that ranges fit a mirror image as well: a sentence.

    near: how far off one, m, they are near it in any case.
    """
    count = len(anchors)
    if count < _IN_SPACE:
        return []
    spread = np.linalg.svd(anchors - anchors.mean(axis=0), compute_uv=False) / np.sqrt(count)
    if spread[2] > max(_NEAR * spread[1], near):
        return []
    said = f"anchors are {number(float(spread[2]))} m off one plane, and a run may track the mirror image of the target"
    given = "filter.initial_position on its side of that plane, with a filter.initial_position_std that leaves it there"
    return [f"{said}; give filter.planar_height, or at least {given}"]


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


def _truth(dataset: Dataset, late: float | None) -> list[str]:
    if not dataset.has_truth:
        return []
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    clock, remedy = "the truth is on another clock: ", "bring both to one, or leave the truth out"
    if late is not None:
        remedy = f"{'add' if late < 0.0 else 'subtract'} {abs(round(late, 3)):.12g} s "
        remedy += f"{'to' if late < 0.0 else 'from'} its times, with which it fits the ranges best"
    if not dataset.knows_truth(dataset.range_time).any():
        first, last = dataset.truth_time[0], dataset.truth_time[-1]
        times = (
            f"its times go from {first:.12g} to {last:.12g} s, those of the ranges from {begin:.12g} to {end:.12g} s"
        )
        return [f"{clock}{times}; {remedy}"]
    if late is not None:
        return [clock + remedy]
    parts = np.clip(dataset.truth_time, begin, end)
    known = dataset.knows_truth(0.5 * (parts[1:] + parts[:-1]))
    covered = float(np.diff(parts)[known].sum())
    whole = end - begin
    if covered > _WHOLE * whole:
        return []
    return [f"the truth covers {number(covered)} of {number(whole)} s: only those are scored"]


def _between(dataset: Dataset) -> list[str]:
    found = strays(dataset) if dataset.has_truth else None
    if found is None:
        return []
    far, interval = found
    said = (
        f"the truth has a position every {number(interval)} s and is taken for straight lines between them, which are"
    )
    return [
        f"{said} off by about {number(far)} m, and so are the errors that are shown: give a truth with more positions"
    ]


def _silent(dataset: Dataset) -> list[str]:
    counts = np.bincount(dataset.range_anchor, minlength=len(dataset.anchors))
    said = [f"anchor {label} has no range" for label, many in zip(dataset.labels, counts, strict=True) if not many]
    apart = np.linalg.norm(dataset.anchors[:, None] - dataset.anchors[None], axis=2)
    same = [pair for pair in combinations(range(len(apart)), 2) if apart[pair] == 0.0]
    return said + [f"anchors {dataset.labels[one]} and {dataset.labels[two]} are at one place" for one, two in same]


def summary(dataset: Dataset) -> dict[str, str]:
    """What a recording holds, in words by quantity."""
    counts = np.bincount(dataset.range_anchor, minlength=len(dataset.anchors))
    begin, end = float(dataset.range_time[0]), float(dataset.range_time[-1])
    low, high = dataset.anchors.min(axis=0), dataset.anchors.max(axis=0)
    box = " x ".join(f"{length:.3g}" for length in high - low)
    truth = counted(len(dataset.truth), "position") if dataset.has_truth else "none: no errors are shown"
    return {
        "anchors": f"{len(dataset.anchors)} in a box of {box} m" + (", at one height" if is_planar(dataset) else ""),
        "ranges": f"{len(dataset.ranges)}, {counts.min()} to {counts.max()} of an anchor",
        "lengths": "{:.3g} to {:.3g} m, median {:.3g} m".format(*np.percentile(dataset.ranges, [0, 100, 50])),
        "time": f"{number(end - begin)} s, from {begin:.12g} to {end:.12g} s",
        "an anchor's ranges": _spacing(dataset),
        "truth": truth,
    }


def _spacing(dataset: Dataset) -> str:
    if dataset.interval is not None:
        return f"{number(dataset.interval)} s apart"
    alone = np.bincount(dataset.range_anchor).max() == 1
    return "one of each: no time between two" if alone else "mostly several at the same time"
