"""Mutual TLS and access control between real sessions: who has no certificate is out, who has one speaks for itself."""

import json
import ssl
import stat
import time
from pathlib import Path

import pytest
import zenoh

from tests.protocol.certified import NAMES, RUN, Ear, Net
from tests.waiting import until
from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol import access
from zenoh_cbef.protocol.certificates import make_certificates
from zenoh_cbef.protocol.session import Connection, open_session
from zenoh_cbef.protocol.tls import Tls


@pytest.fixture(autouse=True)
def _few_agents(monkeypatch):
    """Rules for the agents that are here: a session takes half a second to read those of a thousand (test_rules.py)."""
    monkeypatch.setattr(access, "MOST_AGENTS", 2)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    assert make_certificates(folder, NAMES, hosts=["127.0.0.1", "localhost"], days=1) == list(NAMES)
    return folder


@pytest.fixture(params=["peer", "router"])
def net(request, certificates):
    one = Net(certificates, request.param)
    yield one
    one.close()


OF_AGENT_0 = {"agent/0/range", "agent/0/round", "agent/0/estimate", "event/agent/0"}


OF_TARGET = {"target/truth", "faults", "event/target", "beacon/0/signal", "beacon/1/signal", "beacon/*/signal"}


BEACONS = {"beacon/0", "beacon/1", "beacon/*"}


OF_RECORDERS = {"event/record", "event/record/b"}


NOBODYS = {"event", "event/*", "event/**", "event/agent/*", "agent/*/round", "agent/0/*", "agent/0/more", "scenario"}


NOBODYS |= {
    "agent/1/round",
    "agent/1/estimate",
    "event/agent/1",
    "event/replay",
    "control",
    "replay",
    "target/more",
    "**",
}


MAY_PUT = {
    "agent-0": OF_AGENT_0,
    "target": OF_TARGET | BEACONS,
    "record": OF_RECORDERS,
    "receiver": BEACONS | {"event/receiver/0"},
    "operator": set(),
}


ALL_KEYS = sorted(OF_AGENT_0 | OF_TARGET | BEACONS | OF_RECORDERS | NOBODYS | {"event/receiver/0", "beacon/0/more"})


def test_each_certificate_publishes_what_is_its_own_and_deletes_nothing(net):
    sessions = {name: net.join(name) for name in MAY_PUT}
    logs = {"record": Ear(sessions["record"], f"{RUN}/**"), "operator": Ear(sessions["operator"], f"{RUN}/**")}

    def heard(name: str) -> set[str]:
        log = logs["operator" if name == "record" else "record"]
        return {key for key, text in log.heard() if text == name}

    def speak() -> bool:
        for name, session in sessions.items():
            for key in ALL_KEYS:
                session.put(f"{RUN}/{key}", name)
                if name not in logs:  # They would hear themselves.
                    session.delete(f"{RUN}/{key}")
        return all(heard(name) >= keys for name, keys in MAY_PUT.items())

    until(speak)
    time.sleep(0.3)
    assert {name: heard(name) for name in MAY_PUT} == MAY_PUT
    assert {text for log in logs.values() for _, text in log.heard()} <= {*MAY_PUT}


def test_only_the_recorder_hears_the_truth_and_an_agent_only_its_own_beacon(net):
    target, recorder, agent, receiver = (net.join(name) for name in ("target", "record", "agent-0", "receiver"))
    log, beacon, signals = (
        Ear(recorder, f"{RUN}/**"),
        Ear(agent, f"{RUN}/beacon/0"),
        Ear(agent, f"{RUN}/beacon/0/signal"),
    )
    starts = Ear(receiver, f"{RUN}/beacon/1/signal")
    kept = [f"{RUN}/{key}" for key in ("target/truth", "target/*", "beacon/1", "beacon/1/signal", "event/target")]
    spies = [Ear(agent, key) for key in kept]
    spies += [Ear(receiver, f"{RUN}/{key}") for key in ("target/truth", "beacon/0", "agent/0/round", "event/target")]
    sent = {"target/truth", "beacon/0", "beacon/1", "beacon/0/signal", "beacon/1/signal", "event/target"}

    def emit() -> bool:
        for key in sent:
            target.put(f"{RUN}/{key}", "x")
        agent.put(f"{RUN}/agent/0/round", "x")
        heard = {key for key, _ in log.heard()} >= sent
        return heard and bool(beacon.heard() and signals.heard() and starts.heard())

    until(emit)
    time.sleep(0.3)
    assert [spy.heard() for spy in spies] == [[]] * len(spies)
    assert {key for key, _ in beacon.heard()} == {"beacon/0"}


def test_a_wildcard_does_not_get_an_agent_what_it_may_not_read(net):
    target, recorder, agent = net.join("target"), net.join("record"), net.join("agent-0")
    log, spies = Ear(recorder, f"{RUN}/**"), [Ear(agent, key) for key in (f"{RUN}/**", "cbef/**", "**")]

    def emit() -> bool:
        target.put(f"{RUN}/target/truth", "x")
        return bool(log.heard())

    until(emit)
    time.sleep(0.3)
    assert [spy.heard() for spy in spies] == [[], [], []]


def test_no_process_is_announced_or_answers_under_anothers_name(net):
    target, recorder, agent = net.join("target"), net.join("record"), net.join("agent-0")

    def live() -> set[str]:
        replies = recorder.liveliness().get(f"{RUN}/live/**", timeout=1.0)
        return {str(reply.ok.key_expr).removeprefix(f"{RUN}/live/") for reply in replies if reply.ok is not None}

    def answers() -> set[str]:
        replies = recorder.get(f"{RUN}/scenario", timeout=1.0)
        return {reply.ok.payload.to_string() for reply in replies if reply.ok is not None}

    def serve(session: zenoh.Session, text: str) -> zenoh.Queryable:
        return session.declare_queryable(f"{RUN}/scenario", lambda query: query.reply(f"{RUN}/scenario", text))

    own = {"agent/0", "ready/0", "life/agent/0/1", "over/agent/0"}
    foreign = {
        "agent/1",
        "ready/1",
        "target/target",
        "record/record",
        "heard/agent/1/1",
        "life/agent/1/1",
        "over/agent/1",
        "over/target/target",
    }
    tokens = [agent.liveliness().declare_token(f"{RUN}/live/{name}") for name in own | foreign]
    services = [serve(agent, "forged"), serve(target, "true")]
    until(lambda: live() == own)
    until(lambda: answers() == {"true"})
    time.sleep(0.3)
    assert live() == own
    assert answers() == {"true"}
    for one in (*tokens, *services):
        one.undeclare()


def test_an_agent_answers_for_itself_alone(net):
    agent, other, recorder = net.join("agent-0"), net.join("agent-1"), net.join("record")
    keys = [f"{RUN}/{key}" for key in ("agent/0/estimate", "agent/1/estimate", "scenario", "control", "target/truth")]
    services = [
        agent.declare_queryable(key, lambda query, key=key: query.reply(key, "x"))
        for key in (*keys, f"{RUN}/**", f"{RUN}/agent/*/estimate")
    ]

    def told(session: zenoh.Session, key: str) -> set[str]:
        replies = session.get(key, timeout=1.0, target=zenoh.QueryTarget.ALL)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    until(lambda: told(other, keys[0]) == {keys[0]})
    for session in (other, recorder):
        assert [told(session, key) for key in (f"{RUN}/**", f"{RUN}/agent/*/estimate")] <= [{keys[0]}, {keys[0]}]
        assert [told(session, key) for key in keys[1:]] == [set()] * 4
    for one in services:
        one.undeclare()


def test_only_an_operator_gives_orders(net):
    target, operator, agent, recorder = (net.join(name) for name in ("target", "operator", "agent-0", "record"))
    key = f"{RUN}/control"
    service = target.declare_queryable(key, lambda query: query.reply(key, "done"))

    def done(session: zenoh.Session) -> bool:
        return any(reply.ok is not None for reply in session.get(key, timeout=1.0))

    until(lambda: done(operator))
    assert (done(agent), done(recorder)) == (False, False)
    service.undeclare()


def test_an_operator_reads_everything_and_says_nothing(net):
    target, operator, recorder = net.join("target"), net.join("operator"), net.join("record")
    seen, log = Ear(operator, f"{RUN}/**"), Ear(recorder, f"{RUN}/**")

    def speak() -> bool:
        target.put(f"{RUN}/target/truth", "x")
        for key in ("target/truth", "agent/0/round", "beacon/0"):
            operator.put(f"{RUN}/{key}", "forged")
        return bool(seen.heard() and log.heard())

    until(speak)
    time.sleep(0.3)
    assert {text for _, text in log.heard()} == {"x"}


@pytest.mark.parametrize("shown", ["none", "another authority's", "none, over plain TCP"])
def test_a_foreign_process_cannot_link_read_or_inject(certificates, tmp_path, shown):
    net = Net(certificates, "peer")
    try:
        recorder, target = net.join("record"), net.join("target")
        log = Ear(recorder, f"{RUN}/**")
        tls = {"root_ca_certificate": str(certificates / "ca.pem"), "enable_mtls": True}
        if shown == "another authority's":
            make_certificates(tmp_path, ["agent-0"], hosts=["127.0.0.1"], days=1)
            tls |= {"connect_certificate": f"{tmp_path}/agent-0.pem", "connect_private_key": f"{tmp_path}/agent-0.key"}
        config = zenoh.Config()
        plain = shown.endswith("TCP")
        endpoints = [one.replace("tls/", "tcp/") if plain else one for one in net.endpoints]
        for key, value in {
            "connect/endpoints": endpoints,
            "listen/endpoints": [],
            "scouting/multicast/enabled": False,
            "connect/retry": {"period_init_ms": 50, "period_max_ms": 100, "period_increase_factor": 1},
            "transport/link/tls": {name: value for name, value in tls.items() if shown != "none" or "mtls" not in name},
        }.items():
            config.insert_json5(key, json.dumps(value))
        with zenoh.open(config) as foreign:
            ear = Ear(foreign, "**")
            until = time.monotonic() + 1.5
            while time.monotonic() < until:
                foreign.put(f"{RUN}/agent/0/round", "forged")
                target.put(f"{RUN}/target/truth", "x")
                time.sleep(0.05)
            assert foreign.info.peers_zid() == []
            assert {text for _, text in ear.heard()} == {"forged"}
        assert {text for _, text in log.heard()} == {"x"}
    finally:
        net.close()


def test_a_process_does_not_link_to_a_server_whose_certificate_names_another_host(tmp_path):
    make_certificates(tmp_path, NAMES, hosts=["elsewhere.example"], days=1)
    net = Net(tmp_path, "peer")
    try:
        first, second = net.join("target"), net.join("record")
        time.sleep(1.0)
        assert (first.info.peers_zid(), second.info.peers_zid()) == ([], [])
    finally:
        net.close()


def test_keys_are_their_owners_only_and_certificates_verify(certificates):
    for name in ("ca", *NAMES):
        assert stat.S_IMODE((certificates / f"{name}.key").stat().st_mode) == 0o600
    trusted = ssl.create_default_context(cafile=certificates / "ca.pem")
    for name in NAMES:
        trusted.load_cert_chain(certificates / f"{name}.pem", certificates / f"{name}.key")


def test_missing_certificates_are_added_by_the_same_authority_and_the_others_stay(certificates):
    before = {path.name: path.read_bytes() for path in certificates.iterdir()}
    assert make_certificates(certificates, [*NAMES, "agent-2"], hosts=["127.0.0.1"], days=1) == ["agent-2"]
    assert {name: (certificates / name).read_bytes() for name in before} == before
    net = Net(certificates, "peer")
    try:
        first, second = net.join("agent-1"), net.join("agent-2")
        until(lambda: bool(first.info.peers_zid() and second.info.peers_zid()))
    finally:
        net.close()


def test_with_certificates_a_plain_endpoint_is_refused(certificates):
    with pytest.raises(UserError, match=r"tls/127\.0\.0\.1:7447"):
        open_session(Connection(["tcp/127.0.0.1:7447"], tls=Tls.of_folder(certificates, "agent-0")))
