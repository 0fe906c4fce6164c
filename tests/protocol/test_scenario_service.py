"""The scenario and the clock, asked for between real sessions, and answers of strangers, told in a sentence."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import msgpack
import pytest
import zenoh

from tests.protocol.conftest import Pair
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import VERSION
from zenoh_cbef.protocol.scenario_service import (
    Clock,
    ScenarioText,
    fetch_scenario,
    measure_clock,
    read_scenario,
    serve_scenario,
    time_in,
)
from zenoh_cbef.protocol.session import Connection

TEXT = ScenarioText("seed = 1", "seed = 1\nsteps = 2", "0.1", step=4, agents=(0, 2), faults="[]")
PLAIN = {"v": VERSION, "source": "a", "resolved": "b", "program": "c"}


def test_the_scenario_of_a_target_is_that_of_the_moment(pair: Pair) -> None:
    texts = [TEXT, replace(TEXT, step=5)]
    service = serve_scenario(pair[0], "mine", lambda: texts.pop(0))
    first, second = (fetch_scenario(pair[1], "mine", Connection(), patience=20.0) for _ in range(2))
    assert (first, second) == (TEXT, replace(TEXT, step=5))
    service.undeclare()


def test_a_target_that_comes_late_is_waited_for(pair: Pair) -> None:
    begun = time.monotonic()
    with pytest.raises(UserError, match="no target of run 'mine' answers: no run is on"):
        fetch_scenario(pair[1], "mine", Connection(), patience=0.2)
    assert time.monotonic() - begun >= 0.2
    with pytest.raises(UserError, match="no target"):
        fetch_scenario(pair[1], "mine", Connection(), patience=1e6, stopped=lambda: True)


def test_targets_that_differ_are_not_chosen_from(pair: Pair) -> None:
    both = [serve_scenario(one, "mine", lambda: TEXT) for one in pair]
    each: dict[str, Any] = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}
    until(lambda: len(list(pair[1].get("cbef/mine/scenario", **each))) == 2)
    assert fetch_scenario(pair[1], "mine", Connection(), patience=20.0) == TEXT
    both[1].undeclare()
    both[1] = serve_scenario(pair[1], "mine", lambda: replace(TEXT, resolved="other"))
    with pytest.raises(UserError, match="2 targets answer for run 'mine'"):
        fetch_scenario(pair[1], "mine", Connection(), patience=20.0)


def test_the_clock_is_that_of_the_fastest_answer_and_needs_no_scenario(pair: Pair, monkeypatch) -> None:
    assert measure_clock(pair[1], "mine") is None

    def refused() -> ScenarioText:
        raise AssertionError

    service = serve_scenario(pair[0], "mine", refused)
    honest = time.time_ns
    asked = []
    while (clock := measure_clock(pair[1], "mine")) is None:
        time.sleep(0.01)
    assert 0.0 < clock.round_trip < 60.0
    assert abs(clock.ahead) <= clock.round_trip / 2, "one host has one clock"
    # Before and after each question, and the target in between: the second answer is the fastest, and the third slow.
    seconds = iter([0, 4, 8, 10, 17, 12, 20, 36, 60, 70, 75, 80])

    def times() -> int:
        asked.append(next(seconds))
        return asked[-1] * 10**9

    monkeypatch.setattr(time, "time_ns", times)
    clock = measure_clock(pair[1], "mine")
    monkeypatch.setattr(time, "time_ns", honest)
    assert len(asked) == 12, "four questions"
    assert clock is not None
    assert (clock.ahead, clock.round_trip) == pytest.approx((11.0 - 17.0, 2.0))
    service.undeclare()


@pytest.mark.parametrize(
    ("clock", "moment"),
    [(Clock(1.2, 0.2), 10.0), (Clock(1.21, 0.2), 11.21), (Clock(-3600.0, 0.5), -3590.0), (Clock(-1.0, 0.0), 10.0)],
)
def test_clocks_that_are_less_than_a_second_apart_are_taken_for_one(clock: Clock, moment: float) -> None:
    assert clock.ours(10.0) == pytest.approx(moment)


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"\xc1", "something that is no scenario"),
        (msgpack.packb(PLAIN | {"v": VERSION + 1}), f"speaks protocol version {VERSION + 1}, this program {VERSION}"),
        (msgpack.packb({"v": VERSION}), "is its target a zenoh-cbef"),
        *((msgpack.packb(PLAIN | {name: 1}), "is its target a zenoh-cbef") for name in PLAIN if name != "v"),
    ],
)
def test_an_answer_that_is_no_scenario_is_told_in_a_sentence(answer: bytes, words: str) -> None:
    with pytest.raises(UserError, match=words):
        read_scenario(answer, "mine")


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        ({}, (None, (), "")),
        ({"step": 3, "agents": [0, 1], "faults": "[]"}, (3, (0, 1), "[]")),
        ({"step": -1, "agents": [-1], "faults": 1}, (None, (), "")),
        ({"step": "1", "agents": 1}, (None, (), "")),
    ],
)
def test_what_an_answer_lacks_or_has_of_another_kind_counts_as_not_told(more: dict, expected: tuple) -> None:
    text = read_scenario(msgpack.packb(PLAIN | more), "mine")
    assert (text.source, text.resolved, text.program) == ("a", "b", "c")
    assert (text.step, text.agents, text.faults) == expected


def test_a_time_is_a_count_or_none() -> None:
    assert time_in(msgpack.packb({"time": 5})) == 5
    assert time_in(msgpack.packb({"time": -5})) is None
    assert time_in(b"\xc1") is None
