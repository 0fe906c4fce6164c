"""What an agent says of a step: the fields of its messages, made of one row of a batch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol import kinds
from zenoh_cbef.protocol.bodies import diagnostics_body, divergence, estimate_body, range_body, smoothed_body
from zenoh_cbef.protocol.messages import decode, encode, pack_floats
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.smoothing import Smoothed
from zenoh_cbef.tracking.tracker import Estimate

COUNTS = {name: [1, 2] for name in ("neighbours", "received", "lost", "late")} | {"latency": [None, 0.5]}
STATE = np.arange(12.0).reshape(2, 6)
COVARIANCE = np.arange(72.0).reshape(2, 6, 6)
TOLD = Diagnostics.of(
    2, innovation=np.array([np.nan, 1.5]), nis_degrees=np.array([0, 2]), distrust=np.array([0.25, np.nan])
)
ESTIMATE = Estimate(STATE, COVARIANCE, TOLD, np.zeros(2, dtype=bool))


def test_a_range_that_was_not_measured_is_nil() -> None:
    position = np.array([1.0, 2.0, 3.0])
    assert range_body(4, position, 2.5) == {"k": 4, "position": [1.0, 2.0, 3.0], "range": 2.5}
    assert range_body(4, position, np.nan)["range"] is None


def test_diagnostics_are_left_out_only_where_a_message_may_lack_them() -> None:
    first, second = diagnostics_body(TOLD, 0), diagnostics_body(TOLD, 1)
    assert (first["innovation"], first["nis_degrees"], first["distrust"]) == (None, 0, 0.25)
    assert (second["innovation"], second["nis_degrees"]) == (1.5, 2)
    assert type(second["nis_degrees"]) is int
    assert "distrust" not in second
    assert "bias" not in first


@pytest.mark.parametrize("row", [0, 1])
def test_an_estimate_is_that_of_its_row(row: int) -> None:
    body = estimate_body(7, ESTIMATE, row, 3, COUNTS)
    assert (body["k"], body["state"]) == (7, STATE[row].tolist())
    assert body["covariance"] == pack_floats(COVARIANCE[row])
    assert {name: body[name] for name in COUNTS} == COUNTS
    assert body.items() >= diagnostics_body(TOLD, row).items()
    assert decode(kinds.ESTIMATE, encode("test", "agent/3", 0, 0, body), run="test")["k"] == 7
    assert estimate_body(7, replace(ESTIMATE, covariance=None), row, 3, COUNTS)["covariance"] is None


def test_an_estimate_that_is_not_finite_is_told_by_agent_and_step() -> None:
    state = STATE.copy()
    state[1, 4] = np.inf
    wild = replace(ESTIMATE, state=state)
    assert estimate_body(7, wild, 0, 3, COUNTS)["k"] == 7
    with pytest.raises(UserError, match="agent 3's estimate is no longer finite at step 7; the filter diverges"):
        estimate_body(7, wild, 1, 3, COUNTS)
    assert divergence(2, 9).startswith("agent 2's estimate is no longer finite at step 9")


def test_a_smoothed_estimate_says_until_when_it_knows() -> None:
    smoothed = Smoothed(3, 8, STATE, COVARIANCE, np.ones(2, dtype=bool))
    body = smoothed_body(smoothed, 1)
    assert body == {"k": 3, "until": 8, "state": STATE[1].tolist(), "covariance": pack_floats(COVARIANCE[1])}
    assert decode(kinds.SMOOTHED, encode("test", "agent/3", 0, 0, body), run="test")["until"] == 8
