"""Numbers of a scenario that do not fit each other are warned of, in one sentence with the remedy."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load


def said(*overrides):
    return check(load("tracking", overrides).plan)


@pytest.mark.parametrize(
    ("overrides", "words", "remedy"),
    [
        (["dt=5"], "steps of dt = 5 s are long", "set dt to 2.5 or less"),
        (["dt=1", "target.motion=circle", "agents.count=2"], "long for a target that turns", "set dt to 0.5 or less"),
        (["dt=100"], "steps of dt = 100 s are long", "milliseconds"),
        (["sensor.range_std=30"], "larger than half of the box", "in metres"),
        (["filter.range_std=0.05"], "the receivers have sensor.range_std = 0.1 m", "'auto'"),
        (["filter.range_std=0.2"], "the receivers have sensor.range_std = 0.1 m", "'auto'"),
        (["filter.planar_height=0"], "away from that plane", "leave filter.planar_height out"),
        (
            ["filter.planar_height=0", "target.velocity=[0.5,0.3,0.03]", "target.acceleration_std=0.01"],
            "away from that plane",
            "leave filter.planar_height out",
        ),
        (
            ["agents.count=4", "agents.positions=[[-10,0,0],[-4,0.1,0],[3,0,0.1],[10,0,0]]"],
            "the geometry is weak",
            "around its path",
        ),
        (["target.velocity=[100,0,0]"], "the geometry is weak", "around its path"),
    ],
)
def test_what_does_not_fit_is_told_with_a_remedy(overrides, words, remedy):
    found = [warning for warning in said(*overrides) if words in warning]
    assert len(found) == 1
    assert remedy in found[0]


@pytest.mark.parametrize(
    "overrides",
    [
        [],
        ["dt=0.5"],
        ["dt=1", "target.motion=circle"],
        ["agents.low=-100", "agents.high=100"],
        ["filter.range_std=0.13"],
        ["filter.range_std=auto"],
        ["target.motion=circle", "filter.planar_height=0"],
        ["seed=7", "agents.count=5"],
    ],
)
def test_what_fits_is_not_warned_of(overrides):
    assert said(*overrides) == []


def recorded(folder, std, step=0.25):
    random = np.random.default_rng(3)
    anchors = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 1.0], [0.0, 10.0, 2.0], [10.0, 10.0, 8.0]])
    time = step * np.arange(1, 121)
    truth = np.stack([5.0 + np.sin(time / step / 9.0), 5.0 + np.cos(time / step / 9.0), np.full(120, 3.0)], axis=1)
    (folder / "anchors.csv").write_text(
        "id,x,y,z\n" + "".join(f"{i},{x},{y},{z}\n" for i, (x, y, z) in enumerate(anchors.tolist()))
    )
    rows = []
    for k, at in enumerate(time.tolist()):
        for i, anchor in enumerate(anchors):
            rows.append(f"{at},{i},{np.linalg.norm(truth[k] - anchor) + 0.3 + std * random.normal()}\n")
    (folder / "ranges.csv").write_text("t,anchor_id,range\n" + "".join(rows))
    lines = [f"{t},{x},{y},{z}\n" for t, (x, y, z) in zip(time.tolist(), truth.tolist(), strict=True)]
    (folder / "truth.csv").write_text("t,x,y,z\n" + "".join(lines))
    return ["target.motion=dataset", f"target.path={folder}", "dt=0.25"]


def test_recorded_ranges_that_scatter_otherwise_than_the_filter_takes_them_to_are_told(tmp_path):
    keys = recorded(tmp_path, 0.8)
    [found] = [warning for warning in said(*keys, "filter.range_std=0.1") if "scatter" in warning]
    assert "range noise for 0.1 m" in found
    assert 0.6 < float(found.split("scatter by ")[1].split(" m")[0]) < 1.0
    assert not any("scatter" in warning for warning in said(*keys, "filter.range_std=0.7"))
    assert not any("scatter" in warning for warning in said(*keys, "filter.range_std=auto"))


def test_times_in_milliseconds_are_told(tmp_path):
    keys = recorded(tmp_path, 0.1, step=250.0)
    assert any("milliseconds" in warning for warning in said(*keys, "steps=50"))


WIDE = ("filter.initial_position=[50,0,0]", "filter.initial_position_std=50")


@pytest.mark.parametrize(
    ("sets", "remedy"),
    [
        (("filter.kind=ci",), "or use filter.kind = 'sicf'"),
        (("filter.kind=diffusion",), "or use filter.kind = 'sicf'"),
        (("filter.start=given",), "or leave filter.start out"),
    ],
)
def test_a_filter_that_takes_a_wide_guess_as_it_is_is_warned_of(sets, remedy):
    (told,) = [one for one in said(*sets, *WIDE) if "no first fix" in one]
    assert "721.7 times" in told
    assert told.endswith(remedy)
    assert not [one for one in said(*sets) if "no first fix" in one]


@pytest.mark.parametrize("sets", [(), ("filter.kind=icf",), ("filter.kind=cbef",), ("agents.count=16",)])
def test_not_of_one_that_makes_a_fix_or_needs_none(sets):
    assert not [one for one in said(*sets, *WIDE) if "no first fix" in one]


def test_steps_in_which_a_recorded_target_turns_are_told(tmp_path):
    keys = recorded(tmp_path, 0.1)
    [told] = [one for one in said(*keys, "dt=1.5") if "long for this recording" in one]
    assert "set dt to 0.2, or to 0.4 at most" in told
    assert not [one for one in said(*keys, "dt=0.4") if "long for this recording" in one]


def test_recorded_anchors_near_one_plane_are_told_where_no_height_is_given(tmp_path):
    keys = recorded(tmp_path, 0.1)
    rows = (tmp_path / "anchors.csv").read_text().splitlines()
    heights = "8.0", "9.0", "8.9", "8.1"
    level = [",".join([*row.split(",")[:3], height]) for row, height in zip(rows[1:], heights, strict=True)]
    assert not [one for one in said(*keys) if "mirror image" in one]
    (tmp_path / "anchors.csv").write_text("\n".join([rows[0], *level]))
    assert [one for one in said(*keys) if "may track the mirror image of the target; give filter.planar_height" in one]
    guess = "filter.initial_position=[5,5,3]"
    for told in (["filter.planar_height=3"], [guess, "filter.initial_position_std=1"]):
        assert not [one for one in said(*keys, *told) if "mirror image" in one]
    assert [one for one in said(*keys, guess, "filter.initial_position_std=9") if "mirror image" in one]


def test_anchors_that_a_coarse_noise_leaves_near_one_plane_are_told(tmp_path):
    keys = recorded(tmp_path, 0.1)
    assert not [one for one in said(*keys, "filter.range_std=0.1") if "mirror image" in one]
    assert [one for one in said(*keys, "filter.range_std=2.0") if "mirror image" in one]
