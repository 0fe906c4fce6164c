"""What cannot work is said in one sentence, and no process hangs."""

import os
import re
import signal
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.processes.conftest import outsider, settings, unused_endpoint
from tests.processes.test_hostile import wait_for
from tests.waiting import until

JOINING = {
    "agent": ("agent", "0"),
    "record": ("record", "--output", "never.mcap"),
    "status": ("status",),
    "stop": ("stop",),
    "fault": ("fault", "list"),
}


@contextmanager
def mute() -> Iterator[str]:
    """An endpoint that takes connections and never says a word."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        kept = []

        def take() -> None:
            while True:
                try:
                    kept.append(server.accept())
                except OSError:
                    return

        threading.Thread(target=take, daemon=True).start()
        yield f"tcp/127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
        for connection, _ in kept:
            connection.close()


def refusal(world, *command: str) -> str:
    done = world.done(*command, status=2)
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


@pytest.fixture
def target(world, free_port):
    endpoint = f"tcp/127.0.0.1:{free_port}"
    world.start("target", "tracking", *settings(), "--run", world.run, "--listen", endpoint)
    world.wait_until_known()
    return endpoint


@pytest.mark.parametrize("verb", JOINING)
def test_an_endpoint_where_no_run_is_says_what_is_there_instead(world, verb):
    ways = {
        "tcp/no-such-host.invalid:7447": "no-such-host.invalid in tcp/no-such-host.invalid:7447 has no address",
        unused_endpoint(): "no process listens at",
    }
    for endpoint, words in ways.items():
        assert words in refusal(world, *JOINING[verb], "--run", world.run, "--connect", endpoint)
    with mute() as endpoint:
        told = refusal(world, *JOINING[verb], "--run", world.run, "--connect", endpoint)
        assert f"{endpoint} takes connections but does not answer as Zenoh does" in told
    assert not list(world.folder.iterdir())


@pytest.mark.parametrize("verb", JOINING)
def test_a_wrong_name_is_answered_with_the_right_one(world, target, verb):
    told = refusal(world, *JOINING[verb], "--run", "other", "--connect", target)
    assert f"there is {world.run} at {target}" in told


def test_two_agents_with_one_id(world, target):
    join = world.join(target)
    # Without gossip they have no link to each other, only to the target.
    twins = [world.start("agent", "1", *join, "--no-gossip") for _ in range(3)]
    until(lambda: sum(one.poll() is not None for one in twins) >= 2, "there are twins")
    losers = [one for one in twins if one.poll() is not None]
    told = f"zenoh-cbef: agent 1 is already in run {world.run!r}; give another id, or end that process\n"
    assert [(one.returncode, one.communicate()[1]) for one in losers] == [(2, told)] * 2
    assert [one.poll() for one in twins].count(None) == 1
    assert "has agents 0 to 3, no agent 4" in refusal(world, "agent", "4", *join)


def test_two_recorders_with_one_name(world, target):
    join = ["record", "--run", world.run, "--connect", target, "--no-gossip"]
    first = world.start(*join, "-o", "first.mcap")
    until((world.folder / "first.mcap.active").exists, "there is no recorder")  # it has the name by then
    told = refusal(world, *join, "-o", "second.mcap")
    assert told == f"zenoh-cbef: record is already in run {world.run!r}; give another --name, or end that process\n"
    assert not (world.folder / "second.mcap.active").exists()
    assert first.poll() is None


def test_an_agent_does_not_wait_for_ever_for_a_target_that_died_before_the_start(world, target):
    agent = world.start("agent", "1", "--run", world.run, "--connect", target, "--patience", "100")
    with outsider(target) as session:
        wait_for(session, f"cbef/{world.run}/live/agent/1")
    os.kill(world.pid_of("target"), signal.SIGKILL)
    out, err = agent.communicate(timeout=100)
    assert (out, err) == (f"agent 1 ended before run {world.run} had begun\n", "")


def test_two_targets_of_one_name(world, target):
    another = ["target", "paper", "--run", world.run, "--listen", unused_endpoint()]
    assert f"a run {world.run!r} goes on on this host already, at {target}" in refusal(world, *another)
    # The run is known on this host a moment before its target answers others.
    said = f"target is already in run {world.run!r}"
    until(lambda: said in refusal(world, *another, "--connect", target), "the target did not answer")
    assert f"a run {world.run!r} goes on on this host already" in refusal(world, "run", "paper", "--run", world.run)


def test_two_targets_with_different_scenarios_that_did_not_know_of_each_other(world, target, monkeypatch, tmp_path):
    endpoint = unused_endpoint()
    with monkeypatch.context() as elsewhere:  # as on another host
        elsewhere.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        world.start("target", "paper", "--run", world.run, "--listen", endpoint, "--no-gossip")
        world.wait_until_known()
    told = refusal(world, "agent", "1", "--run", world.run, "--connect", target, "--connect", endpoint)
    assert "2 targets answer" in told
    assert "different scenarios" in told


@pytest.mark.parametrize("verb", ["agent", "record"])
def test_another_version(world, verb, endpoint):
    import msgpack  # noqa: PLC0415 - a target as another version has it
    import zenoh  # noqa: PLC0415

    from zenoh_cbef.protocol.session import Connection, open_session  # noqa: PLC0415

    with open_session(Connection(listen=[endpoint])) as session:
        key = f"cbef/{world.run}/scenario"
        answer = {"v": 1, "run": world.run, "program": "99.0", "source": "", "resolved": ""}

        def reply(query: zenoh.Query) -> None:
            with query:
                query.reply(key, msgpack.packb(answer))

        service = session.declare_queryable(key, reply)
        told = refusal(world, *JOINING[verb], "--run", world.run, "--connect", endpoint)
        assert re.search(r"is of zenoh-cbef 99\.0, this is \S+; install the same version", told)
        answer["v"] = 2
        told = refusal(world, *JOINING[verb], "--run", world.run, "--connect", endpoint)
        assert "speaks protocol version 2, this program 1" in told
        service.undeclare()


def test_a_target_that_hangs_is_told_from_one_that_is_not_there(world, target):
    pid = world.pid_of("target")
    os.kill(pid, signal.SIGSTOP)
    try:
        for verb in ("agent", "status", "stop"):
            refusal(world, *JOINING[verb], "--run", world.run, "--connect", target)
    finally:
        os.kill(pid, signal.SIGCONT)
