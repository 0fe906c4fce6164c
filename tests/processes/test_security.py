"""Runs with certificates: they compute the same, and a certificate's holder cannot speak for another."""

import threading
import time

import pytest
import zenoh

from tests.processes.conftest import settings
from tests.processes.test_hostile import forged, wait_for
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.tls import Tls


@pytest.fixture
def certificates(world):
    made = world.call("certs", "new", "certificates", "--agents", "5")
    assert made.returncode == 0, made.stderr
    return world.folder / "certificates"


def test_run_with_certificates_equals_the_simulator(world, certificates):
    done = world.start_run(f"zenoh.tls={certificates}")
    _, err = done.communicate(timeout=100)
    assert done.returncode == 0, err
    assert world.call("verify", str(world.log)).stdout.startswith("equal bit for bit")


@pytest.mark.parametrize("way", ["peer", "router"])
def test_who_has_an_agents_certificate_cannot_change_a_bit_of_another(world, certificates, free_port, way):
    endpoint = f"tls/127.0.0.1:{free_port}"
    join = ["--run", world.run, "--connect", endpoint, "--patience", "20", "--tls", str(certificates)]
    place = ["--listen", endpoint, "--tls", str(certificates)]
    if way == "router":
        join.append("--client")
        router = world.start("router", *place)
        place = join[2:]
    target = world.start("target", "tracking", *settings("steps=200"), "--run", world.run, *place)
    connection = Connection([endpoint], mode="client" if way == "router" else "peer")
    over = threading.Event()
    tls = Tls.of_folder(certificates, "agent-4")
    connection = Connection([endpoint], mode=connection.mode, tls=tls)
    with open_session(connection, patience=20) as intruder:
        wait_for(intruder, f"cbef/{world.run}/live/target/target")
        spy = intruder.declare_subscriber(f"cbef/{world.run}/target/truth", zenoh.handlers.FifoChannel(1000))

        def attack() -> None:
            sequence = 0
            while not over.is_set():
                sequence += 1
                step, round_ = divmod(sequence, 3)
                body = {"k": 1 + step % 200, "l": 1 + round_, "payload": bytes(216)}
                intruder.put(f"cbef/{world.run}/agent/1/round", forged(world.run, "agent/1", **body))
                intruder.put(f"cbef/{world.run}/beacon/1", forged(world.run, "target", k=1, emitted=0.0, arrived=1.0))
                event = {"kind": "hello", "text": "an intruder is here", "data": {}}
                intruder.put(f"cbef/{world.run}/event", forged(world.run, "agent/4", **event))
                time.sleep(0.001)

        attacker = threading.Thread(target=attack)
        attacker.start()
        try:
            others = [world.start("agent", str(agent), *join) for agent in range(4)]
            others.append(world.start("record", *join, "--output", str(world.log)))
            for process in (target, *others):
                _, err = process.communicate(timeout=100)
                assert process.returncode == 0, err
        finally:
            over.set()
            attacker.join()
        assert spy.handler.try_recv() is None
    if way == "router":
        assert router.poll() is None
    assert world.call("verify", str(world.log)).stdout.startswith("equal bit for bit")
    info = world.call("info", str(world.log)).stdout
    assert "agent/1/round" in info


def test_a_process_without_certificates_does_not_join(world, certificates, free_port):
    endpoint = f"tls/127.0.0.1:{free_port}"
    world.start("target", "tracking", *settings(), "--run", world.run, "--listen", endpoint, "--tls", str(certificates))
    for way in (["--connect", endpoint], ["--connect", endpoint.replace("tls/", "tcp/")]):
        refused = world.call("agent", "0", "--run", world.run, *way, "--patience", "3")
        assert refused.returncode == 2
        assert len(refused.stderr.splitlines()) == 1
    let_in = world.start("agent", "0", "--run", world.run, "--connect", endpoint, "--tls", str(certificates))
    with pytest.raises(TimeoutError):
        wait_for_exit(let_in, 3)


def wait_for_exit(process, seconds: float) -> int:
    until = time.monotonic() + seconds
    while process.poll() is None:
        if time.monotonic() > until:
            raise TimeoutError
        time.sleep(0.05)
    return process.returncode
