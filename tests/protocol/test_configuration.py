"""What Zenoh is told of a connection, and what a caller is told where Zenoh refuses it."""

from __future__ import annotations

import json
import socket
import time
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import unused_endpoint
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.messages import LARGEST
from zenoh_cbef.protocol.session import Connection, PortInUseError, configuration, open_session
from zenoh_cbef.protocol.tls import Tls


def told(connection: Connection) -> dict[str, Any]:
    return json.loads(configuration(connection))


@pytest.fixture
def tls(tmp_path: Path) -> Tls:
    for name in ("ca.pem", "agent-3.pem", "agent-3.key"):
        (tmp_path / name).touch()
    return Tls.of_folder(tmp_path, "agent-3")


def test_a_peer_listens_on_loopback_gossips_and_is_not_to_be_found() -> None:
    config = told(Connection())
    assert config["mode"] == "peer"
    assert config["listen"]["endpoints"] == ["tcp/127.0.0.1:0"]
    assert config["scouting"]["multicast"]["enabled"] is False
    assert config["scouting"]["gossip"]["enabled"] is True
    assert (config["connect"]["timeout_ms"], config["connect"]["exit_on_failure"]) == (-1, False)
    retry = {"period_init_ms": 50, "period_max_ms": 400, "period_increase_factor": 1.5}
    assert {name: config["connect"]["retry"][name] for name in retry} == retry
    assert config["listen"]["exit_on_failure"] is True
    assert config["transport"]["link"]["tx"]["lease"] == 5000
    assert config["transport"]["unicast"]["open_timeout"] == 1500
    assert config["transport"]["shared_memory"]["enabled"] is False
    [limit] = config["low_pass_filter"]
    assert limit["flows"] == ["ingress"]
    assert (limit["size_limit"], limit["key_exprs"]) == (LARGEST, ["cbef/*/**"])
    assert set(limit["messages"]) == {"put", "query", "reply"}
    assert config["access_control"]["enabled"] is False


def test_the_target_tells_peers_alone_whom_to_link_to() -> None:
    assert Connection().told
    assert not Connection(mode="client").told
    assert not Connection(gossip=False).told


def test_settings_are_handed_on() -> None:
    ends = Connection(["tcp/a:1", "tcp/b:2"], ["tcp/127.0.0.1:3"], gossip=False, multicast=True, lease_ms=700)
    config = told(ends)
    assert (config["connect"]["endpoints"], config["listen"]["endpoints"]) == (list(ends.connect), list(ends.listen))
    assert config["scouting"]["multicast"]["enabled"] is True
    assert config["scouting"]["gossip"]["enabled"] is False
    assert config["transport"]["link"]["tx"]["lease"] == 700
    assert config["transport"]["unicast"]["open_timeout"] == 10_000, "a link that hundreds make at once takes long"


def test_a_client_listens_nowhere_unless_told_to_and_does_not_wait_in_zenoh() -> None:
    config = told(Connection(["tcp/a:1"], mode="client"))
    assert config["connect"]["timeout_ms"] == 0
    assert (
        config["listen"]["endpoints"] == told(Connection(mode="client"))["listen"]["endpoints"] != ["tcp/127.0.0.1:0"]
    )
    assert told(Connection(["tcp/a:1"], ["tcp/127.0.0.1:3"], "client"))["listen"]["endpoints"] == ["tcp/127.0.0.1:3"]


def test_with_certificates_links_need_them_and_loopback_has_them_too(tls: Tls) -> None:
    config = told(Connection(tls=tls))
    assert config["listen"]["endpoints"] == ["tls/127.0.0.1:0"]
    assert config["access_control"]["enabled"] is True
    assert config["transport"]["link"]["tls"]["enable_mtls"] is True
    assert Connection(tls=tls).loopback(5) == "tls/127.0.0.1:5"
    assert Connection().loopback() == "tcp/127.0.0.1:0"


def test_a_file_of_zenohs_is_what_the_settings_are_laid_over(tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text('{listen: {endpoints: ["tcp/127.0.0.1:9"]}, metadata: {name: "x"}, mode: "client"}')
    config = told(Connection(config=str(path)))
    assert config["metadata"] == {"name": "x"}
    assert config["mode"] == "peer"
    assert config["listen"]["endpoints"] == ["tcp/127.0.0.1:9"]
    path.write_text("{mode: 7")
    with pytest.raises(UserError, match="Zenoh refuses"):
        configuration(Connection(config=str(path)))
    with pytest.raises(UserError, match="there is no Zenoh configuration file"):
        configuration(Connection(config=str(tmp_path)))


@pytest.mark.parametrize("endpoint", ["localhost", "tcp/", "tcp/a b", "http/a:1", "tcp/a:65536", ""])
def test_what_is_no_endpoint_is_refused(endpoint: str) -> None:
    for connection in (Connection(connect=[endpoint]), Connection(listen=[endpoint])):
        with pytest.raises(UserError, match="is no endpoint; write it as tcp/HOST:PORT"):
            open_session(connection)


def test_with_certificates_an_endpoint_without_is_refused(tls: Tls) -> None:
    with pytest.raises(UserError, match="asks for no certificate; with --tls write tls/a:1"):
        open_session(Connection(["tcp/a:1"], tls=tls))


def test_a_port_in_use_is_told_and_so_is_a_place_where_nobody_can_listen() -> None:
    with socket.socket() as thief:
        thief.bind(("127.0.0.1", 0))
        thief.listen()
        taken = f"tcp/127.0.0.1:{thief.getsockname()[1]}"
        with pytest.raises(PortInUseError, match=f"a port of {taken} is in use"):
            open_session(Connection(listen=[taken]))
    with pytest.raises(UserError, match=r"cannot listen on tcp/192\.0\.2\.1:1: .*; choose another endpoint"):
        open_session(Connection(listen=["tcp/192.0.2.1:1"]))


@pytest.mark.slow
def test_a_client_waits_for_its_router_and_is_told_where_none_answers() -> None:
    nowhere = unused_endpoint()
    begun = time.monotonic()
    with pytest.raises(UserError, match=f"neither router nor target answers at {nowhere}; .*, and check --connect$"):
        open_session(Connection([nowhere], mode="client"), patience=0.5)
    assert time.monotonic() - begun >= 0.5


@pytest.mark.parametrize(
    ("hub", "listen", "expected"),
    [("router", [], "client"), ("router", ["tcp/127.0.0.1:0"], "peer"), ("peer", [], "peer")],
)
def test_a_peer_that_listens_nowhere_is_the_client_of_a_router(hub: str, listen: list[str], expected: str) -> None:
    endpoint = unused_endpoint()
    with open_session(Connection(listen=[endpoint], mode=hub)) as met, open_session(Connection([endpoint], listen)):
        # On a busy host the hub lets go of the session that only asked who is there a little later.
        until(lambda: [str(one.whatami) for one in met.info.transports()] == [expected])
