"""The centralised prototype tracks, and the sets on which it is compared are what their kinds say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.held_out import KINDS, write
from benchmarks.prototype import Told, starts, track
from benchmarks.random_sets import drawn
from zenoh_cbef.datasets import read_dataset

KIND = replace(KINDS["hall, sharp turns"], seconds=30.0, common=0.15, own=0.03, outliers=(0.1, 8.0), silence=8.0)
"""Biased, among outliers, and with a silence from 11 to 19 s."""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hall")
    write(KIND, 5, folder)
    return read_dataset(folder)


def errors(dataset, at, **told):
    known = Told(dataset, **({"std": KIND.std, "power": 0.3, "height": KIND.height} | told))
    return np.linalg.norm(track(known, at) - dataset.truth_at(at)[:, :2], axis=1)


def test_it_finds_its_target_and_finds_it_again_after_a_silence(made):
    at = np.arange(1.0, 29.0, 0.1)
    off = errors(made, at)
    assert np.sqrt(np.mean(off[(at > 5.0) & (at < 11.0)] ** 2)) < 0.15
    assert off[(at > 14.0) & (at < 18.5)].max() > 1.0
    assert np.sqrt(np.mean(off[at > 20.5] ** 2)) < 0.15


def test_one_that_is_sure_of_its_path_finds_it_again_by_new_starts(made):
    at = np.arange(22.0, 29.0, 0.1)
    assert np.sqrt(np.mean(errors(made, at, power=1e-4) ** 2)) < 1.0


def test_it_uses_no_range_before_it_came(made):
    late = replace(made, ranges=np.where(made.range_time > 8.0, made.ranges + 5.0, made.ranges))
    at = np.append(np.arange(1.0, 8.0, 0.25), 7.995)
    np.testing.assert_array_equal(errors(made, at), errors(late, at))
    assert np.isnan(errors(made, np.array([made.range_time[0] - 0.1]))[0])


def test_starts_are_apart_and_one_is_near(made):
    told = Told(made, KIND.std, 0.3, KIND.height)
    rows = np.flatnonzero(made.range_time < made.range_time[0] + 0.3).tolist()
    found = starts(told, rows)
    near = made.truth_at(np.array([made.range_time[0] + 0.15]))[0, :2]
    assert min(np.linalg.norm(place - near) for place in found) < 1.0
    assert all(np.linalg.norm(one - other) > 1.0 for one in found for other in found if one is not other)


def test_a_silence_and_missing_ranges_are_as_told(made, tmp_path):
    assert not ((made.range_time > 11.0) & (made.range_time < 19.0)).any()
    write(replace(KIND, missing=0.5), 5, tmp_path)
    assert len(read_dataset(tmp_path).ranges) == pytest.approx(0.5 * len(made.ranges), rel=0.1)


@pytest.mark.parametrize("seed", range(1, 9))
def test_drawn_sets_can_be_read_and_come_out_again(seed, tmp_path):
    kind = drawn(seed)
    for name in ("one", "other"):
        write(kind, seed, tmp_path / name)
    one, other = (read_dataset(tmp_path / name) for name in ("one", "other"))
    np.testing.assert_array_equal(one.ranges, other.ranges)
    assert len(one.anchors) >= (3 if kind.height is not None else 4)
    known = one.truth_at(one.range_time)
    assert np.isfinite(known).all(axis=1).mean() > 0.9
