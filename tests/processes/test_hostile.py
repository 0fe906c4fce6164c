"""Malformed, foreign and hostile messages are counted, reported and dropped; the estimates do not change by a bit."""

import math
import struct
import time

import msgpack
import pytest
import zenoh

from tests.processes.conftest import outsider, settings
from tests.waiting import until


def forged(run: str, sender: str, **body) -> bytes:
    envelope = {"v": 1, "run": run, "from": sender, "seq": 0, "sent": time.time_ns()}
    return msgpack.packb({**envelope, **body})


def attacks(run: str) -> list[tuple[str, bytes]]:
    """Keys and bytes that no process of the run would send."""
    nan = struct.pack("<30d", *[math.nan] * 30)
    good = {"k": 1, "l": 1, "payload": b"\0" * 240}
    bodies = [
        b"",
        b"\xc1",
        b"\x81" * 300,
        msgpack.packb([1, 2, 3]),
        msgpack.packb({"k": 1}),
        forged("another", "agent/1", **good),
        forged(run, "agent/0", **good),
        forged(run, "agent/1", **(good | {"payload": nan})),
        forged(run, "agent/1", **(good | {"payload": struct.pack("<30d", *[1e200] * 30)})),
        forged(run, "agent/1", **(good | {"payload": b"\0" * 24})),
        forged(run, "agent/1", **(good | {"k": 10**12})),
        forged(run, "agent/1", **(good | {"l": 999})),
        forged(run, "agent/1", **(good | {"extra": 1})),
        forged(run, "agent/1", k=True, l="one", payload=None),
        forged(run, "agent/1", k=1, state=[1.0] * 6),
        b"x" * (2 << 20),
    ]
    keys = [
        "agent/1/round",
        "agent/1/range",
        "agent/1/estimate",
        "agent/77/estimate",
        "beacon/1",
        "nonsense/deep/er",
    ]
    return [(f"cbef/{run}/{key}", body) for key in keys for body in bodies]


def wait_for(session: zenoh.Session, token: str) -> None:
    seen = session.liveliness()
    until(lambda: any(reply.ok is not None for reply in seen.get(token, timeout=1.0)), "the target did not come")


@pytest.mark.parametrize("kind", ["sicf", "cbef"])
def test_hostile_messages_change_no_bit_and_are_counted(world, endpoint, kind):
    overrides = settings("steps=60", f"filter.kind={kind}")
    join = world.join(endpoint)
    target = world.start("target", "tracking", *overrides, "--run", world.run, "--listen", endpoint)
    with outsider(endpoint) as session:
        wait_for(session, f"cbef/{world.run}/live/target/target")

        def attack(_number: int) -> None:
            for key, body in attacks(world.run):
                session.put(key, body)
            time.sleep(0.05)

        world.complete_under(attack, target, join)
    world.verdict()
    metrics = world.metrics()
    assert metrics["messages"]["rejected"] > 0
    assert metrics["messages"]["missing"] == 0
    assert metrics["steps"] == 60
    assert all(link["lost"] == 0 for link in metrics["links"])


@pytest.mark.parametrize("mode", ["lockstep", "realtime"])
def test_a_flood_on_one_key_does_not_stop_the_consensus(world, endpoint, mode):
    # Where the flood is faster than the receivers, what it drowns counts as silent in lockstep and as lost in realtime.
    overrides = ["steps=5", f"timing.mode={mode}", "timing.patience=0.2", "dt=0.05"]
    join = world.join(endpoint)
    target = world.start("target", "tracking", *settings(*overrides), "--run", world.run, "--listen", endpoint)
    with outsider(endpoint) as session:
        wait_for(session, f"cbef/{world.run}/live/target/target")
        flood = session.declare_publisher(f"cbef/{world.run}/agent/1/round")
        message = forged(world.run, "agent/1", k=1, l=1, payload=b"\0" * 24)

        def attack(_number: int) -> None:
            # Tens of thousands in a second, more than a receiver takes in; all that a core can send starves the rest.
            for _ in range(50):
                flood.put(message)
            time.sleep(0.001)

        printed = world.complete_under(attack, target, join)
    assert all("messages in" in out or "ended after step 5" in out for out in printed)
