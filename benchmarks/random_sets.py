"""Sets drawn at random, of kinds to which nothing was tuned: ours beside a prototype that was written apart."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from rich.table import Table

from benchmarks.common import followed, plain_table
from benchmarks.held_out import Kind, settings, write
from benchmarks.prototype import Told, track
from benchmarks.recorded import SILENT, errors
from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets import Dataset, read_dataset

POWERS = (0.1, 0.5, 2.5)
"""Of accelerations, m^2/s^3, that the prototype tries: it counts with the best in hindsight, which no tracker knows."""

_SIZES, _SPEEDS, _NOISES = (
    (6.0, 12.0, 25.0, 60.0, 150.0),
    (0.2, 0.6, 1.2, 1.5, 3.0, 6.0),
    (0.03, 0.07, 0.1, 0.1, 0.3, 1.0),
)
_RATES = (0.7, 2.0, 5.0, 10.0, 10.0, 20.0)


def drawn(seed: int) -> Kind:
    """A kind: where anchors stand, how the target walks, and what is wrong with the ranges."""
    rng = np.random.default_rng(seed)
    size, planar = float(rng.choice(_SIZES)), bool(rng.uniform() < 0.7)
    anchors = _placed(rng, size, int(rng.integers(3 if planar else 4, 11)))
    top = float(anchors[:, 2].max())
    height = 0.15 * top if planar else None
    std, rate = float(rng.choice(_NOISES)), float(rng.choice(_RATES))
    std = min(std, 0.15) if size < 20.0 else std
    reflected = (2.0, 12.0, 0.03 * size) if rng.uniform() < 0.3 else None
    return Kind(
        anchors=lambda _: anchors,
        low=(-0.42 * size, -0.42 * size, 0.15 * top),
        high=(0.42 * size, 0.42 * size, 0.15 * top if planar else 0.85 * top),
        speed=min(float(rng.choice(_SPEEDS)), 0.25 * size),
        seconds=float(rng.choice([60.0, 120.0])),
        dt=float(np.clip(0.5 / rate, 0.05, 0.5)),
        rate=(0.9 * rate, 1.1 * rate),
        std=std,
        common=float(rng.choice([0.0, 0.0, -0.3, 1.0, 1.5, 3.0])) * std,
        own=float(rng.choice([0.0, 0.15, 0.5, 1.0])) * std,
        outliers=(float(rng.choice([0.0, 0.0, 0.02, 0.1, 0.2])), float(rng.choice([0.5, 2.0, 5.0, 15.0]))),
        reflected=reflected,
        rounding=float(rng.choice([0.4, 0.8, 1.5, 3.0])),
        height=height,
        missing=float(rng.choice([0.0, 0.0, 0.1, 0.5])),
        silence=float(rng.choice([0.0, 0.0, 0.0, 8.0, 20.0])),
    )


def _placed(rng: np.random.Generator, size: float, count: int) -> Floats:
    """Anchors in a ring, anywhere, or along one side, high and low in turn, (n, 3)."""
    way, angle = rng.integers(3), np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + rng.uniform()
    if way == 0:
        flat = 0.5 * size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    else:
        flat = rng.uniform(-0.5, 0.5, (count, 2)) * size
        if way == 1:
            flat[:, 1] = rng.uniform(-0.5, -0.2, count) * size
    top = min(0.4 * size, float(rng.choice([3.0, 6.0, 20.0])))
    up = np.where(np.arange(count) % 2, 0.2, top) + rng.uniform(-0.2, 0.2, count)
    return np.column_stack([flat, up])


def beside(kind: Kind, dataset: Dataset) -> float:
    """The prototype's error, m, in the steps that `errors` scores, with the power of accelerations that suits best."""
    at: Floats = dataset.origin(kind.dt) + kind.dt * np.arange(1.0, dataset.steps(kind.dt) + 1.0)
    last = dataset.range_time[np.maximum(np.searchsorted(dataset.range_time, at, side="right") - 1, 0)]
    scored = (np.arange(len(at)) >= len(at) // 4) & (at - last <= SILENT)
    found = []
    for power in POWERS:
        told = Told(dataset, kind.std, power, kind.height)
        off = track(told, at) - dataset.truth_at(at)[:, : told.axes]
        found.append(float(np.sqrt(np.nanmean(np.sum(off[scored] ** 2, axis=1)))))
    return min(found)


def run(
    repeats: int,
    *,
    seeds: int = 50,
    first: int = 1001,
    set: Sequence[str] = (),  # noqa: A002 - the option's name
) -> Iterator[Table]:
    """One row per set, and how the ratios are spread; nothing is timed. set: keys that differ."""
    del repeats
    told = {key: value for key, _, value in (one.partition("=") for one in set)}
    rows, ratios = list[list[str]](), list[float]()
    with tempfile.TemporaryDirectory() as place:
        for seed in followed(range(first, first + seeds), "random sets"):
            kind, folder = drawn(seed), Path(place) / str(seed)
            write(kind, seed, folder)
            ours, _, _, nees = errors(settings(kind, folder) | told)
            theirs = beside(kind, read_dataset(folder))
            ratios.append(ours / theirs)
            rows.append([str(seed), f"{ours:.4f}", f"{theirs:.4f}", f"{ratios[-1]:.3f}", f"{nees:.2f}"])
    yield plain_table("sets drawn at random", ["seed", "RMSE (m)", "prototype", "ratio", "NEES/d"], rows)
    quantiles = np.quantile(ratios, (0.1, 0.5, 0.9, 1.0))
    shares = [float(np.mean(np.array(ratios) > limit)) for limit in (1.1, 2.0, 5.0)]
    heads = ["ratio: 10 %", "median", "90 %", "worst", "above 1.1", "above 2", "above 5"]
    yield plain_table("all of them", heads, [[*(f"{one:.3f}" for one in quantiles), *(f"{one:.0%}" for one in shares)]])
