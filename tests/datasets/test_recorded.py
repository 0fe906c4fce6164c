"""The recording that comes with the package: sound, complete, and tracked by processes and simulator alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.datasets import dataset_folder, read_dataset
from zenoh_cbef.datasets.findings import findings
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate


def test_it_is_sound_has_a_truth_and_names_its_licence():
    folder = dataset_folder("recorded:lawnmower")
    found = read_dataset(folder)
    assert not findings(found)
    assert found.has_truth
    assert len(found.labels) == 4
    assert "Georgia Tech Research Corporation" in (folder / "README.md").read_text(encoding="utf-8")


def test_its_ranges_are_too_long_by_what_its_text_says():
    found = read_dataset(dataset_folder("recorded:lawnmower"))
    there = found.truth_at(found.range_time)[:, :3]
    off = found.ranges - np.linalg.norm(there - found.anchors[found.range_anchor], axis=1)
    medians = [np.median(off[found.range_anchor == anchor]) for anchor in range(4)]
    assert (min(medians), max(medians)) == pytest.approx((1.8, 3.6), abs=0.05)


def test_a_name_of_no_recording_is_refused_with_those_there_are():
    with pytest.raises(UserError, match="no recording 'meadow' comes with the package; there is lawnmower"):
        load("lawnmower", ["target.path=recorded:meadow"])


def test_other_paths_start_from_the_base():
    assert dataset_folder("my-set", Path("/data")) == Path("/data/my-set")
    assert dataset_folder("/my-set", Path("/data")) == Path("/my-set")


@pytest.mark.slow
def test_the_scenario_tracks_as_a_centralised_filter_does():
    [found] = analyze(simulate([load("lawnmower").scenario]))
    # The ranges' standard deviation is 1.5 m, and each node's are too long by a length of its own.
    assert (found.metrics.position_rmse or np.inf) < 3.0
    ratio = found.metrics.ratio_to_centralized
    assert ratio is not None
    assert ratio < 1.1
