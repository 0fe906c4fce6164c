"""The space-time picture of real logs: every message that was due is there, with the fate that the log tells."""

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import msgpack
import pytest
import tomli_w

from tests.processes.conftest import World
from tests.processes.recorder.test_log import copy_with
from tests.processes.test_faults import EVERY_KIND
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.exchange import MOST, read_exchange
from zenoh_cbef.log.read.trace import read_trace

ALL = (1, 30)


@pytest.fixture(scope="module", params=["rounds", "rounds and ranges"])
def faulty(request, tmp_path_factory) -> Iterator[World]:
    """A run with every kind of fault; ranges are exchanged too where the filter takes them in."""
    world = World(tmp_path_factory.mktemp("timeline"))
    filter_ = {} if request.param == "rounds" else {"filter": {"kind": "ci", "measurement": "difference"}}
    path = world.folder / "scenario.toml"
    path.write_text(tomli_w.dumps(EVERY_KIND | filter_))
    done = world.call("run", str(path), "--run", world.run, "--log", str(world.log), "--no-report")
    assert done.returncode == 0, done.stderr
    yield world
    world.end()


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
    world = World(tmp_path)
    try:
        run = world.start_run("steps=40", "agents.count=8", "network.graph=complete", "consensus.rounds=5")
        _, err = run.communicate(timeout=120)
        assert run.returncode == 0, err
        with pytest.raises(UserError, match=r"try --steps 1:(\d+)") as refused:
            read_exchange(world.log, steps=(1, 40))
        last = int(str(refused.value).rsplit(":", 1)[1])
        fits = read_exchange(world.log, steps=(1, last))
        assert MOST / 2 < len(fits.passages) <= 1.1 * MOST
        with pytest.raises(UserError, match=r"try --from \S+ --until (\S+)") as refused:
            read_exchange(world.log, since=0.0)
        until = float(str(refused.value).rsplit(" ", 1)[1])
        assert 0.0 < until < math.inf
    finally:
        world.end()
