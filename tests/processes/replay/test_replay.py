"""A recorded run, published again: any subscriber gets the recorded bytes in the recorded order, as it is told to."""

import os
import pty
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest

from tests.processes.conftest import COMMAND, World, ended
from tests.processes.replay.listening import Listener, finish, logged, play, start
from tests.waiting import until
from zenoh_cbef.log.mcap.reader import McapFile


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Iterator[World]:
    world = World(tmp_path_factory.mktemp("recorded"))
    world.complete()
    yield world
    world.end()


@pytest.fixture
def listener(recorded, free_port):
    one = Listener(free_port, recorded.run)
    yield one
    one.close()


def test_every_byte_comes_again_in_order(recorded, listener):
    assert play(recorded, listener, "--rate", "50") == logged(recorded)


def test_keys_are_chosen_left_out_and_renamed(recorded, listener):
    run = recorded.run
    options: tuple[str, ...] = ("--topics", "cbef/*/agent/**", "-y", ".*/beacon/[01]", "--exclude", "cbef/**/round")
    options += ("--exclude-regex", "agent/3")
    heard = play(recorded, listener, "-r", "1000", *options, "--remap", f"cbef/{run}/agent/1:=lab/one")

    def wanted(key: str) -> bool:
        chosen = f"/{run}/agent/" in key or key.endswith(("/beacon/0", "/beacon/1"))
        return chosen and not key.endswith("/round") and "agent/3" not in key

    old = f"cbef/{run}/agent/1/"
    expected = [(key.replace(old, "lab/one/"), data) for key, data in logged(recorded) if wanted(key)]
    assert heard == expected
    assert {key.split("/")[0] for key, _ in heard} == {"cbef", "lab"}


def test_a_part_of_the_log_is_played(recorded, listener):
    messages = list(McapFile(recorded.log).messages())
    begin = messages[0].log_time
    length = (messages[-1].log_time - begin) / 1e9
    first, last = (begin + round(1e9 * share * length) for share in (0.25, 0.75))
    heard = play(
        recorded, listener, "-r", "1000", "--start-offset", str(0.25 * length), "--duration", str(0.5 * length)
    )
    expected = [(one.channel.topic, one.data) for one in messages if first <= one.log_time <= last]
    # The offsets are rounded to nanoseconds once here and once there.
    assert abs(len(heard) - len(expected)) <= 1
    assert 0 < len(heard) < len(messages)
    assert heard[1:-1] == expected[1 : len(heard) - 1] or heard == expected


def test_it_is_paused_stepped_sought_and_resumed_from_outside(recorded, listener):
    all_of_it = logged(recorded)
    replay = start(recorded, listener, "--start-paused")
    state = listener.ask()
    assert (state["state"], state["published"], state["rate"]) == ("paused", 0, 1.0)
    assert state["run"] == recorded.run
    listener.ask("next=3")
    listener.wait(3)
    listener.ask("step")
    listener.wait(first_of_step(all_of_it, 1))
    listener.ask("step=2")
    listener.wait(first_of_step(all_of_it, 3))
    assert listener.heard == all_of_it[: len(listener.heard)]
    assert listener.ask("rate=1000")["rate"] == 1000.0
    assert listener.ask("seek=0;resume")["state"] in ("playing", "done")
    finish(replay, listener)
    assert listener.heard == all_of_it[: first_of_step(all_of_it, 3)] + all_of_it


def first_of_step(messages: list[tuple[str, bytes]], step: int) -> int:
    """The place of the first truth or beacon of a step."""
    steps = (
        (place, msgpack.unpackb(data)["k"])
        for place, (key, data) in enumerate(messages)
        if "/beacon/" in key or key.endswith("/truth")
    )
    return next(place for place, found in steps if found >= step)


@pytest.mark.parametrize(
    ("orders", "words"),
    [
        ("rate=0", "cannot be played"),
        ("rate=fast", "is not a number"),
        ("next=-1", "is not a number"),
        ("seek=1e9", "seek from 0 s to"),
        ("seek=nan", "is not a number"),
        ("dance", "nothing a replay can do; it knows pause, resume"),
        ("pause=1", "nothing a replay can do"),
    ],
)
def test_nonsense_is_answered_with_a_sentence(recorded, listener, orders, words):
    replay = start(recorded, listener, "--start-paused")
    assert words in listener.answer(orders)
    assert listener.ask()["published"] == 0
    replay.send_signal(signal.SIGINT)
    assert replay.wait(timeout=100) == 130


def test_a_loop_goes_on_until_ctrl_c_and_ends_cleanly(recorded, listener):
    replay = start(recorded, listener, "--loop", "-r", "1000", "--topics", "cbef/*/beacon/0")
    while (state := listener.ask())["lap"] < 3:
        time.sleep(0.02)
    assert state["state"] == "playing"
    once = [item for item in logged(recorded) if item[0].endswith("/beacon/0")]
    until(lambda: len(listener.heard) >= 2 * len(once))
    replay.send_signal(signal.SIGINT)
    _, err = ended(replay, 130)
    assert err == ""
    assert listener.heard[: 2 * len(once)] == once + once


def drain(leader: int, seen: bytearray) -> None:
    """Read what a terminal shows until it is closed."""
    while True:
        try:
            seen.extend(os.read(leader, 4096))
        except OSError:
            return


def test_keys_of_a_terminal_are_obeyed(recorded, listener):
    leader, follower = pty.openpty()
    seen = bytearray()
    endpoint = f"tcp/127.0.0.1:{listener.port}"
    replay = subprocess.Popen(
        [*COMMAND, "replay", str(recorded.log), "-p", "--wait", "--linger", "60", "--listen", endpoint],
        stdin=follower,
        stdout=subprocess.DEVNULL,
        stderr=follower,
        start_new_session=True,
    )
    os.close(follower)
    threading.Thread(target=drain, args=(leader, seen), daemon=True).start()
    try:
        steps = logged(recorded)
        listener.ask()
        os.write(leader, b"\x1b[C\x1b[C")
        listener.wait(first_of_step(steps, 2))
        os.write(leader, b"nn")
        listener.wait(first_of_step(steps, 2) + 2)
        os.write(leader, b"\x1b[A\x1b[A\x1b[B\x1b[A")
        until(lambda: listener.ask()["rate"] == pytest.approx(1.1**2))
        os.write(leader, b" ")
        until(lambda: listener.ask()["state"] != "paused")
        assert listener.ask("rate=1000")["state"] in ("playing", "done")
        listener.wait(len(steps))
        assert listener.heard == steps
        listener.leave()
        assert replay.wait(timeout=100) == 0
    finally:
        replay.kill()
        replay.wait()
        os.close(leader)
    assert b"paused x1" in seen
    assert b"messages" in seen


def test_a_second_replay_of_the_same_run_is_refused(recorded, listener):
    first = start(recorded, listener, "--start-paused")
    listener.ask()
    second = recorded.call("replay", str(recorded.log), "--connect", f"tcp/127.0.0.1:{listener.port}")
    assert second.returncode == 2
    assert "already in run" in second.stderr
    first.send_signal(signal.SIGTERM)
    assert first.wait(timeout=100) == 130


def test_a_recorder_records_a_replay(recorded, listener, tmp_path: Path):
    replay = start(recorded, listener, "--start-paused", "-r", "1000")
    listener.ask()
    copy = tmp_path / "copy.mcap"
    recorder = recorded.start(
        "record", "--run", recorded.run, "--connect", f"tcp/127.0.0.1:{listener.port}", "-o", str(copy)
    )
    active = copy.with_name("copy.mcap.active")
    until(active.exists)
    listener.ask("resume")
    everything = len(logged(recorded))
    until(lambda: len(list(McapFile(active).messages())) >= everything, every=0.1)
    recorder.send_signal(signal.SIGINT)
    assert recorder.wait(timeout=100) == 0
    finish(replay, listener)
    assert [(one.channel.topic, one.data) for one in McapFile(copy).messages()] == logged(recorded)
    recorded.verdict(log=copy)


def test_recorders_of_a_replay_end_with_it(recorded, endpoint, tmp_path):
    replay = recorded.start("replay", str(recorded.log), "--listen", endpoint, "--wait", "--rate", "5")
    names = ["first", "second"]
    recorders = [
        recorded.start(
            *("record", "--run", recorded.run, "--name", name, "--connect", endpoint, "--patience", "100"),
            *("-o", str(tmp_path / f"{name}.mcap")),
        )
        for name in names
    ]
    for process in (replay, *recorders):
        ended(process)
    heard = [[message.data for message in McapFile(tmp_path / f"{name}.mcap").messages()] for name in names]
    assert [data for _, data in logged(recorded)] in heard
