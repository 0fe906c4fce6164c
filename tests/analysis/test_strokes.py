"""Maps draw the paths of agents from their first fix on, faintly until it is proved."""

import math

import numpy as np

from tests.datasets.made import scenario_of, write
from zenoh_cbef.analysis.standing import paths_by_stroke, paths_of, strokes_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.status import ACQUIRING, FAINT, strokes


def traced(*overrides: str):
    [trace] = simulate([load("tracking", ["steps=60", *overrides]).scenario])
    return trace


def test_a_path_with_a_guess_is_drawn_from_its_first_step():
    trace = traced()
    begun = trace.diagnostics.status[0] == ACQUIRING
    assert begun.any()
    assert strokes_of(trace)[0].tolist() == np.where(begun, FAINT, 1.0).tolist()
    np.testing.assert_array_equal(paths_of(trace), trace.estimates[:, :, :3])
    (pale, whole), (full, sure) = paths_by_stroke(trace, 0)
    assert (pale, full) == (FAINT, 1.0)
    assert np.isfinite(whole).all()
    assert np.isfinite(sure[:, 0]).tolist() == (~begun).tolist()


def test_a_path_without_a_guess_is_drawn_from_its_fix(tmp_path):
    anchors, steps = [(0, 0, 2), (9, 0, 0), (9, 7, 3), (0, 7, 1), (4, 3, 4)], 40
    at = [(2 + 0.02 * k, 3 + 0.01 * k, 1) for k in range(steps)]
    rows = [f"{0.1 * k},{row},{math.dist(place, at[k])}\n" for k in range(steps) for row, place in enumerate(anchors)]
    text = "id,x,y,z\n" + "".join(f"{row},{x},{y},{z}\n" for row, (x, y, z) in enumerate(anchors))
    write(tmp_path / "set", anchors=text, ranges="t,anchor_id,range\n" + "".join(rows), truth=None)
    [trace] = simulate([scenario_of(tmp_path / "set", "dt=0.1", "filter.range_std=0.1")])
    drawn, fix = strokes_of(trace), trace.plan.first_fix_steps
    assert fix > 1
    assert (drawn[:, : fix - 1] == 0.0).all()
    assert (drawn[:, fix:] > 0.0).all()


def test_a_filter_that_says_nothing_is_drawn():
    assert strokes(np.array([np.nan]), np.array([np.nan]), 2.0).tolist() == [1.0]
    assert strokes(np.zeros(2), np.array([1.9, 2.0]), 2.0).tolist() == [0.0, FAINT]
