"""What `import` and `dataset check` say is odd about a recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.datasets.walked import EPOCH, STEPS, imported, written
from zenoh_cbef.cli.dataset import VERB as DATASET
from zenoh_cbef.datasets import read_dataset, write_dataset
from zenoh_cbef.datasets.findings import findings, summary
from zenoh_cbef.datasets.fixes import fixes
from zenoh_cbef.datasets.folder import read_files
from zenoh_cbef.datasets.picture import limits
from zenoh_cbef.errors import UserError


def as_dataset(folder):
    """The same files, by the names of a dataset's."""
    (folder / "stations.csv").rename(folder / "anchors.csv")
    return folder


def odd(folder, *options):
    """What `import` and `dataset check` say is odd about files: the same."""
    made = folder.parent / "set"
    said = imported(folder, "-o", made, "--force", *options)
    found = findings(read_files(made))
    assert all(" ".join(one.split()) in " ".join(said.split()) for one in found)
    assert ("next: zenoh-cbef run" in said) == (not found)
    checked = CliRunner().invoke(DATASET, ["check", str(made)])
    assert checked.exit_code == bool(found)
    return found


UNITS = {"millimetres": ("mm", 0.001), "centimetres": ("cm", 0.01), "feet": ("ft", 0.3048), "inches": ("in", 0.0254)}


@pytest.mark.parametrize("known", [STEPS, 0], ids=["truth", "none"])
@pytest.mark.parametrize("unit", UNITS)
def test_lengths_in_another_unit_are_told(tmp_path, unit, known):
    short, length = UNITS[unit]
    good = read_files(as_dataset(written(tmp_path, known=known)))
    for what, columns in {"ranges": ["range"], "anchors": ["anchors"], "truth": ["truth"]}.items():
        if known or what != "truth":
            changed = replace(good, **{what: getattr(good, what) / length})
            [said] = findings(changed)
            remedy = " ".join(f"--unit {column}={short}" for column in columns)
            look = "looks" if what == "truth" else "look"
            assert said.endswith(f": {what} {look} like {unit}; import them with {remedy}")
    if known:
        [said] = findings(replace(good, anchors=good.anchors / length, truth=good.truth / length))
        assert f"anchors and truth look like {unit}" in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("divided", "known", "remedy"),
    [
        ({"of": 0.3048}, 0, ["--unit", "range=ft"]),
        ({"corners": 0.001, "way": 0.001}, STEPS, ["--unit", "anchors=mm", "--unit", "truth=mm"]),
    ],
)
def test_what_is_told_of_units_mends_them(tmp_path, divided, known, remedy):
    folder = written(tmp_path, known=known, **divided)
    [said] = odd(folder)
    assert said.endswith(f"import them with {' '.join(remedy)}")
    assert odd(folder, *remedy) == []


def test_a_truth_of_a_part_is_told_with_the_part_that_is_scored(tmp_path):
    assert odd(written(tmp_path, known=51)) == ["the truth covers 5 of 19.9 s: only those are scored"]


@pytest.mark.parametrize("known", [STEPS, 0], ids=["truth", "none"])
@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1000.0, "1000 times too long beside all others: they look like millimetres; multiply them by 0.001"),
        (2.0, "2 times too long beside all others; multiply them by 0.5"),
        (0.5, "2 times too short beside all others; multiply them by 2"),
    ],
)
def test_an_anchor_alone_off_by_a_factor_is_named(tmp_path, factor, said, known):
    good = read_files(as_dataset(written(tmp_path, known=known)))
    ranges = good.ranges * np.where(good.range_anchor == 2, factor, 1.0)
    expected = f"the ranges of anchor c alone are {said}, or leave anchor c out"
    assert findings(replace(good, ranges=ranges)) == [expected]


def test_an_anchor_in_mm_is_named_by_size_where_no_fix_tells_and_by_run(tmp_path):
    good = read_files(as_dataset(written(tmp_path, known=0)))
    few = good.range_anchor < 3
    part = {name: getattr(good, name)[few] for name in ("range_time", "range_anchor", "ranges")}
    three = replace(good, labels=good.labels[:3], anchors=good.anchors[:3], **part, order=None)
    wrong = replace(three, ranges=three.ranges * np.where(three.range_anchor == 1, 1000.0, 1.0))
    [said] = findings(wrong)
    assert said.startswith("the ranges of anchor b alone are ")
    write_dataset(wrong, tmp_path / "set")
    with pytest.raises(UserError, match="the ranges of anchor b alone are"):
        read_dataset(tmp_path / "set")


@pytest.mark.parametrize("known", [STEPS, 0], ids=["truth", "none"])
def test_a_stuck_anchor_is_named_with_the_time(tmp_path, known):
    good = read_files(as_dataset(written(tmp_path, known=known)))
    mine = good.range_anchor == 3
    said = "anchor d is stuck: 7.777 m from {} s, while others' ranges change; leave these ranges out"
    whole = replace(good, ranges=np.where(mine, 7.777, good.ranges))
    assert findings(whole) == [said.format("0 to 19.9")]
    since = replace(good, ranges=np.where(mine & (good.range_time > 14.95), 7.777, good.ranges))
    assert said.format("15 to 19.9") in findings(since)


def test_a_target_at_rest_sticks_no_anchor(tmp_path):
    good = read_files(as_dataset(written(tmp_path, known=0)))
    rest = good.range_time >= 5.0
    resting = np.where(rest, good.ranges[np.argmax(rest) + np.arange(len(rest)) % 5], good.ranges)
    assert findings(replace(good, ranges=resting)) == []


@pytest.mark.parametrize("order", [(1, 0, 2), (2, 1, 0)], ids=["x and y", "x and z"])
def test_a_truth_with_exchanged_axes_is_told_and_not_taken_for_late(tmp_path, order):
    good = read_files(as_dataset(written(tmp_path)))
    names = " and ".join("xyz"[axis] for axis in range(3) if order[axis] != axis)
    said = f"the truth fits the ranges with its {names} exchanged: exchange the columns"
    assert findings(replace(good, truth=good.truth[:, order])) == [said]


@pytest.mark.parametrize(("late", "remedy"), [(3.0, "subtract 3 s from"), (-2.0, "add 2 s to")])
def test_a_truth_that_is_late_is_told_with_the_shift(tmp_path, late, remedy):
    good = read_files(as_dataset(written(tmp_path)))
    assert findings(replace(good, truth_time=good.truth_time + late)) == [
        f"the truth is on another clock: {remedy} its times, with which it fits the ranges best"
    ]


def test_a_truth_of_another_time_is_told_with_the_shift(tmp_path):
    good = read_files(as_dataset(written(tmp_path, known=151)))
    [said] = findings(replace(good, truth_time=good.truth_time + EPOCH))
    assert said.startswith("the truth is on another clock: its times go from 1700000000 to 1700000015 s, those of")
    assert f"; subtract {EPOCH} s from its times" in said


@pytest.mark.parametrize("known", [STEPS, 0], ids=["truth", "none"])
def test_swapped_anchors_are_found_with_and_without_a_truth(tmp_path, known):
    [said] = findings(read_files(as_dataset(written(tmp_path, order="acbde", known=known))))
    assert said.startswith("anchor b and c look swapped")


@pytest.mark.parametrize("known", [STEPS, 0], ids=["truth", "none"])
def test_nothing_is_odd_about_a_good_recording(tmp_path, known):
    assert findings(read_files(as_dataset(written(tmp_path, known=known)))) == []


def test_times_in_milliseconds_are_told(tmp_path):
    folder = written(tmp_path, seconds=0.001)
    [said] = odd(folder)
    assert "milliseconds; import them with --unit t=ms" in said
    assert odd(folder, "--unit", "t=ms") == []


def test_copies_of_ranges_are_counted_and_left_out_by_import(tmp_path):
    folder = as_dataset(written(tmp_path))
    lines = (folder / "ranges.csv").read_text().splitlines()
    head, *rows = lines
    for copies in (39, len(rows)):
        (folder / "ranges.csv").write_text(
            "\n".join([head, *(row for row in rows[:copies] for _ in "ab"), *rows[copies:]])
        )
        [said] = findings(read_files(folder))
        assert said.startswith(f"{copies} ranges are copies of others, with the same time, anchor and range; leave")
        told = " ".join(imported(folder, "-o", tmp_path / "set", "--force").split())
        assert f"note: {copies} copies of ranges left out: the same time, anchor and range" in told
        assert findings(read_files(tmp_path / "set")) == []
    assert summary(read_files(folder))["an anchor's ranges"] == "mostly several at the same time"


def test_two_passes_on_each_other_are_told_with_the_times(tmp_path):
    folder = written(tmp_path, known=0)
    lines = (folder / "ranges.csv").read_text().splitlines()
    later = [
        f"{float(time) - 10.0 * (float(time) >= 14.95):.3f},{rest}"
        for time, rest in (row.split(",", 1) for row in lines[1:])
    ]
    (folder / "ranges.csv").write_text("\n".join([lines[0], *later]))
    said = "the clock goes back from 14.9 to 5 s, and two passes lie on each other from 5 to 9.9 s; leave one out"
    assert odd(folder)[0].startswith(said)


def test_ranges_in_another_order_are_no_passes(tmp_path):
    folder = as_dataset(written(tmp_path, known=0))
    head, *rows = (folder / "ranges.csv").read_text().splitlines()
    for other in (rows[::-1], rows[500:] + rows[:500], sorted(rows, key=lambda row: row.split(",")[1])):
        (folder / "ranges.csv").write_text("\n".join([head, *other]))
        assert findings(read_files(folder)) == []


def test_a_silence_and_times_far_from_all_others_are_told(tmp_path):
    good = read_files(as_dataset(written(tmp_path)))
    assert findings(good) == []
    first, end = good.range_time[[0, -1]]
    silent = replace(good, range_time=good.range_time + 5.0 * (good.range_time > first + 10.0))
    assert "no range from 10 to 15.1 s" in findings(silent)
    stray = good.range_time.copy()
    stray[-1] += 2000.0
    said = f"1 range at t = {end + 2000.0:.12g} s far from all others, which are from {first:.12g} to "
    assert any(one.startswith(said) for one in findings(replace(good, range_time=stray)))


def test_a_fix_far_off_does_not_make_the_picture_large(tmp_path):
    good = read_files(as_dataset(written(tmp_path)))
    places = fixes(good).places.copy()
    places[3, :2] = 1e5, -1e5
    low, high = limits(good, places)
    assert np.all(low > -5.0)
    assert np.all(high < 30.0)
    assert np.all(low <= good.anchors[:, :2].min(axis=0))


def test_a_number_that_stands_for_no_range_is_told(tmp_path):
    made = as_dataset(written(tmp_path))
    whole = read_dataset(made)
    marked = whole.ranges.copy()
    marked[:200:20] = 65.535
    said = f"10 ranges are 65.53 m, and all others below {whole.ranges.max():.4g} m: leave out what says that nothing "
    assert findings(replace(whole, ranges=marked)) == [f"{said}was measured"]
    marked[0] = whole.ranges[0]
    assert not any("nothing was measured" in one for one in findings(replace(whole, ranges=marked)))


@pytest.mark.parametrize(("heights", "near"), [((2.9, 1.9, 3.0, 2.0, 1.6), True), ((4.4, 0.2, 4.5, 0.3, 2.9), False)])
def test_anchors_near_one_plane_are_told(tmp_path, heights, near):
    whole = read_dataset(as_dataset(written(tmp_path, known=0)))
    places = np.column_stack([whole.anchors[:, :2], heights])
    found = findings(replace(whole, anchors=places))
    assert any("may track the mirror image of the target" in one for one in found) == near


def test_a_truth_of_few_positions_is_told_where_the_target_turns_between_them(tmp_path):
    walk = read_files(as_dataset(written(tmp_path)))
    noisy = replace(walk, ranges=walk.ranges + 0.05 * np.random.default_rng(1).normal(size=len(walk.ranges)))
    assert findings(noisy) == []
    few = replace(noisy, truth_time=noisy.truth_time[::11], truth=noisy.truth[::11])
    [said] = findings(few)
    assert said.startswith("the truth has a position every 1.1 s and is taken for straight lines between them")
    assert said.endswith("and so are the errors that are shown: give a truth with more positions")
    # Of straight ways no position is missing.
    still = few.truth[0] + (few.truth_time - few.truth_time[0])[:, None] * np.array([0.1, 0.2, 0.0])
    assert not any("every 1.1 s" in one for one in findings(replace(few, truth=still)))


def test_what_lies_beyond_a_hole_of_the_truth_is_no_turn_between_two_positions(tmp_path):
    walk = read_files(as_dataset(written(tmp_path)))
    noisy = replace(walk, ranges=walk.ranges + 0.05 * np.random.default_rng(1).normal(size=len(walk.ranges)))
    kept = np.r_[0:40, 140 : len(walk.truth)]
    [said] = findings(replace(noisy, truth_time=noisy.truth_time[kept], truth=noisy.truth[kept]))
    assert said.startswith("the truth covers")
