"""The terms of a fault: what it means where nothing is said, which values it takes, and whom it names."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from zenoh_cbef.faults import AnyFault, Loss, kind_of
from zenoh_cbef.faults.base import Between, Fault
from zenoh_cbef.faults.outgoing import SenderFault
from zenoh_cbef.faults.sensing import SensorFault

ANY: TypeAdapter[Any] = TypeAdapter(AnyFault)
NEEDED: dict[str, dict[str, Any]] = {
    "loss": {"probability": 0.5},
    "burst-loss": {"good_to_bad": 0.1, "bad_to_good": 0.2},
    "delay": {"milliseconds": 5.0},
    "rate-limit": {"messages_per_second": 5.0},
    "outage": {"agents": [2]},
    "pause": {"agents": [2], "until": 3.0},
    "crash": {"agents": [2, 4]},
    "byzantine": {"agents": [1]},
    "clock": {},
    "sensor-bias": {"bias": -0.5},
    "sensor-spikes": {"probability": 0.5},
    "sensor-dropout": {},
    "sensor-stuck": {},
}


def fault(kind: str, **more: Any) -> Any:
    return ANY.validate_python({"kind": kind, **NEEDED[kind], **more})


@pytest.mark.parametrize(
    ("kind", "expected"),
    [
        ("loss", {"links": "all", "since": 0.0, "until": None}),
        ("burst-loss", {"loss_in_good": 0.0, "loss_in_bad": 1.0}),
        ("delay", {"jitter_ms": 0.0, "distribution": "constant", "std_ms": None, "shape": 3.0, "reorder": True}),
        ("byzantine", {"mode": "constant", "magnitude": 5.0, "steps": 10, "memory": 0}),
        ("clock", {"offset": 0.0, "drift": 0.0, "agents": "all"}),
        ("sensor-spikes", {"std": 5.0}),
        ("sensor-dropout", {"probability": 1.0}),
        ("crash", {"forgets": True, "cuts": True}),
        ("pause", {"forgets": False, "cuts": True}),
        ("outage", {"cuts": True}),
        ("loss", {"cuts": False}),
    ],
)
def test_what_is_not_said_has_a_meaning(kind: str, expected: dict[str, object]) -> None:
    assert {name: getattr(fault(kind), name) for name in expected} == expected


@pytest.mark.parametrize(
    ("kind", "name", "taken", "refused"),
    [
        ("clock", "offset", [-1e6, 1e6], [-1e6 - 0.5, 1e6 + 0.5, np.nan]),
        ("clock", "drift", [-1.0, 1.0], [-1.5, 1.5, np.nan]),
        ("rate-limit", "messages_per_second", [0.0, 1e9], [-0.5, 1e9 + 0.5, np.nan]),
        ("delay", "shape", [1.1, 1e6], [1.0, 1e6 + 0.5, np.nan]),
        ("byzantine", "steps", [1, 10_000], [0, 10_001]),
        ("outage", "agents", [[0]], [[], "all"]),
        ("loss", "links", ["agent:0", [[0, 1]]], ["agent:", "agent:1234567", [[0]]]),
        ("loss", "unknown", [], [1]),
    ],
)
def test_the_last_value_is_taken_and_the_first_beyond_it_is_not(
    kind: str, name: str, taken: list[object], refused: list[object]
) -> None:
    for value in taken:
        fault(kind, **{name: value})
    for value in refused:
        with pytest.raises(ValidationError):
            fault(kind, **{name: value})


def test_the_states_of_a_link_must_mix() -> None:
    for total in (0.001, 1.999):
        assert fault("burst-loss", good_to_bad=total / 2, bad_to_good=total / 2)
    for total in (0.0009, 1.9991):
        with pytest.raises(ValidationError, match=r"between 0\.001 and 1\.999"):
            fault("burst-loss", good_to_bad=total / 2, bad_to_good=total / 2)


def test_an_agent_is_in_one_group_and_there_are_two() -> None:
    groups = {"between": [[0, 1], [2, 5]]}
    assert fault("loss", links=groups).named() == {0, 1, 2, 5}
    assert Between.model_validate({"between": [[0, 0], [1]]}).selects(
        np.array([0, 1, 0]), np.array([1, 0, 2])
    ).tolist() == [*(True, True, False)]
    with pytest.raises(ValidationError, match="agent 1 in two groups"):
        fault("loss", links={"between": [[0, 1], [2], [1]]})
    with pytest.raises(ValidationError):
        fault("loss", links={"between": [[0, 1]]})


def test_a_fault_names_the_agents_that_a_scenario_must_have() -> None:
    assert fault("clock").named() == set()
    assert fault("clock", agents=[3]).named() == {3}
    assert fault("outage").named() == {2}
    assert fault("crash").named() == {2, 4}
    assert fault("byzantine").named() == {1}
    assert fault("loss", links=[]).named() == set()
    everyone, one = fault("sensor-stuck"), fault("sensor-stuck", agents=[1])
    assert (everyone.selects(np.arange(3)).tolist(), one.selects(np.arange(3)).tolist()) == (
        [True, True, True],
        [False, True, False],
    )


def test_how_wrong_a_sensor_gets_is_told_where_it_is_known() -> None:
    assert fault("sensor-bias").error == 0.5
    assert fault("sensor-spikes", std=2.0).error == 20.0
    assert fault("sensor-dropout").error == fault("sensor-stuck").error == 0.0
    assert fault("clock").error == np.inf


def test_only_a_replay_looks_back() -> None:
    assert fault("byzantine", mode="replay", steps=4).memory == 4
    assert SenderFault(kind="any", agents=(1,)).memory == 0


def test_a_delay_needs_its_standard_deviation_where_it_is_normal_and_only_there() -> None:
    assert fault("delay", distribution="normal", std_ms=1.0).std_ms == 1.0
    with pytest.raises(ValidationError, match="std_ms is missing"):
        fault("delay", distribution="normal")
    with pytest.raises(ValidationError, match="is for distribution 'normal', not 'uniform'"):
        fault("delay", distribution="uniform", std_ms=1.0)


def test_a_kind_says_whom_it_names_and_what_it_does() -> None:
    for base, method, arguments in (
        (Fault(kind="any"), "named", ()),
        (SensorFault(kind="any"), "measured", (None, 0)),
        (SenderFault(kind="any", agents=(1,)), "sent", (None, 0)),
    ):
        with pytest.raises(NotImplementedError):
            getattr(base, method)(*arguments)
    one = Fault.model_validate({"kind": "any", "from": 1.0, "until": 2.0})
    with pytest.raises(ValidationError, match="frozen"):
        one.until = 3.0
    times = np.array([0.9, 1.0, 1.9, 2.0])
    assert one.during(times).tolist() == [one.active(time) for time in times] == [False, True, True, False]


def test_a_kind_is_found_by_its_name() -> None:
    assert kind_of("loss") is Loss
    with pytest.raises(ValueError, match="nothing"):
        kind_of("nothing")


def test_a_fault_of_another_package_that_was_read_stays_what_it_is() -> None:
    one = Fault(kind="mine:Odd")
    assert ANY.validate_python(one) is one
