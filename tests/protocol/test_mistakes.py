"""What a user is told of Zenoh's errors, and how threads of a session are scheduled."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from zenoh_cbef.machine import yield_to_others
from zenoh_cbef.protocol.session import Connection, PortInUseError, _mistake
from zenoh_cbef.protocol.tls import Tls

HERE = Connection(listen=["tcp/127.0.0.1:1", "tcp/127.0.0.1:2"])
FAILED = "Can not create a new TCP listener: it did not work at io/link.rs:12."


@pytest.mark.parametrize(
    ("connection", "error", "words"),
    [
        (HERE, "Address already IN USE", "a port of tcp/127.0.0.1:1, tcp/127.0.0.1:2 is in use"),
        (HERE, "bind (OS error 98)", "is in use; choose another with --listen"),
        (HERE, FAILED, "^cannot listen on tcp/127.0.0.1:1, tcp/127.0.0.1:2: it did not work; choose another"),
        (Connection(), "outer: middle: inner at src/a.rs:3:1", "session: inner; check"),
        (HERE, "outer: inner!", "^Zenoh cannot open a session: inner; check --connect"),
        (Connection(), FAILED, "^Zenoh cannot open a session: it did not work; check"),
        (Connection(mode="router"), "outer: inner", "^this Zenoh cannot be a router: inner; check --config"),
        (Connection(), " ]!", r"^Zenoh cannot open a session:  \]!; check"),
    ],
)
def test_an_error_becomes_a_sentence_with_its_last_cause(connection: Connection, error: str, words: str) -> None:
    told = _mistake(error, connection, unreached=False)
    assert isinstance(told, PortInUseError) == ("in use" in words)
    with pytest.raises(type(told), match=words):
        raise told


def test_a_router_that_does_not_answer_is_named_and_certificates_where_there_are_any(tmp_path: Path) -> None:
    for name in ("ca.pem", "agent-3.pem", "agent-3.key"):
        (tmp_path / name).touch()
    tls = Tls.of_folder(tmp_path, "agent-3")
    said = str(_mistake("connect", Connection(["tcp/a:1", "tcp/b:2"], mode="client"), unreached=True))
    assert (
        said
        == "neither router nor target answers at tcp/a:1, tcp/b:2; start 'zenoh-cbef router' there, and check --connect"
    )
    said = str(_mistake("connect", Connection(["tls/a:1"], mode="client"), unreached=True))
    assert said == "tls/a:1 asks for a certificate; give --tls and your folder of 'certs new'"
    said = str(_mistake("connect", Connection(["tls/a:1"], mode="client", tls=tls), unreached=True))
    assert said.startswith("neither router nor target answers at tls/a:1; ")
    said = str(_mistake("connect", Connection(mode="client", tls=tls), unreached=True))
    assert said.startswith("neither router nor target answers at the endpoints of its configuration; ")
    assert said.endswith(", --tls, and that the router's certificate names this host")


@pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="this system has no such choice")
def test_a_thread_asks_for_fewer_preemptions() -> None:
    def scheduled() -> int:
        yield_to_others()
        return os.sched_getscheduler(0)

    before = os.sched_getscheduler(0)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(scheduled).result() == os.SCHED_BATCH
    assert os.sched_getscheduler(0) == before
