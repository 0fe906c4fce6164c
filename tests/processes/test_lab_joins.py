"""The lab joins a run that this host does not know of, by its endpoint, and a run with certificates."""

import json
import os
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from tests.processes.conftest import ended
from tests.waiting import until
from zenoh_cbef.outside.registry import known_runs

client = pytest.importorskip("websockets.sync.client", reason="the extra 'lab' is not installed")
pytest.importorskip("uvicorn", reason="the extra 'lab' is not installed")

UNHURRIED = ("steps=100000", "timing.mode=realtime", "dt=0.2")
"""A run that leaves the processor to the lab."""


def test_a_run_of_another_host_is_joined_by_its_endpoint_and_its_loss_is_seen(world, monkeypatch, tmp_path):
    world.under_way(*UNHURRIED)
    [endpoint] = known_runs()[world.run].endpoints[:1]
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # as on another host
    with talking(world, "--connect", endpoint) as ask:
        told = ask(ask="scene")
        assert (told["run"], told["live"], told["state"]) == (world.run, True, "goes on")
        assert told["agents"] == 4
        os.kill(world.pid_of("target"), signal.SIGKILL)
        until(lambda: ask(ask="frame", after=1 << 30)["state"] == "is out of reach")


def test_with_certificates_the_operators_sees_the_run_and_orders_and_no_other_does(world):
    world.done("certs", "new", "certs", "--agents", "4")
    world.under_way(*UNHURRIED, "zenoh.tls=certs")
    bare = world.start("lab", world.run, "--no-browser")
    _, said = ended(bare, 2)
    assert "asks for a certificate; give --tls" in said
    with talking(world, "--tls", "certs") as ask:
        until_agents_are_seen(ask)
        assert ask(ask="fault", table={"kind": "outage", "agents": [1]})["fault"] == 0
    other = ("--ca", "certs/ca.pem", "--cert", "certs/record.pem", "--key", "certs/record.key")
    with talking(world, *other) as ask:
        until_agents_are_seen(ask)
        assert "does this certificate (--tls) allow the question" in ask(ask="stop")["error"]


@contextmanager
def talking(world, *words: str) -> Iterator[Callable[..., dict[str, Any]]]:
    """A lab that looks at the test's run, asked over its WebSocket."""
    lab = world.start("lab", world.run, *words, "--no-browser")
    assert lab.stderr is not None
    url = next(found[1] for line in lab.stderr if (found := re.search(r"http:(//\S+)", line)))
    with client.connect("ws:" + url.replace("/?", "/talk?")) as socket:

        def ask(**table: object) -> dict[str, Any]:
            socket.send(json.dumps(table))
            data = socket.recv(timeout=100)
            told: dict[str, Any] = json.loads(data[4 : 4 + int.from_bytes(data[:4], "little")])
            return told

        yield ask
    lab.terminate()
    lab.communicate(timeout=100)


def until_agents_are_seen(ask: Callable[..., dict[str, Any]]) -> None:
    until(lambda: "of 4 agents" in str(ask(ask="frame")["verdict"]))
