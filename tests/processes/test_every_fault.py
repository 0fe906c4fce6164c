"""Runs with every kind of fault: counts and marks in the log, and the space-time picture with each message's fate."""

import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import msgpack
import numpy as np
import pytest

from tests.log.made import made_log
from tests.processes.again import again, said
from tests.processes.conftest import World
from tests.processes.recorder.test_log import copy_with
from tests.processes.test_faults import EVERY_KIND, run
from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.analysis.traffic import other_bytes, round_bytes
from zenoh_cbef.errors import UserError
from zenoh_cbef.faults import Fates
from zenoh_cbef.log.prove.verify import Verdict, verify
from zenoh_cbef.log.read.exchange import MOST, read_exchange
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.build import fates_into
from zenoh_cbef.scenario.load import load, parse
from zenoh_cbef.scenario.plan import Plan

ALL = (1, 30)


@pytest.fixture(scope="module", params=["sicf", "ci"])
def run_of(request, tmp_path_factory) -> Iterator[tuple[World, dict, Metrics]]:
    """A proved run with every kind of fault, its scenario and metrics; ranges are exchanged too where ci takes them."""
    world = World(tmp_path_factory.mktemp("every"))
    measurement = {"measurement": "difference"} if request.param == "ci" else {}
    scenario = EVERY_KIND | {"filter": {"kind": request.param, **measurement}}
    try:
        yield world, scenario, run(world, scenario)
    finally:
        world.end()


@pytest.fixture(scope="module")
def faulty(run_of) -> World:
    return run_of[0]


def test_every_kind_of_fault_gives_the_simulators_bits_and_is_counted_and_marked_in_the_log(run_of):
    world, scenario, metrics = run_of
    kind = scenario["filter"]["kind"]
    told = load(str(world.folder / "scenario.toml")).scenario.changed(name=world.run)
    foretold = other_bytes(Plan(told)) + 3 * round_bytes(Plan(told))
    assert foretold == pytest.approx(metrics.bytes_per_step, rel=0.02)
    totals: Counter[str] = Counter()
    for link in metrics.links:
        totals.update(vars(replace(link, latency=0)))
    for name in ("injected_lost", "injected_late", "corrupted", "duplicated"):
        assert totals[name] > 20, name
    assert totals["real_lost"] == totals["deadline_missed"] == 0

    assert said(again(world, world.log)) == said(world.log)

    recording = read_recording(open_log(world.log))
    assert recording.estimates.seen(30).all()
    for agent, receipts in enumerate(recording.receipts):
        for step in range(1, 31):
            receipt = receipts.told(step)
            assert receipt is not None
            expected = marks(parse(scenario, "test"), agent, step, receipt.neighbours, kind)
            assert (receipt.marks or ["...", "..."]) == expected

    tampered = {
        "injected_lost": lambda counts: [counts[0] + 1, *counts[1:]],
        "duplicated": lambda counts: [0 for _ in counts],
        "fates": lambda fates: [one.replace("x", ">") for one in fates],
    }
    for name, change in tampered.items():
        verdict = verify_changed(world, name, change)
        assert verdict.result == "different", name
        assert f": {name} is" in verdict.text
    # A log from before agents told what faults did.
    verdict = verify_changed(world, None, None)
    assert verdict.result == "equal", verdict.text


def verify_changed(world: World, name: str | None, change) -> Verdict:
    """Verify a copy of the log in which one field of agent 1's estimates is changed; None: it lacks all of them."""

    def told(topic: str, data: bytes) -> bytes:
        if not topic.endswith("/estimate"):
            return data
        message = msgpack.unpackb(data)
        if name is None:
            for field in ("injected_lost", "injected_late", "corrupted", "duplicated", "fates"):
                message.pop(field, None)
        elif topic.endswith("agent/1/estimate") and message["k"] == 20 and name in message:
            message[name] = change(message[name])
        return msgpack.packb(message)

    copy = world.folder / f"{name}.mcap"
    copy_with(world.log, copy, told)
    return verify(copy)


def marks(scenario, agent: int, step: int, neighbours: list[int], kind: str) -> list[str]:
    """What the log should say of a step, from the scenario alone."""
    fates: Fates = fates_into(Plan(scenario), agent, neighbours)
    told = [fates.of(step, round_) for round_ in range(kind != "ci", 4)]
    signs = {"lost": "x", "late": ">", "corrupted": "!", "duplicated": "+"}
    expected = np.full((len(neighbours), len(told)), ".")
    for round_, fate in enumerate(told):
        for name, sign in signs.items():
            expected[getattr(fate, name), round_] = sign
    if (expected == ".").all():
        return ["...", "..."]
    return ["".join(row) for row in expected.tolist()]


def test_the_fates_in_the_picture_are_those_that_the_receivers_counted(faulty):
    links = read_trace(faulty.log).links
    found = Counter(one.fortune for one in read_exchange(faulty.log, steps=ALL).passages if one.source is not None)
    assert found["lost"] == links.injected_lost.sum() > 0
    assert found["late"] == links.injected_late.sum() > 0
    assert found["damaged"] == links.corrupted.sum() > 0
    assert found["duplicated"] == links.duplicated.sum() > 0
    assert found["in time"] == (links.delivered - links.duplicated).sum() > 0
    assert found["missed"] == 0
    assert found.total() == links.sent.sum()


def test_messages_are_used_after_they_were_sent_and_before_their_receiver_goes_on(faulty):
    exchange = read_exchange(faulty.log, steps=ALL)
    used = [one for one in exchange.passages if one.fortune in {"in time", "duplicated"}]
    assert all(one.ended > one.sent for one in used)
    # A message of a later round is used later by the same receiver.
    by_link: dict[tuple, list] = {}
    for one in used:
        by_link.setdefault((one.source, one.destination), []).append((one.step, one.round, one.ended))
    for link, entries in by_link.items():
        moments = [ended for *_, ended in sorted(entries)]
        assert moments == sorted(moments), link
    late = [one for one in exchange.passages if one.fortune == "late"]
    assert all(one.ended >= one.sent for one in late)
    assert len(exchange.estimates) == 30 * 4


def test_a_log_may_hold_what_followed_from_the_start_signal_before_the_signal(faulty):
    changed = faulty.folder / "signals-last.mcap"
    copy_with(faulty.log, changed, lambda _, data: data, last="/signal")
    assert read_exchange(changed, steps=ALL) == read_exchange(faulty.log, steps=ALL)


def test_a_window_of_time_holds_what_was_under_way_in_it(faulty):
    whole = read_exchange(faulty.log, steps=ALL)
    middle = 0.5 * (whole.since + whole.until)
    part = read_exchange(faulty.log, since=middle, until=whole.until)
    expected = [one for one in whole.passages if one.ended >= middle]
    assert part.passages == expected
    assert 0 < len(expected) < len(whole.passages)
    # A message that came late was under way until then, though its step had ended.
    latest = max(
        (one for one in whole.passages if one.fortune == "late"), key=lambda one: one.ended - ended_of(whole, one.step)
    )
    assert latest in read_exchange(faulty.log, since=latest.ended, until=whole.until).passages


def ended_of(whole, step):
    """When a step's last estimate was there."""
    return max(time for _, one, time in whole.estimates if one == step)


def test_the_command_writes_a_picture_and_a_page(faulty):
    for name in ("picture.svg", "page.html"):
        path = faulty.folder / name
        done = faulty.call("timeline", str(faulty.log), "--steps", "5:6", "-o", str(path))
        assert done.returncode == 0, done.stderr
    text = (faulty.folder / "picture.svg").read_text(encoding="utf-8")
    groups = [one.get("class") for one in ET.fromstring(text.split("?>", 1)[1]).iter("{http://www.w3.org/2000/svg}g")]
    drawn = read_exchange(faulty.log, steps=(5, 6)).passages
    assert groups.count("lost") >= sum(one.fortune == "lost" for one in drawn)
    assert "<svg" in (faulty.folder / "page.html").read_text(encoding="utf-8")


def test_mistakes_name_the_remedy(faulty):
    for arguments, words in (
        (("--steps", "5-6"), "--steps 10:12"),
        (("--steps", "40:41"), "steps 1 to 30"),
        (("--steps", "1:2", "--from", "0"), "one of them"),
        (("--from", "2", "--until", "1"), "swap them"),
        (("--from", "1e6"), "change --from"),
        (("-o", "x.gif"), ".svg for the picture"),
    ):
        done = faulty.call("timeline", str(faulty.log), *arguments)
        assert done.returncode == 2
        assert words in done.stderr
        assert len(done.stderr.strip().splitlines()) == 1


def test_a_message_that_its_receiver_missed_is_told_from_one_that_a_fault_took(faulty):
    def told(topic: str, data: bytes) -> bytes:
        if not topic.endswith("agent/2/estimate"):
            return data
        message = msgpack.unpackb(data)
        if message["k"] >= 9:
            message["received"][0] -= 1
        return msgpack.packb(message)

    changed = faulty.folder / "missed.mcap"
    if not changed.exists():
        copy_with(faulty.log, changed, told)
    missed = [one for one in read_exchange(changed, steps=ALL).passages if one.fortune == "missed"]
    assert [(one.destination, one.step) for one in missed] == [(2, 9)]


def test_a_part_that_is_too_large_to_read_is_refused_with_one_that_fits(tmp_path: Path):
    network = ("agents.count=8", "network.graph=complete", "consensus.rounds=5")
    log = made_log(tmp_path / "made.mcap", "steps=40", *network)
    with pytest.raises(UserError, match=r"try --steps 1:(\d+)") as refused:
        read_exchange(log, steps=(1, 40))
    last = int(str(refused.value).rsplit(":", 1)[1])
    fits = read_exchange(log, steps=(1, last))
    assert MOST / 2 < len(fits.passages) <= 1.1 * MOST
    with pytest.raises(UserError, match=r"try --from \S+ --until (\S+)") as refused:
        read_exchange(log, since=0.0)
    until = float(str(refused.value).rsplit(" ", 1)[1])
    assert 0.0 < until < math.inf
