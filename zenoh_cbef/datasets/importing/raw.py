"""What a source holds, before it is a dataset, and how it becomes one."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.datasets.dataset import Dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.words import counted

Place = tuple[float, float, float]


@dataclass
class Raw:
    """A source's content.

    anchors: m, by name. ranges: time (s), name of the anchor, range (m). truth: time and position. notes: of what was
    left out or assumed, sentences.
    """

    anchors: dict[str, Place] = field(default_factory=dict)
    ranges: list[tuple[float, str, float]] = field(default_factory=list)
    truth: list[tuple[float, Place]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def dataset_of(raw: Raw, source: str) -> Dataset:
    """The dataset. Ranges that cannot be used are left out, and a note says so. Raises UserError where none is left."""
    if not raw.ranges:
        raise UserError(f"{source} has no range; name its columns, as in --map range=dist, or see docs/datasets.md")
    if not raw.anchors:
        raise UserError(f"{source} does not say where the anchors are; give --anchors FILE, a CSV file of id,x,y,z")
    lost = Counter(name for _, name, _ in raw.ranges if name not in raw.anchors)
    for name, count in lost.most_common(5):
        raw.notes.append(f"{counted(count, 'range')} of anchor {name}, which has no position, left out")
    negative = sum(distance < 0.0 for _, _, distance in raw.ranges)
    if negative:
        raw.notes.append(f"{counted(negative, 'negative range')} left out")
    kept = [one for one in raw.ranges if one[1] in raw.anchors and one[2] >= 0.0]
    if not kept:
        named, placed = (", ".join(sorted(map(str, names))[:5]) for names in (lost, raw.anchors))
        raise UserError(f"no range of {source} is of an anchor with a position: ranges name {named}, anchors {placed}")
    if copies := len(kept) - len(set(kept)):
        raw.notes.append(f"{counted(copies, 'copy', 'copies')} of ranges left out: the same time, anchor and range")
    kept = list(dict.fromkeys(kept))
    order = sorted(range(len(kept)), key=lambda row: kept[row][0])
    kept = [kept[row] for row in order]
    known = sorted(raw.truth, key=lambda one: one[0])
    names = tuple(raw.anchors)
    index = {name: row for row, name in enumerate(names)}
    return Dataset(
        labels=names,
        anchors=np.array([raw.anchors[name] for name in names], dtype=np.float64),
        range_time=np.array([one[0] for one in kept]),
        range_anchor=np.array([index[one[1]] for one in kept], dtype=np.intp),
        ranges=np.array([one[2] for one in kept]),
        truth_time=np.array([one[0] for one in known]),
        truth=np.array([one[1] for one in known]).reshape(-1, 3),
        order=np.array(order, dtype=np.intp),
    )
