"""What a proof compares: every estimate, payload and count, to the last bit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import pytest

from tests.log.made import made_log
from zenoh_cbef.log.common.naming import RESOLVED, SOURCE
from zenoh_cbef.log.prove.verify import Verdict, verify
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.scenario.model import Record

Message = dict[str, Any]
LAG = "filter.lag_seconds=0.3"
LOSS = 'fault=[{kind="loss", probability=0.3}]'


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made_log(tmp_path_factory.mktemp("proof") / "run.mcap", "steps=12", "agents.count=4", LAG, LOSS)


@pytest.fixture
def judged(log: Path, tmp_path: Path) -> Callable[..., Verdict]:
    def changed(kind: str, change: Callable[[Message], Message | None], tolerance: float = 0.0) -> Verdict:
        """The verdict on a copy in which agent 1's messages of a kind of step 7 are changed, or left out for None."""
        source, copy = open_log(log), RunLog(tmp_path / "changed.mcap", Record())
        texts = {name: source.attachments[name].decode() for name in (SOURCE, RESOLVED)}
        copy.describe(source=texts[SOURCE], resolved=texts[RESOLVED], run=source.metadata["cbef.run"])
        for raw in source.messages():
            message: Message | None = msgpack.unpackb(raw.data)
            if message is not None and raw.channel.topic.endswith(f"agent/1/{kind}") and message["k"] == 7:
                message = change(message)
            if message is not None:
                copy.add(raw.channel.topic, msgpack.packb(message), raw.log_time)
        copy.close({"status": "finished"})
        return verify(copy.path, tolerance=tolerance)

    return changed


def nudged(message: Message) -> Message:
    """By one unit in the last place of the first number."""
    first, *others = message["state"]
    return message | {"state": [float(np.nextafter(first, np.inf)), *others]}


def flipped(field: str) -> Callable[[Message], Message]:
    """The lowest bit of the fourth number."""

    def change(message: Message) -> Message:
        data = bytearray(message[field])
        data[24] ^= 1
        return message | {field: bytes(data)}

    return change


def test_what_is_not_changed_is_equal(judged):
    verdict = judged("estimate", lambda message: message)
    assert verdict.result == "equal"
    assert verdict.compared == 12 * 4 * (1 + 10 + 1)


@pytest.mark.parametrize(
    ("kind", "change", "what"),
    [
        ("estimate", nudged, "agent 1, step 7: state[0] is"),
        ("estimate", flipped("covariance"), "agent 1, step 7: covariance[3] is"),
        ("estimate", lambda one: one | {"covariance": None}, "agent 1, step 7: covariance is there in one only"),
        ("estimate", lambda one: one | {"nis": one["nis"] + 1e-9}, "agent 1, step 7: nis[0] is"),
        ("estimate", lambda one: one | {"nis_degrees": 5}, "agent 1, step 7: nis_degrees[0] is"),
        ("estimate", lambda one: one | {"duplicated": [9] * len(one["late"])}, "agent 1, step 7: duplicated is [9, "),
        ("estimate", lambda one: one | {"late": [0]}, "agent 1, step 7: its counts are not of its neighbours"),
        ("smoothed", nudged, "agent 1, step 7, smoothed up to 10: state[0] is"),
        ("smoothed", flipped("covariance"), "agent 1, step 7, smoothed up to 10: covariance[3] is"),
        ("smoothed", lambda one: one | {"until": 6}, "step 7, smoothed up to 6: no agent does that"),
        ("round", flipped("payload"), "agent 1, step 7, round 1: payload[3] is"),
    ],
)
def test_any_other_bit_is_found_and_named(judged, kind, change, what):
    verdict = judged(kind, change)
    assert verdict.result == "different"
    assert f"different: {what}" in verdict.text
    assert "np." not in verdict.text


def test_a_tolerance_lets_the_last_bit_pass_and_says_so(judged):
    verdict = judged("estimate", nudged, 1e-9)
    assert verdict.result == "equal"
    assert "equal within " in verdict.text


def test_a_message_that_is_not_in_the_log_is_counted(judged):
    verdict = judged("estimate", lambda _: None)
    assert "; 1 more are not in the log" in verdict.text


def test_an_agent_that_did_without_messages_is_not_taken_for_a_lie(judged):
    verdict = judged("estimate", lambda one: nudged(one) | {"received": [0 for _ in one["received"]]})
    assert verdict.result == "unknown"
    assert verdict.text.startswith("by step 7 agent 1 did without ")
