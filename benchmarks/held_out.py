"""Made-up sets of the same kinds as the recorded ones, with known biases, on which no setting was chosen."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from benchmarks.common import followed, plain_table
from benchmarks.recorded import WRONG, errors
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError

SEEDS = 3
BIASES = ("none", "estimate", "auto")
"""The settings of filter.bias, the default last."""


Scores = Sequence[tuple[float, float, float, float]]
"""What `errors` says of each seed."""


@dataclass(frozen=True)
class Kind:
    """Anchors (n, 3), a walk (speed m/s, area low and high, m), and what is wrong with the ranges.

    rate: ranges of an anchor per second, least and most. std: of their noise, m. common: the bias of all anchors,
    own: standard deviation of what each has besides, m. share: by which all ranges are too long. outliers: the share
    of ranges that are too long, and by how much on average, m. reflected: for how long ranges of an anchor are too
    long, and for how long they are not, s on average, and by how much then, m. rest: for how long the target rests at
    first, s. rounding: what its turns are rounded over, s. height: the filter's planar height, m; None: it estimates
    three axes. missing: the share of ranges that do not come. silence: for how long none do in the middle, s.
    """

    anchors: Callable[[np.random.Generator], Floats]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    speed: float
    seconds: float
    dt: float
    rate: tuple[float, float]
    std: float
    common: float = 0.0
    own: float = 0.0
    outliers: tuple[float, float] = (0.0, 0.0)
    share: float = 0.0
    reflected: tuple[float, float, float] | None = None
    rest: float = 0.0
    rounding: float = 1.5
    height: float | None = None
    missing: float = 0.0
    silence: float = 0.0


def _room(rng: np.random.Generator) -> Floats:
    """Eight anchors on the walls of a room of 12 m by 8 m by 3 m, high and low in turn."""
    x, y = np.array([0, 4, 8, 12, 12, 8, 4, 0]) * 1.0, np.array([0, 0, 0, 0, 8, 8, 8, 8]) * 1.0
    z = np.where(np.arange(8) % 2, 0.3, 2.7) + rng.uniform(-0.2, 0.2, 8)
    return np.stack([x, y, z], axis=1)


def _hall(rng: np.random.Generator) -> Floats:
    """Eight anchors around a hall of 30 m by 30 m, near the ground and 3 m up in turn."""
    del rng
    x, y = np.array([0, 15, 30, 30, 30, 15, 0, 0]) * 1.0, np.array([0, 0, 0, 15, 30, 30, 30, 15]) * 1.0
    return np.stack([x, y, np.where(np.arange(8) % 2, 0.2, 3.0)], axis=1)


def _box(rng: np.random.Generator) -> Floats:
    """Four anchors at the corners of a box of 5 m by 2 m, at two heights."""
    del rng
    return np.array([[2.6, -0.9, 2.0], [-2.6, 0.9, 2.0], [-1.8, 0.9, 0.5], [1.8, -0.9, 0.5]])


def _field(rng: np.random.Generator) -> Floats:
    """Four anchors around a field of 70 m by 60 m."""
    corners = np.array([[-35.0, -30.0, 0.0], [35.0, -30.0, 0.0], [35.0, 30.0, 0.0], [-35.0, 30.0, 0.0]])
    corners[:, :2] += rng.uniform(-8.0, 8.0, (4, 2))
    return corners


_DRONE = Kind(_hall, (3.0, 3.0, 2.0), (27.0, 27.0, 9.0), 5.0, 120.0, 0.05, (9.0, 11.0), 0.1, 0.1, 0.05, (0.02, 3.0))
_FLOOR: dict[str, Any] = {
    "anchors": _hall,
    "low": (3.0, 3.0, 1.1),
    "high": (27.0, 27.0, 1.1),
    "dt": 0.1,
    "rate": (9.0, 11.0),
    "std": 0.08,
    "height": 1.1,
}
_WALK: dict[str, Any] = {"speed": 1.0, "seconds": 120.0, "dt": 0.1, "rate": (10.0, 20.0), "std": 0.07}
KINDS = {
    "indoors, biased": Kind(_room, (1.0, 1.0, 0.8), (11.0, 7.0, 1.6), **_WALK, common=0.15, own=0.05),
    "indoors, unbiased": Kind(_room, (1.0, 1.0, 0.8), (11.0, 7.0, 1.6), **_WALK),
    "indoors, plane, biased": Kind(
        _room, (1.0, 1.0, 1.0), (11.0, 7.0, 1.0), **_WALK, common=0.15, own=0.05, height=1.0
    ),
    "far from a small box": Kind(
        _box,
        (-25.0, 4.0, 1.0),
        (25.0, 45.0, 1.0),
        1.2,
        180.0,
        0.1,
        (9.0, 10.0),
        0.09,
        0.05,
        0.0,
        (0.006, 30.0),
        height=1.0,
    ),
    "drone": _DRONE,
    "drone among outliers": replace(_DRONE, outliers=(0.2, 15.0)),
    "large field": Kind(
        _field,
        (-30.0, -25.0, 0.0),
        (30.0, 25.0, 0.0),
        1.0,
        400.0,
        0.25,
        (1.1, 1.3),
        1.5,
        2.5,
        0.4,
        (0.2, 4.0),
        height=0.0,
    ),
    "rare ranges": Kind(
        _hall, (3.0, 3.0, 1.1), (27.0, 27.0, 1.1), 1.3, 200.0, 0.25, (0.7, 0.7), 0.08, 0.1, 0.03, (0.1, 1.0), height=1.1
    ),
    "hall, sharp turns": Kind(**_FLOOR, speed=1.4, seconds=90.0, rounding=0.8),
    "hall, reflections": Kind(**_FLOOR, speed=1.4, seconds=90.0, rounding=0.8, reflected=(4.0, 14.0, 0.8)),
    "driven off": Kind(**_FLOOR, speed=6.0, seconds=60.0, rest=30.0),
    "hall, scaled": Kind(
        _hall, (3.0, 3.0, 2.0), (27.0, 27.0, 6.0), 1.5, 120.0, 0.1, (9.0, 11.0), 0.1, 0.1, 0.03, share=0.02
    ),
    "slow pallet": Kind(
        _room, (1.0, 1.0, 1.0), (11.0, 7.0, 1.0), 0.2, 120.0, 0.2, (2.0, 3.0), 0.1, 0.1, 0.05, (0.02, 1.0), height=1.0
    ),
}


def write(kind: Kind, seed: int, folder: Path) -> None:
    """A set of one kind as the folder of CSV files that target.path names."""
    rng = np.random.default_rng(seed)
    anchors, time = kind.anchors(rng), np.arange(0.0, kind.seconds, 0.02)
    truth = _walk(kind, rng, time)
    rows = []
    bias = kind.common + kind.own * rng.standard_normal(len(anchors))
    for anchor, place in enumerate(anchors):
        gaps = 1.0 / rng.uniform(*kind.rate, size=int(kind.seconds * kind.rate[1]))
        at = rng.uniform(0.0, gaps[0]) + np.cumsum(gaps)
        at = at[at < kind.seconds - 0.5]
        position = np.stack([np.interp(at, time, truth[:, axis]) for axis in range(3)], axis=1)
        error = bias[anchor] + kind.std * rng.standard_normal(len(at))
        late = rng.uniform(size=len(at)) < kind.outliers[0]
        error += late * rng.exponential(kind.outliers[1] or 1.0, len(at))
        if kind.reflected is not None:
            error += _reflected(at, *kind.reflected, rng)
        ranges = (1.0 + kind.share) * np.linalg.norm(position - place, axis=1) + error
        comes = np.abs(at - 0.5 * kind.seconds) >= 0.5 * kind.silence
        if kind.missing:
            comes &= rng.uniform(size=len(at)) >= kind.missing
        rows += [(t, anchor, value) for t, value in zip(at[comes].tolist(), ranges[comes].tolist(), strict=True)]
    folder.mkdir(parents=True, exist_ok=True)
    _csv(folder / "anchors.csv", "id,x,y,z", [(row, *place) for row, place in enumerate(anchors.tolist())])
    _csv(folder / "ranges.csv", "t,anchor_id,range", sorted(rows))
    _csv(folder / "truth.csv", "t,x,y,z", [(t, *place) for t, place in zip(time.tolist(), truth.tolist(), strict=True)])


def _reflected(at: Floats, during: float, between: float, excess: float, rng: np.random.Generator) -> Floats:
    """By how much ranges at these times are too long, m, as the straight way to an anchor is hidden now and then."""
    error, begin = np.zeros_like(at), rng.exponential(between)
    while begin < at[-1]:
        end = begin + rng.exponential(during)
        error[(at >= begin) & (at < end)] = rng.exponential(excess)
        begin = end + rng.exponential(between)
    return error


def _walk(kind: Kind, rng: np.random.Generator, time: Floats) -> Floats:
    """A walk from one random point of the area to the next, turns rounded, (k, 3)."""
    low, high = np.array(kind.low), np.array(kind.high)
    points, lengths = [rng.uniform(low, high)], [0.0]
    while lengths[-1] < kind.speed * (time[-1] + 4.0):
        points.append(rng.uniform(low, high))
        lengths.append(lengths[-1] + float(np.linalg.norm(points[-1] - points[-2])))
    path = np.array(points)
    step = float(time[1] - time[0])
    window = np.hanning(max(3, int(kind.rounding / step)) + 2)
    fine = np.arange(-len(window), len(time) + len(window)) * step
    raw = np.stack(
        [np.interp(kind.speed * np.maximum(fine - kind.rest, 0.0), lengths, path[:, axis]) for axis in range(3)], axis=1
    )
    smooth = [np.convolve(raw[:, axis], window / window.sum(), mode="same") for axis in range(3)]
    return np.stack(smooth, axis=1)[len(window) : len(window) + len(time)]


def _csv(path: Path, header: str, rows: list[tuple[float, ...]]) -> None:
    lines = [f"{first:.6f}".rstrip("0").rstrip(".") + "".join(f",{each:.6f}".rstrip("0").rstrip(".") for each in rest)
             for first, *rest in rows]  # fmt: skip
    path.write_text("\n".join([header, *lines]) + "\n")


def settings(kind: Kind, folder: Path) -> dict[str, object]:
    """The keys of `tracking` that a set changes; all others are the defaults."""
    given: dict[str, object] = {
        "target.motion": "dataset",
        "target.path": str(folder),
        "dt": kind.dt,
        "filter.range_std": kind.std,
    }
    return given if kind.height is None else given | {"filter.planar_height": kind.height}


def run(
    repeats: int,
    *,
    case: str | None = None,
    set: Sequence[str] = (),  # noqa: A002 - the option's name
) -> Iterator[Table]:
    """Per kind, or of one, and setting of filter.bias, over some seeds; nothing is timed. set: keys that differ."""
    del repeats
    if case is not None and case not in KINDS:
        raise UserError(f"there is no made-up set {case!r}; there are {', '.join(KINDS)}")
    told = {key: value for key, _, value in (one.partition("=") for one in set)}
    rows, wrong = [], []
    with tempfile.TemporaryDirectory() as place:
        for name, kind in KINDS.items() if case is None else [(case, KINDS[case])]:
            folders = [Path(place) / f"{name} {seed}" for seed in range(SEEDS)]
            for seed, folder in enumerate(folders):
                write(kind, seed, folder)
            varied: list[tuple[str, object]] = [("filter.bias", bias) for bias in BIASES]
            varied += [("filter.range_std", factor * kind.std) for factor in WRONG]
            # What is not varied is as told: biases "auto", and the noise that the set was made with.
            scored = [
                [errors(settings(kind, folder) | told | {key: value}) for folder in folders]
                for key, value in followed(varied, name)
            ]
            rows += [[name, bias, *_spread(found)] for bias, found in zip(BIASES, scored, strict=False)]
            wrong += _told_wrong(name, dict(zip((1.0, *WRONG), scored[len(BIASES) - 1 :], strict=True)))
    heads = ["set", "filter.bias", "RMSE (m), median", "worst", "ratio to centralised, median", "worst"]
    yield plain_table(f"made-up sets, {SEEDS} seeds, last 75 %", heads, rows)
    heads = [
        "set",
        "filter.range_std is",
        "RMSE over that with the true noise, median",
        "worst",
        "NEES/d, median",
        "worst",
    ]
    yield plain_table("the same with a noise that is not so", heads, wrong)


def _spread(scored: Scores) -> list[str]:
    """Median and worst of errors, and of ratios to the centralised filter."""
    found = [(near, ratio) for near, _, ratio, _ in scored]
    return [f"{middle(column):.4f}" for column in zip(*found, strict=True) for middle in (np.median, np.max)]


def _told_wrong(name: str, scored: Mapping[float, Scores]) -> list[list[str]]:
    """Rows of a kind: what a noise of so many times the true one costs over the true one."""
    near = {factor: np.array([each[0] for each in found]) for factor, found in scored.items()}
    nees = {factor: np.array([each[3] for each in found]) for factor, found in scored.items()}
    return [
        [name, f"{factor:g} times the true one"]
        + [f"{middle(near[factor] / near[1.0]):.3f}" for middle in (np.median, np.max)]
        + [f"{middle(nees[factor]):.2f}" for middle in (np.median, np.max)]
        for factor in near
    ]
