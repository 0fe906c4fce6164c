"""Where a draw falls below the probability, and not at it, a fault strikes: with probability 0 it never does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter

from zenoh_cbef.faults import AnyFault
from zenoh_cbef.faults.base import Messages
from zenoh_cbef.faults.sensing import Readings
from zenoh_cbef.streams import LinkStreams, stream, uniform

ANY: TypeAdapter[Any] = TypeAdapter(AnyFault)
SEED, ONE = np.array([7], dtype=np.uint64), np.array([1])


def struck(kind: str, probability: float) -> list[bool]:
    links = SEED, ONE, ONE + 1
    sent = Messages(
        *links, step=3, round=2, dt=0.1, per_step=3, ranges=False, streams=LinkStreams(*links, lanes=range(1, 3))
    )
    effect = ANY.validate_python({"kind": kind, "probability": probability}).effect(sent, 0)
    [found] = [one for one in vars(effect).values() if one is not None]
    return list(found)


@pytest.mark.parametrize("kind", ["loss", "corrupt", "duplicate", "reorder"])
def test_a_message_is_struck_where_its_draw_is_below_the_probability(kind: str) -> None:
    draw = float(uniform(stream(SEED, f"{kind}/0", ONE, ONE + 1), 3, 2)[0])
    assert struck(kind, draw) == [False]
    assert struck(kind, np.nextafter(draw, 1.0)) == [True]


@pytest.mark.parametrize("kind", ["sensor-dropout", "sensor-spikes"])
def test_a_range_is_struck_where_its_draw_is_below_the_probability(kind: str) -> None:
    draw = float(uniform(stream(7, f"{kind}/0", ONE[:, None]), np.array([3]))[0, 0])
    readings = Readings(7, ONE[:, None], np.array([3]), np.array([0.3]), np.array([[5.0]]), 3e8, np.array([[True]]))
    at, above = (
        ANY.validate_python({"kind": kind, "probability": probability}).measured(readings, 0)
        for probability in (draw, np.nextafter(draw, 1.0))
    )
    assert at == [[5.0]]
    assert above != [[5.0]]
