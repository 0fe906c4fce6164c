"""What is odd about single anchors: ranges that are off by a factor, and a receiver that is stuck."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.fixes import fixes, is_planar
from zenoh_cbef.datasets.importing.units import LENGTHS
from zenoh_cbef.datasets.misfit import NAMES, SMALLEST, TIMES, misfit
from zenoh_cbef.numbers import number

_LEAST = 1.5
"""No bias makes ranges so many times too long or too short."""
_LEFT = 0.1
"""What ranges that are put right may still miss, as a share of the usual distance: a wrong place leaves more."""
_NEAR = 1.15
"""How near a factor is to that of a unit."""
_FAR = 10.0
"""How many times the triangle inequality must be broken before it is no noise."""
_OFTEN = 20
"""Equal ranges one after another that may be chance."""
_MOVED = 0.1
"""By what share of the usual range most others have to change while an anchor's are equal."""


def scaled_anchors(dataset: Dataset) -> list[str]:
    """Anchors whose ranges alone are in another unit, or off by a factor, in sentences."""
    known = dataset.knows_truth(dataset.range_time).any()
    found = _by_truth(dataset) if known else _by_others(dataset) or _by_size(dataset)
    return [_said(dataset.labels[anchor], factor) for anchor, factor in found.items()]


def _said(label: str, factor: float) -> str:
    units = {unit: float(LENGTHS[unit]) for unit in NAMES}
    unit = min(units, key=lambda each: abs(math.log(factor / units[each])))
    near = max(factor / units[unit], units[unit] / factor) < _NEAR
    times = float(f"{max(factor, 1.0 / factor):.2g}")
    long = f"{number(times)} times too {'long' if factor < 1.0 else 'short'}"
    look, right = (f": they look like {NAMES[unit]}", units[unit]) if near else ("", float(f"{factor:.2g}"))
    return (
        f"the ranges of anchor {label} alone are {long} beside all others{look}; multiply them by {number(right)}, "
        f"or leave anchor {label} out"
    )


def _by_truth(dataset: Dataset) -> dict[int, float]:
    """What ranges of few anchors have to be multiplied by to fit the distances to the truth."""
    truth = dataset.truth_at(dataset.range_time)[:, :3]
    apart = np.linalg.norm(truth - dataset.anchors[dataset.range_anchor], axis=1)
    found, fitting = {}, 0
    for anchor in range(len(dataset.anchors)):
        mine = (dataset.range_anchor == anchor) & (dataset.ranges > 0.0) & (apart > 0.0)
        if not mine.any():
            continue
        factor = _factor(dataset.ranges[mine], apart[mine])
        if factor is not None and _odd(factor):
            found[anchor] = factor
        fitting += factor is not None and not _odd(factor)
    return found if len(found) < fitting else {}


def _by_others(dataset: Dataset) -> dict[int, float]:
    """The same without a truth, of one anchor at most: its distances are those to fixes of all others."""
    none = np.zeros(0, dtype=bool)
    now = misfit(dataset, none)
    if not SMALLEST < now < np.inf:
        return {}
    found: dict[int, tuple[float, float]] = {}
    for anchor in range(len(dataset.anchors)):
        mine = dataset.range_anchor == anchor
        others = fixes(_part(dataset, ~mine)) if mine.any() and not mine.all() else None
        if others is None or not others.time.size:
            continue
        place = dataset.anchors[anchor, : others.places.shape[1]]
        height = np.maximum(others.squared_height, 0.0) if is_planar(dataset) else 0.0
        apart = np.sqrt(np.sum((others.places - place) ** 2, axis=1) + height)
        ranges = np.interp(others.time, dataset.range_time[mine], dataset.ranges[mine])
        known = (ranges > 0.0) & (apart > 0.0)
        factor = _factor(ranges[known], apart[known]) if known.any() else None
        if factor is not None and _odd(factor):
            mended = replace(dataset, ranges=dataset.ranges * np.where(mine, factor, 1.0))
            found[anchor] = factor, misfit(mended, none)
    best = sorted(found, key=lambda anchor: found[anchor][1])[:2]
    if not best or found[best[0]][1] > now / TIMES or (best[1:] and found[best[1]][1] < 2.0 * found[best[0]][1]):
        return {}
    return {best[0]: found[best[0]][0]}


def _by_size(dataset: Dataset) -> dict[int, float]:
    """The same of an anchor whose usual range breaks the triangle inequality many times with each of several others."""
    ranged = np.unique(dataset.range_anchor)
    usual = np.array([np.median(dataset.ranges[dataset.range_anchor == anchor]) for anchor in ranged])
    places = dataset.anchors[ranged]
    for row, anchor in enumerate(ranged.tolist() if len(ranged) > 2 else []):
        others = np.arange(len(ranged)) != row
        most = usual[others] + np.linalg.norm(places[others] - places[row], axis=1)
        if usual[row] > _FAR * most.max():
            return {anchor: float(np.median(usual[others]) / usual[row])}
    return {}


def _part(dataset: Dataset, chosen: Bools) -> Dataset:
    return replace(
        dataset,
        range_time=dataset.range_time[chosen],
        range_anchor=dataset.range_anchor[chosen],
        ranges=dataset.ranges[chosen],
        order=None,
    )


def _odd(factor: float) -> bool:
    return max(factor, 1.0 / factor) > _LEAST


def _factor(ranges: Floats, apart: Floats) -> float | None:
    """What ranges have to be multiplied by to be distances (r,), all above 0; None where no number makes them so."""
    factor = float(np.median(apart / ranges))
    left = float(np.median(np.abs(factor * ranges - apart)))
    return factor if left < _LEFT * float(np.median(apart)) else None


def stuck_anchors(dataset: Dataset) -> list[str]:
    """Anchors that tell one range for long while those of most others change, in sentences."""
    usual, said = float(np.median(dataset.ranges)), []
    for anchor, label in enumerate(dataset.labels):
        mine = dataset.range_anchor == anchor
        time, ranges = dataset.range_time[mine], dataset.ranges[mine]
        ends = np.flatnonzero(np.diff(ranges, append=np.inf))
        counts = np.diff(ends, prepend=-1)
        if not counts.size or counts.max() < _OFTEN:
            continue
        last = ends[counts.argmax()]
        begin, end = float(time[last - counts.max() + 1]), float(time[last])
        meanwhile = ~mine & (dataset.range_time >= begin) & (dataset.range_time <= end)
        others = [dataset.ranges[meanwhile & (dataset.range_anchor == one)] for one in range(len(dataset.labels))]
        moved = [float(np.ptp(np.percentile(each, [10, 90]))) for each in others if each.size]
        if moved and np.median(moved) > _MOVED * usual:
            said.append(
                f"anchor {label} is stuck: {number(float(ranges[last]))} m from {begin:.12g} to {end:.12g} s, while "
                "others' ranges change; leave these ranges out"
            )
    return said
