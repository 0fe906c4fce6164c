"""Fleets on two hosts record their own agents, and one command fetches the logs and joins them."""

import re

import pytest

from tests.processes.conftest import World, ended, settings, unused_endpoint
from tests.processes.forked import Process
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.target.linking import linked_by
from zenoh_cbef.protocol import log_service
from zenoh_cbef.protocol.log_service import LogService, fetch, offers
from zenoh_cbef.protocol.shares import records, share_name
from zenoh_cbef.scenario.load import load


def said_by(fleet: Process) -> str:
    """Where the fleet's recorder says that its log can be fetched."""
    assert fleet.stderr is not None
    for line in fleet.stderr:
        if found := re.search(r"--connect (tcp/\S+)", line):
            return found[1]
    pytest.fail("the recorder did not say where its log waits")


def test_fleets_record_their_agents_and_their_logs_are_fetched_as_one(world: World):
    place = unused_endpoint()
    run = ["--run", world.run, "--patience", "60"]
    target = world.start("target", "tracking", *settings("record.recorders=2"), *run, "--listen", place)
    join = [*run, "--connect", place, "--stay", "100"]
    fleets = [world.start("fleet", ids, *join, "--record", log) for ids, log in (("0,1", "a.mcap"), ("2-3", "b.mcap"))]
    endpoints = [part for one in fleets for part in ("--connect", said_by(one))]
    done = world.done("fetch", "--run", world.run, *endpoints, "--patience", "100", "--output", "whole.mcap")
    assert "of 2 logs can be fetched" in done.stderr or "fetching 2 logs" in done.stderr
    for process in (target, *fleets):
        ended(process)
    assert "agents-0-1" in done.stderr
    for verb in ("check", "verify"):
        world.done(verb, "whole.mcap")
    assert world.metrics("whole.mcap")["messages"]["missing"] == 0
    assert not world.wait_until_gone()


def test_a_log_comes_in_parts_as_it_is_and_its_recorder_learns_of_it(tmp_path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(log_service, "PART", 1000)
    files = [tmp_path / name for name in ("run.mcap", "run.2.mcap")]
    for number, file in enumerate(files):
        file.write_bytes(bytes(range(256)) * (10 + number))
    with Node(Identity("parts", "record", "host")) as node:
        service = LogService(node.session, node.keys, "record/host", files)
        [offer] = offers(node.session, node.keys)
        assert (offer.recorder, offer.sizes) == ("record/host", (2560, 2816))
        copies = [tmp_path / "one", tmp_path / "two"]
        told: list[int] = []
        fetch(node.session, node.keys, offer, copies, told.append)
        assert [one.read_bytes() for one in copies] == [one.read_bytes() for one in files]
        assert sum(told) == offer.size
        assert service.fetched.is_set()
        files[0].write_bytes(bytes(2560))
        with pytest.raises(UserError, match="is not what record/host has"):
            fetch(node.session, node.keys, offer, copies, told.append)
        service.close()


def test_where_no_recorder_stays_it_says_what_to_do(world: World):
    nowhere = unused_endpoint()
    done = world.call("fetch", "--run", "none", "--connect", nowhere, "--patience", "0.1", "-o", "whole.mcap")
    assert (done.returncode, done.stdout) == (2, "")
    assert nowhere in done.stderr
    done = world.call("fetch", "--run", "none", "-o", "whole.mcap")
    assert "needs the recorders' endpoints" in done.stderr


def test_a_recorder_of_some_agents_is_linked_to_these_alone():
    linked = linked_by(load("tracking", []).plan.edges)
    some = f"record/{share_name('0,2-4,17')}"
    assert [agent for agent in range(20) if linked(f"agent/{agent}", some)] == [0, 2, 3, 4, 17]
    assert [agent for agent in range(20) if linked(some, f"agent/{agent}")] == [0, 2, 3, 4, 17]
    assert linked("agent/5", "record/record")
    assert not linked(some, "record/record")
    assert all(records(name, 5) for name in ("record/agents-x", "record/agents-", "record/agents-5_7"))
