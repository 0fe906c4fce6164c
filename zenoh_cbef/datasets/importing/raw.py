"""What a source holds, before it is a dataset, and how it becomes one."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.datasets.table import MOST
from zenoh_cbef.errors import UserError
from zenoh_cbef.words import counted

Place = tuple[float, float, float]
Range = tuple[float, str, float]
"""Time, s, name of the anchor, and length, m."""


@dataclass
class Raw:
    """A source's content.

    anchors: m, by name. ranges: time (s), name of the anchor, range (m). truth: time and position. notes: of what was
    left out or assumed, sentences.
    """

    anchors: dict[str, Place] = field(default_factory=dict)
    ranges: list[Range] = field(default_factory=list)
    truth: list[tuple[float, Place]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def _axes(place: Place) -> dict[str, float]:
    return dict(zip("xyz", place, strict=True))


def _within(values: Mapping[str, float]) -> bool:
    """Whether numbers, by column, are such as a dataset may have."""
    return all(abs(value) <= MOST[column] for column, value in values.items())


def dataset_of(raw: Raw, source: str) -> Dataset:
    """The dataset. Ranges that cannot be used are left out, and a note says so. Raises UserError where none is left."""
    if not raw.ranges:
        raise UserError(f"{source} has no range; name its columns, as in --map range=dist, or see docs/datasets.md")
    if far := [name for name, place in raw.anchors.items() if not _within(_axes(place))]:
        raise UserError(f"anchor {far[0]} is beyond {MOST['x']:g} m; correct its place")
    if not raw.anchors:
        raise UserError(f"{source} does not say where the anchors are; give --anchors FILE, a CSV file of id,x,y,z")
    kept, order = _ranges(raw, source)
    truth = [one for one in raw.truth if _within({"t": one[0], **_axes(one[1])})]
    if len(truth) < len(raw.truth):
        raw.notes.append(f"{counted(len(raw.truth) - len(truth), 'true position')} beyond {MOST['x']:g} m left out")
    truth.sort(key=lambda one: one[0])
    names = tuple(raw.anchors)
    index = {name: row for row, name in enumerate(names)}
    return Dataset(
        labels=names,
        anchors=np.array([raw.anchors[name] for name in names], dtype=np.float64),
        range_time=np.array([one[0] for one in kept]),
        range_anchor=np.array([index[one[1]] for one in kept], dtype=np.intp),
        ranges=np.array([one[2] for one in kept]),
        truth_time=np.array([one[0] for one in truth]),
        truth=np.array([one[1] for one in truth]).reshape(-1, 3),
        order=np.array(order, dtype=np.intp),
    )


def _ranges(raw: Raw, source: str) -> tuple[list[Range], list[int]]:
    """The ranges that can be used, in the order of their times, and the place of each among them in the source."""
    lost = Counter(name for _, name, _ in raw.ranges if name not in raw.anchors)
    for name, count in lost.most_common(5):
        raw.notes.append(f"{counted(count, 'range')} of anchor {name}, which has no position, left out")
    negative = sum(distance < 0.0 for _, _, distance in raw.ranges)
    if negative:
        raw.notes.append(f"{counted(negative, 'negative range')} left out")
    if nothing := sum(distance == 0.0 for _, _, distance in raw.ranges):
        raw.notes.append(f"{counted(nothing, 'range')} of 0 m, which say that nothing was measured, left out")
    known = [one for one in raw.ranges if one[1] in raw.anchors and not one[2] <= 0.0]
    kept = [one for one in known if _within({"t": one[0], "range": one[2]})]
    if len(kept) < len(known):
        most = f"beyond {MOST['range']:g} m, or at times beyond {MOST['t']:g} s"
        raw.notes.append(f"{counted(len(known) - len(kept), 'range')} {most}, left out")
    if not kept:
        named, placed = (", ".join(sorted(map(str, names))[:5]) for names in (lost, raw.anchors))
        raise UserError(f"no range of {source} is of an anchor with a position: ranges name {named}, anchors {placed}")
    if copies := len(kept) - len(set(kept)):
        raw.notes.append(f"{counted(copies, 'copy', 'copies')} of ranges left out: the same time, anchor and range")
    kept = list(dict.fromkeys(kept))
    order = sorted(range(len(kept)), key=lambda row: kept[row][0])
    return [kept[row] for row in order], order
