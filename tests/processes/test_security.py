"""Runs with certificates: they compute the same, and a certificate's holder cannot speak for another."""

import time

import numpy as np
import pytest
import zenoh

from tests.processes.conftest import settings
from tests.processes.test_hostile import forged, wait_for
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.tls import Tls


@pytest.fixture
def certificates(world):
    world.done("certs", "new", "certificates", "--agents", "5")
    return world.folder / "certificates"


def test_run_with_certificates_equals_the_simulator(world, certificates):
    world.complete(f"zenoh.tls={certificates}")
    assert world.verdict().startswith("equal bit for bit")


@pytest.mark.parametrize("way", ["target", "router"])
def test_who_has_an_agents_certificate_cannot_change_a_bit_of_another(world, certificates, free_port, way):
    endpoint = f"tls/127.0.0.1:{free_port}"
    join = ["--run", world.run, "--connect", endpoint, "--patience", "100", "--tls", str(certificates)]
    place = ["--listen", endpoint, "--tls", str(certificates)]
    if way == "router":
        join.append("--client")
        router = world.start("router", *place)
        place = join[2:]
    target = world.start("target", "tracking", *settings("steps=60"), "--run", world.run, *place)
    # As a client it reaches all that router or target are linked to.
    connection = Connection([endpoint], mode="client", tls=Tls.of_folder(certificates, "agent-4"))
    with open_session(connection, patience=20) as intruder:
        wait_for(intruder, f"cbef/{world.run}/live/target/target")
        spy = intruder.declare_subscriber(f"cbef/{world.run}/target/truth", zenoh.handlers.FifoChannel(1000))

        def attack(sequence: int) -> None:
            step, round_ = divmod(sequence, 3)
            body = {"k": 1 + step % 60, "l": 1 + round_, "payload": bytes(240)}
            intruder.put(f"cbef/{world.run}/agent/1/round", forged(world.run, "agent/1", **body))
            intruder.put(f"cbef/{world.run}/beacon/1", forged(world.run, "target", k=1, emitted=0.0, arrived=1.0))
            # A flood of last words, too: in its own name, and in another's.
            event = {"kind": "finished", "text": "an intruder is here", "data": {"word": 10**15 + sequence}}
            for sender in ("agent/4", "agent/1", "target"):
                said = forged(world.run, sender, **event)
                intruder.put(f"cbef/{world.run}/event/{sender}", said)
                intruder.put(f"cbef/{world.run}/event/agent/4", said)
                intruder.put(f"cbef/{world.run}/event", said)
            signal = forged(world.run, "target", k=1, signal="end")
            intruder.put(f"cbef/{world.run}/beacon/1/signal", signal)
            time.sleep(0.001)

        world.complete_under(attack, target, join)
        assert spy.handler.try_recv() is None
    if way == "router":
        assert router.poll() is None
    assert world.verdict().startswith("equal bit for bit")
    metrics = world.metrics()
    assert (metrics["complete"], metrics["messages"]["missing"]) == (True, 0)
    heard = [message.channel.topic for message in McapFile(world.log).messages()]
    # A target is trusted with its own messages only, so it cannot pass on others'.
    assert (f"cbef/{world.run}/event/agent/4" in heard) == (way == "router")
    assert f"cbef/{world.run}/event" not in heard


def test_a_receivers_certificate_neither_ends_a_run_nor_makes_an_estimate_infinite(world, certificates, free_port):
    endpoint = f"tls/127.0.0.1:{free_port}"
    security = ["--tls", str(certificates)]
    join = ["--run", world.run, "--client", "--connect", endpoint, "--patience", "100", *security]
    world.start("router", "--listen", endpoint, *security)
    target = world.start("target", "tracking", *settings("steps=60"), *join)
    tls = Tls.of_folder(certificates, "receiver")
    with open_session(Connection([endpoint], mode="client", tls=tls), patience=20) as intruder:
        wait_for(intruder, f"cbef/{world.run}/live/target/target")

        def attack(sequence: int) -> None:
            far = {"k": 1 + sequence % 60, "emitted": 1e200, "arrived": [1e200, -1e200, 1e9][sequence % 3]}
            for agent in range(4):
                key = f"cbef/{world.run}/beacon/{agent}"
                intruder.put(key, forged(world.run, "target", **far))
                intruder.put(key, forged(world.run, "target", **(far | {"signal": "end"})))
                intruder.put(f"{key}/signal", forged(world.run, "target", k=1, signal="end"))
            time.sleep(0.002)

        printed = world.complete_under(attack, target, join)
    assert all("messages in" in out or "ended after step 60" in out for out in printed)
    trace = read_trace(world.log)
    assert np.isfinite(trace.estimates).all()
    assert trace.traffic.rejected > 0
    signals = [message for message in McapFile(world.log).messages() if message.channel.topic.endswith("/signal")]
    assert len(signals) == 8


def test_a_process_without_certificates_does_not_join(world, certificates, free_port):
    endpoint = f"tls/127.0.0.1:{free_port}"
    world.start("target", "tracking", *settings(), "--run", world.run, "--listen", endpoint, "--tls", str(certificates))
    for way in (["--connect", endpoint], ["--connect", endpoint.replace("tls/", "tcp/")]):
        refused = world.done("agent", "0", "--run", world.run, *way, "--patience", "3", status=2)
        assert len(refused.stderr.splitlines()) == 1
    let_in = world.start("agent", "0", "--run", world.run, "--connect", endpoint, "--tls", str(certificates))
    time.sleep(3)
    assert let_in.poll() is None
