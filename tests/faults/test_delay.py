"""Delays have the moments of their distribution, and keep the order of messages where they are told to."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.faults import Delay, Fates
from zenoh_cbef.streams import normal, stream

COUNT = 40_000


def delays(links=COUNT, step=1, round_=1, rounds=4, dt=0.1, **keys):
    numbers = np.arange(links)
    fault = Delay.model_validate({"kind": "delay", **keys})
    fates = Fates(
        [fault], seed=np.full(links, 5, dtype=np.uint64), source=numbers, destination=numbers + 1, dt=dt, rounds=rounds
    )
    return 1e3 * fates.of(step, round_).delay


@pytest.mark.parametrize(
    ("keys", "variance", "median"),
    [
        ({"distribution": "constant"}, 0.0, 8.0),
        ({"distribution": "constant", "jitter_ms": 6.0}, 3.0, 11.0),
        ({"distribution": "uniform"}, 64.0 / 3.0, 8.0),
        ({"distribution": "normal", "std_ms": 1.5}, 2.25, 8.0),
        ({"distribution": "normal", "std_ms": 0.0}, 0.0, 8.0),
        ({"distribution": "exponential"}, 64.0, 8.0 * np.log(2.0)),
        # A Pareto variable of shape a and least value x: mean a x/(a-1), variance a x^2/((a-1)^2 (a-2)).
        ({"distribution": "pareto", "shape": 5.0}, 5 * 6.4**2 / (16 * 3), 6.4 * 2 ** (1 / 5.0)),
    ],
)
def test_delays_have_the_moments_of_their_distribution(keys, variance, median):
    drawn = delays(milliseconds=8.0, **keys)
    mean = 8.0 + keys.get("jitter_ms", 0.0) / 2
    assert abs(drawn.mean() - mean) <= 5 * np.sqrt(variance / COUNT) + 1e-9
    assert abs(np.median(drawn) - median) < 0.15
    assert abs(drawn.var() - variance) <= 0.1 * variance + 1e-9


def test_a_pareto_delay_has_the_shape_3_where_none_is_said():
    found, said = (delays(milliseconds=6.0, distribution="pareto", **shape) for shape in ({}, {"shape": 3.0}))
    assert (found == said).all()


def test_pareto_delays_have_a_least_value_and_their_own_tail():
    drawn = delays(milliseconds=6.0, distribution="pareto", shape=3.0)
    assert drawn.min() >= 4.0 - 1e-9
    for factor in (1.5, 2.0, 3.0):
        share = factor**-3.0
        assert abs((drawn > 4.0 * factor).mean() - share) < 5 * np.sqrt(share * (1 - share) / COUNT)


def test_a_normal_delay_is_longer_where_its_draw_is_positive():
    key = stream(np.full(9, 5, dtype=np.uint64), "delay/0/size", np.arange(9), np.arange(9) + 1)
    drawn = delays(9, milliseconds=8.0, distribution="normal", std_ms=1.5)
    np.testing.assert_allclose(drawn, 8.0 + 1.5 * normal(key, 1, 1), rtol=1e-12)


def test_normal_delays_are_cut_off_at_zero():
    drawn = delays(milliseconds=1.0, distribution="normal", std_ms=1.0)
    assert drawn.min() == 0.0
    assert abs((drawn == 0.0).mean() - 0.158655) < 0.01


@pytest.mark.parametrize("since", [0.0, 0.45])
def test_without_reordering_a_message_arrives_when_those_before_it_have(since):
    keys = {"milliseconds": 30.0, "distribution": "exponential", "jitter_ms": 5.0, "from": since}
    latest = np.full(5, -np.inf)
    overtaking = 0
    for number in range(50):
        at = {"links": 5, "step": 1 + number // 5, "round_": number % 5}
        alone, ordered = delays(**at, **keys), delays(**at, **keys, reorder=False)
        sent = 20.0 * number
        if 0.1 * at["step"] < since:
            assert not ordered.any()
            continue
        arrival = np.maximum(sent + alone, latest)
        np.testing.assert_allclose(ordered, arrival - sent, rtol=0, atol=1e-9)
        overtaking += int((sent + alone < latest).sum())
        latest = arrival
    assert overtaking > 10


def test_a_message_waits_for_the_last_64_of_its_link_itself_among_them():
    keys = {"links": 400, "milliseconds": 50_000.0, "distribution": "exponential"}
    at = [{"step": 1 + number // 5, "round_": number % 5} for number in range(70)]
    arrivals = [delays(**one, **keys) - 20.0 * (69 - number) for number, one in enumerate(at)]
    np.testing.assert_allclose(delays(**at[-1], **keys, reorder=False), np.max(arrivals[-64:], axis=0), atol=1e-6)
