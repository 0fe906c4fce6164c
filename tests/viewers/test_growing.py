"""Viewers of a run that goes on see a step when all is there that its estimates tell of."""

import numpy as np
import pytest

from zenoh_cbef.log.read.header import Header
from zenoh_cbef.log.read.recording import Recording
from zenoh_cbef.scenario.load import load
from zenoh_cbef.tracking.diagnostics import NAMES
from zenoh_cbef.viewers.growing import GrowingScene

AGENTS, STEPS = 3, 20


def scene(lacking: str = "", steps: tuple[int, ...] = ()) -> GrowingScene:
    """A run that was heard for so many steps, but for messages of one kind and of these steps."""
    recording = Recording(Header("made", load("tracking", ["agents.count=3", "steps=50"]).plan, None))
    said = np.full((STEPS, len(NAMES)), np.nan)
    said[:, NAMES.index("innovation")] = 0.1
    numbers = {
        "truth": {"state": np.ones((STEPS, 6))},
        "beacons": {"heard": np.ones((STEPS, 3))},
        "ranges": {"position": np.ones((STEPS, 3))},
        "estimates": {"state": np.ones((STEPS, 6)), "said": said},
    }
    for name, values in numbers.items():
        known = np.setdiff1d(np.arange(1, STEPS + 1), steps if name == lacking else ())
        for row in range(1 if name == "truth" else AGENTS):
            getattr(recording, name).put(row, known, **{key: each[known - 1] for key, each in values.items()})
    return GrowingScene(recording)


def test_where_all_is_there_the_newest_step_is_shown():
    assert scene().settled(0, STEPS) == STEPS


@pytest.mark.parametrize("late", ["truth", "beacons", "ranges"])
def test_a_step_waits_for_what_comes_last(late):
    assert scene(late, (18,)).settled(0, STEPS) == 17
    assert scene(late, (STEPS,)).settled(STEPS - 1, STEPS) == STEPS - 1


@pytest.mark.parametrize("lost", ["truth", "beacons", "ranges"])
def test_what_does_not_come_for_long_is_waited_for_no_more(lost):
    assert scene(lost, (5,)).settled(0, STEPS) == STEPS


def test_a_target_that_has_no_truth_keeps_no_step_back():
    assert scene("truth", tuple(range(1, STEPS + 1))).settled(0, STEPS) == STEPS


def test_a_step_that_was_shown_is_not_taken_back():
    assert scene("truth", (15,)).settled(17, STEPS) == STEPS
