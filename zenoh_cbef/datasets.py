"""Recorded ranging data: a folder with anchors.csv, ranges.csv and truth.csv."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.words import counted

_COLUMNS = {"anchors": "id,x,y,z", "ranges": "t,anchor_id,range", "truth": "t,x,y,z"}
_VELOCITY_BASE = 0.1
_LARGEST_GAP, _MANY_INTERVALS = 1.0, 10.0
"""The truth is unknown between positions that are further apart than this, s, and than this many usual intervals."""
_ODD = 10.0
"""How many times the triangle inequality must be broken before it is no noise."""
_MOST = {"t": 1e12, "x": 1e7, "y": 1e7, "z": 1e7, "range": 1e7}
"""The largest size of a column's numbers, s and m: that of a scenario's coordinates."""


@dataclass(frozen=True)
class Dataset:
    """Fixed anchors that range one moving target.

    labels: the anchors' ids, (n,). anchors: (n, 3), m. range_time: (r,), s, ascending. range_anchor: (r,), index
    into the anchors. ranges: (r,), m. truth_time: (t,), s. truth: (t, 3), m.
    """

    labels: tuple[str, ...]
    anchors: Floats
    range_time: Floats
    range_anchor: NDArray[np.intp]
    ranges: Floats
    truth_time: Floats
    truth: Floats

    def origin(self, dt: float) -> float:
        """The time of step 0: one step before the first range."""
        return float(self.range_time[0]) - dt

    def steps(self, dt: float) -> int:
        """How many whole steps the ranges fill."""
        return max(1, int(np.floor((self.range_time[-1] - self.origin(dt)) / dt + 1e-9)))

    @property
    def interval(self) -> float | None:
        """The time from one range of an anchor to its next, s, median of all; None where there is none."""
        times = (self.range_time[self.range_anchor == anchor] for anchor in range(len(self.anchors)))
        median = float(np.median(np.concatenate([np.diff(each) for each in times] or [[np.inf]])))
        return median if 0.0 < median < np.inf else None

    def knows_truth(self, times: Floats) -> Bools:
        """Whether dataset times (k,) lie between two true positions that are near enough to each other, (k,)."""
        after = np.clip(np.searchsorted(self.truth_time, times), 1, max(1, len(self.truth_time) - 1))
        gaps = np.append(np.diff(self.truth_time), 0.0)
        largest = max(_LARGEST_GAP, _MANY_INTERVALS * float(np.median(gaps[:-1]))) if len(gaps) > 1 else 0.0
        inside = (times >= self.truth_time[0]) & (times <= self.truth_time[-1])
        return np.asarray(inside & (gaps[after - 1] <= largest))

    def truth_at(self, times: Floats) -> Floats:
        """True states (k, 6) at dataset times (k,), NaN where the truth is not known.

        Velocities are central differences, and one-sided ones at the ends of what is known.
        """
        base = _VELOCITY_BASE

        def position(at: Floats) -> Floats:
            return np.stack([np.interp(at, self.truth_time, self.truth[:, axis]) for axis in range(3)], axis=1)

        earlier, later = (np.where(self.knows_truth(at), at, times) for at in (times - base, times + base))
        span = np.where((earlier < times) & (later > times), 2.0 * base, later - earlier)
        velocity = (position(later) - position(earlier)) / np.where(span > 0.0, span, np.inf)[:, None]
        state = np.concatenate([position(times), velocity], axis=1)
        return np.where((self.knows_truth(times) & (span > 0.0))[:, None], state, np.nan)

    def beacons(self, times: Floats) -> tuple[Floats, Floats]:
        """The ranges laid onto steps that end at dataset times (k,): (emission time, range), both (n, k).

        A range belongs to the first step that ends at or after it. Where an anchor has several in one step, the last
        of them goes to the following step, if every range then has a step of its own. The others become one: the mean
        of their times and ranges, which is exact for a constant velocity. NaN where no range came.
        """
        emitted = np.full((len(self.anchors), len(times)), np.nan)
        ranges = np.full_like(emitted, np.nan)
        steps = np.searchsorted(times, self.range_time - 1e-9)
        for anchor in range(len(self.anchors)):
            mine = (self.range_anchor == anchor) & (steps < len(times))
            for step, chosen in _shared_out(steps[mine], len(times)):
                emitted[anchor, step] = self.range_time[mine][chosen].mean()
                ranges[anchor, step] = self.ranges[mine][chosen].mean()
        return emitted, ranges


def _shared_out(steps: NDArray[np.intp], length: int) -> Iterator[tuple[int, list[int]]]:
    """Which of the ranges that fall into ascending steps (r,) each step gets."""
    count = np.bincount(steps, minlength=length)
    # A step has room for one more if it is empty, or if its own range can move on in turn.
    room = np.zeros(length + 1, dtype=bool)
    for step in range(length - 1, -1, -1):
        room[step] = count[step] == 0 or (count[step] == 1 and room[step + 1])
    waiting: list[int] = []
    at = 0
    for step in range(length):
        here = [*waiting, *range(at, at + count[step])]
        at += count[step]
        waiting = [here.pop()] if len(here) > 1 and room[step + 1] else []
        if here:
            yield step, here


def read_dataset(folder: Path) -> Dataset:
    """Read a recorded set. Raises UserError where a file is missing, empty or not as documented."""
    anchors, ranges, truth = (_read(folder, name) for name in ("anchors", "ranges", "truth"))
    for name, labels in (("anchors", anchors[:, 0]), ("ranges", ranges[:, 1])):
        if (labels != np.floor(labels)).any() or (np.abs(labels) > 2**53).any():
            raise UserError(f"{folder / name}.csv has an anchor id that is not a whole number; correct it")
    ids = anchors[:, 0].astype(int)
    index = {int(label): row for row, label in enumerate(ids)}
    if len(index) < len(ids):
        raise UserError(f"{folder / 'anchors.csv'} names an anchor twice; give every anchor its own id")
    unknown = sorted(set(ranges[:, 1].astype(int).tolist()) - index.keys())
    if unknown:
        raise UserError(f"{folder / 'ranges.csv'} has ranges of anchor {unknown[0]}, which anchors.csv lacks; add it")
    ranges = ranges[np.argsort(ranges[:, 0], kind="stable")]
    ranges = ranges[ranges[:, 2] >= 0.0]
    if len(ranges) == 0:
        raise UserError(f"{folder / 'ranges.csv'} has negative ranges only; a dataset needs at least one range")
    truth = truth[np.argsort(truth[:, 0], kind="stable")]
    found = Dataset(
        labels=tuple(str(label) for label in ids),
        anchors=anchors[:, 1:4],
        range_time=ranges[:, 0],
        range_anchor=np.array([index[int(label)] for label in ranges[:, 1]], dtype=np.intp),
        ranges=ranges[:, 2],
        truth_time=truth[:, 0],
        truth=truth[:, 1:4],
    )
    _check_units(found, folder)
    return found


def _check_units(dataset: Dataset, folder: Path) -> None:
    """Raise UserError where anchors and ranges cannot be in one unit: they break the triangle inequality many times.

    Of ranges r and s that follow one another, of anchors d apart, |r - s| <= d <= r + s, up to noise and motion.
    """
    first, second = dataset.range_anchor[:-1], dataset.range_anchor[1:]
    apart = np.linalg.norm(dataset.anchors[first] - dataset.anchors[second], axis=1)
    chosen = apart > 0.0
    if not chosen.any():
        return
    apart, former, latter = apart[chosen], dataset.ranges[:-1][chosen], dataset.ranges[1:][chosen]
    for far, wide, words in (
        (apart, former + latter, "the anchors are {:.3g} times too far apart for the ranges"),
        (
            np.abs(former - latter),
            apart,
            "the ranges differ {:.3g} times too much for the anchors",
        ),
    ):
        times = float(np.median(far / np.maximum(wide, np.finfo(float).tiny)))
        if times > _ODD:
            raise UserError(f"{folder}: {words.format(times)}; write anchors.csv and ranges.csv in metres")


def _read(folder: Path, name: str) -> Floats:
    path, columns = folder / f"{name}.csv", _COLUMNS[name]
    if path.is_dir():
        raise UserError(f"{path} is a folder, where a file of {columns} has to be; name them otherwise")
    if not path.is_file():
        raise UserError(f"{path} is missing; a dataset folder holds anchors.csv, ranges.csv and truth.csv")
    lines = path.read_text(encoding="utf-8-sig", errors="replace").replace('"', "").splitlines()
    if not lines or lines[0].replace(" ", "") != columns:
        raise UserError(f"{path} does not begin with the header {columns}, with commas between; see docs/datasets.md")
    filled = [line for line in lines[1:] if line.strip()]
    try:
        rows = np.loadtxt(filled, delimiter=",", ndmin=2, comments=None) if filled else np.empty((0, 0))
    except ValueError:
        flaw = _flaw(lines, columns.count(",") + 1)
        raise UserError(f"{path} has a line that is not {columns} in numbers: {flaw}; correct it") from None
    if rows.size == 0:
        raise UserError(f"{path} has no rows; a dataset needs at least one of {columns}")
    if rows.shape[1] != columns.count(",") + 1 or not np.isfinite(rows).all():
        raise UserError(f"{path} has rows that are not {columns} in finite numbers; correct them")
    for column, values in zip(columns.split(","), rows.T, strict=True):
        most = _MOST.get(column, np.inf)
        if (np.abs(values) > most).any():
            worst = values[np.abs(values).argmax()]
            raise UserError(
                f"{path} has {worst:g} in the column {column}, which takes at most {most:g}, in s or m; correct it"
            )
    return np.asarray(rows)


def _flaw(lines: Sequence[str], columns: int) -> str:
    """Where the first line is that does not hold so many numbers, and what it holds instead."""
    for number, line in enumerate(lines[1:], start=2):
        values = line.split(",")
        if line.strip() and len(values) != columns:
            return f"line {number} has {counted(len(values), 'value')}"
        for value in values if line.strip() else ():
            try:
                float(value)
            except ValueError:
                return f"line {number} has {value.strip()!r:.40}"
    return "a number is written in an unusual way"
