"""Recorded ranges are laid onto steps, and folders that are no dataset are refused."""

from __future__ import annotations

import resource
from dataclasses import replace

import numpy as np
import pytest

from tests.datasets.made import ANCHORS, RANGES, TRUTH, scenario_of, write
from zenoh_cbef.datasets import read_dataset, write_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan


def test_sparse_ids_become_rows_in_the_order_of_the_anchors(tmp_path):
    dataset = read_dataset(write(tmp_path))
    assert dataset.labels == ("3", "7")
    assert dataset.anchors.tolist() == [[0, 0, 1], [4, 0, 1]]
    assert dataset.range_anchor.tolist() == [0, 1, 0, 0, 1]
    assert dataset.truth.shape == (3, 3)


def test_each_range_goes_to_the_first_free_step_at_or_after_it(tmp_path):
    dataset = read_dataset(write(tmp_path))
    times = np.array([10.0, 10.15, 10.3, 10.45, 10.6])
    emitted, ranges = dataset.beacons(times)
    # Anchor 3 ranged twice between 10.15 and 10.3: the second waits for the next step.
    nan = np.nan
    np.testing.assert_array_equal(ranges, [[1.0, nan, 3.0, 4.0, nan], [nan, 2.0, nan, 5.0, nan]])
    np.testing.assert_array_equal(emitted, [[10.0, nan, 10.2, 10.25, nan], [nan, 10.1, nan, 10.4, nan]])


def test_ranges_for_which_there_is_no_step_become_one(tmp_path):
    rows = "".join(f"{10.0 + 0.01 * number},3,{number}\n" for number in range(1, 5))
    dataset = read_dataset(write(tmp_path, ranges="t,anchor_id,range\n" + rows))
    emitted, ranges = dataset.beacons(np.array([10.0, 10.1, 10.2, 10.3]))
    np.testing.assert_array_equal(ranges[0], [np.nan, 2.0, 4.0, np.nan])
    np.testing.assert_allclose(emitted[0], [np.nan, 10.02, 10.04, np.nan])


def test_twice_as_many_ranges_as_steps_are_averaged_in_pairs_and_never_late(tmp_path):
    rows = "".join(f"{10.0 + 0.05 * number:.2f},3,{number}\n" for number in range(1, 41))
    dataset = read_dataset(write(tmp_path, ranges="t,anchor_id,range\n" + rows))
    emitted, ranges = dataset.beacons(10.0 + 0.1 * np.arange(1.0, 21.0))
    np.testing.assert_array_equal(ranges[0], np.arange(1.5, 41.0, 2.0))
    # A target that recedes at a constant rate: time and range of a mean still belong together.
    np.testing.assert_allclose(emitted[0], 10.0 + 0.05 * ranges[0])
    assert dataset.interval == pytest.approx(0.05)


def test_the_noise_of_the_motion_of_a_recorded_target_does_not_hang_on_the_step(tmp_path):
    rows = "".join(f"{10.0 + 0.2 * number:.2f},3,{number}\n" for number in range(1, 41))
    folder = write(tmp_path, ranges="t,anchor_id,range\n" + rows)
    for dt in (0.05, 0.1, 0.4):
        scenario = scenario_of(folder, f"dt={dt}", "filter.acceleration_std=2.0", "filter.motion=ncv")
        assert scenario.filter.acceleration_interval == pytest.approx(0.2)
        # Variance of the velocity after a second.
        assert Plan(scenario).plain_motion.process_noise[3, 3] / dt == pytest.approx(2.0**2 * 0.2)


def test_a_range_after_the_last_step_is_dropped(tmp_path):
    _, ranges = read_dataset(write(tmp_path)).beacons(np.array([10.0]))
    np.testing.assert_array_equal(ranges, [[1.0], [np.nan]])


def test_ranges_and_truth_need_not_be_sorted_in_the_files(tmp_path):
    def turned(text):
        head, *rows = text.splitlines()
        return "\n".join([head, *rows[::-1]]) + "\n\n"

    first = read_dataset(write(tmp_path / "a"))
    second = read_dataset(write(tmp_path / "b", ranges=turned(RANGES), truth=turned(TRUTH)))
    assert first.range_time.tolist() == second.range_time.tolist()
    assert first.ranges.tolist() == second.ranges.tolist()
    times = np.array([9.5, 12.0])
    assert first.truth_at(times).tolist() == second.truth_at(times).tolist()


def test_truth_is_interpolated_with_velocities_by_central_differences(tmp_path):
    truth = read_dataset(write(tmp_path)).truth_at(np.array([9.5, 10.0, 12.0]))
    expected = [
        [0.5, 1.0, 1.0, 1.0, 2.0, 0.0],
        [1.0, 2.0, 1.0, 1.0, 2.0, 0.0],
        [2.0, 4.0, 2.0, 0.0, 0.0, 1.0],
    ]
    np.testing.assert_allclose(truth, expected, atol=1e-12)


def test_step_zero_is_one_step_before_the_first_range(tmp_path):
    dataset = read_dataset(write(tmp_path))
    assert dataset.origin(0.1) == pytest.approx(9.9)
    assert dataset.steps(0.1) == 5
    assert dataset.steps(0.15) == 3
    assert dataset.steps(100.0) == 1


def test_a_byte_order_mark_is_no_part_of_the_header(tmp_path):
    folder = write(tmp_path)
    plain = read_dataset(folder)
    for path in folder.glob("*.csv"):
        path.write_text("\ufeff" + path.read_text(encoding="utf-8"), encoding="utf-8")
    assert read_dataset(folder).ranges.tolist() == plain.ranges.tolist()


def test_negative_ranges_are_left_out(tmp_path):
    dataset = read_dataset(write(tmp_path, ranges=RANGES + "10.3,7,-1\n"))
    assert len(dataset.ranges) == 5


def test_quoted_numbers_are_numbers(tmp_path):
    plain = read_dataset(write(tmp_path / "plain"))
    rows = RANGES.splitlines()
    quoted = "\n".join(",".join(f'"{value}"' for value in row.split(",")) for row in rows)
    read = read_dataset(write(tmp_path / "quoted", ranges=quoted))
    assert (read.ranges == plain.ranges).all()


def test_a_folder_in_place_of_a_file_is_said_to_be_one(tmp_path):
    folder = write(tmp_path / "set", ranges=None)
    (folder / "ranges.csv").mkdir()
    with pytest.raises(UserError, match=r"ranges\.csv is a folder, where a file of t,anchor_id,range has to be"):
        read_dataset(folder)


@pytest.mark.parametrize(
    ("files", "said"),
    [
        ({"anchors": None}, "anchors.csv is missing; a dataset folder holds"),
        ({"ranges": None}, "ranges.csv is missing"),
        ({"anchors": "id,x,y\n1,0,0\n"}, "anchors.csv does not begin with the header id,x,y,z"),
        ({"ranges": ""}, "ranges.csv does not begin with the header t,anchor_id,range"),
        ({"ranges": "t,anchor_id,range\n"}, "ranges.csv has no rows"),
        ({"ranges": "t,anchor_id,range\n\n  \n"}, "ranges.csv has no rows"),
        ({"ranges": "t,anchor_id,range\n1,3,-1\n"}, "ranges.csv has negative ranges only"),
        (
            {"ranges": "t,anchor_id,range\n1,3\n"},
            "not t,anchor_id,range in finite numbers: line 2 has 2 values",
        ),
        (
            {"ranges": "t,anchor_id,range\n1,3,x\n"},
            "ranges.csv has a line that is not t,anchor_id,range in finite numbers: line 2 has 'x'; correct it",
        ),
        ({"ranges": "t,anchor_id,range\n1,3,2\n1,3\n"}, "in finite numbers: line 3 has 2 values; correct it"),
        ({"ranges": "t,anchor_id,range\n1,3,2\n1,3,nan\n"}, "in finite numbers: line 3 has 'nan'; correct it"),
        ({"ranges": "t,anchor_id,range\n1,4,2\n"}, "ranges of anchor 4, which anchors.csv lacks; add it"),
        (
            {"ranges": "t,anchor_id,range\n1,3.5,2\n"},
            "ranges.csv has an anchor id that is not a whole number",
        ),
        ({"anchors": "id,x,y,z\n1,1e300,0,0\n"}, "anchors.csv has 1e+300 in the column x, which takes at most 1e+07"),
        ({"truth": "t,x,y,z\n-1e300,0,0,0\n"}, "truth.csv has -1e+300 in the column t, which takes at most 1e+12"),
        ({"ranges": "t,anchor_id,range\n0,1,1e200\n"}, "ranges.csv has 1e+200 in the column range"),
        ({"anchors": "id,x,y,z\n1e300,0,0,0\n"}, "anchors.csv has an anchor id that is not a whole number"),
        ({"anchors": ANCHORS + "3,1,1,1\n"}, "anchors.csv names an anchor twice"),
        ({"truth": "t,x,y,z\n"}, "truth.csv has no rows"),
    ],
)
def test_a_folder_that_is_no_dataset_is_refused_with_file_and_remedy(tmp_path, files, said, recwarn):
    folder = write(tmp_path / "set", **files)
    with pytest.raises(UserError) as caught:
        load("tracking", ["target.motion=dataset", f'target.path="{folder}"'])
    assert said in str(caught.value)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not recwarn.list


def test_a_dataset_that_the_disk_has_no_room_for_leaves_the_one_that_was_there(tmp_path):
    before = write(tmp_path / "set")
    files = {path.name: path.read_bytes() for path in before.iterdir()}
    dataset = read_dataset(before)
    longer = replace(
        dataset,
        range_time=np.arange(2000.0),
        range_anchor=np.zeros(2000, dtype=np.intp),
        ranges=np.ones(2000),
        truth_time=np.empty(0),
        truth=np.empty((0, 3)),
        order=None,
    )
    most, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, hard))
    try:
        with pytest.raises(UserError, match=r"cannot write .*ranges\.csv: File too large; make room"):
            write_dataset(longer, before)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, hard))
    assert {path.name: path.read_bytes() for path in before.iterdir()} == files
