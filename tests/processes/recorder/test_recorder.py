"""The recorder in long runs, on full disks, on several hosts, and killed."""

import json
import random
import resource
import signal
from pathlib import Path

import pytest

from benchmarks.kills import Kills
from tests.processes.conftest import ended, settings
from tests.test_benchmarks import ROOT  # noqa: F401 - puts the benchmarks on the path
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.nodes.launch.ports import free_ports


def test_a_rotated_run_is_analysed_and_verified_as_one(world):
    world.complete("record.rotate_bytes=40000", "record.flush_seconds=0.05", "steps=200")
    parts = open_log(world.log).files
    assert len(parts) > 3
    assert sorted(path.name for path in world.folder.glob("*.mcap*")) == sorted(path.name for path in parts)
    metrics = world.metrics(world.folder)
    assert (metrics["complete"], metrics["steps"], metrics["messages"]["missing"]) == (True, 200, 0)
    several = world.call("analyze", *map(str, reversed(parts)), "--json")
    assert json.loads(several.stdout) == metrics
    assert "of 200 steps" in world.verdict()
    world.done("check", str(world.log))


def let_no_file_grow(pid, path):
    """From now on the process's files stay as large as this one is, as if the disk were full."""
    size = path.stat().st_size + 1000
    resource.prlimit(pid, resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("on_full", ["go-on", "stop"])
def test_a_full_disk_is_named_and_what_was_written_stays_readable(world, on_full):
    steps = 300 if on_full == "go-on" else 100_000
    run = world.under_way(f"steps={steps}", f"record.on_full={on_full}", "record.flush_seconds=0.1")
    let_no_file_grow(world.pid_of("record"), world.log.with_name("run.mcap.active"))
    out, err = ended(run, 1)
    assert "File too large" in err
    assert "messages are not in the log" in err
    assert world.wait_until_gone() == {}
    described = json.loads(world.call("info", str(world.log), "--json").stdout)
    assert described["messages"] > 50
    metrics = world.metrics()
    assert 0 < metrics["steps"] < steps
    assert world.call("verify", str(world.log)).returncode in (0, 2)
    assert "position RMSE" in out


def test_recorders_on_each_host_and_a_merge_give_the_whole_log(world):
    names = ["target", "a", "b", *range(4)]
    endpoints = {name: f"tcp/127.0.0.1:{port}" for name, port in zip(names, free_ports(len(names)), strict=True)}

    def options(name, *to):
        links = [part for one in to for part in ("--connect", endpoints[one])]
        return ["--run", world.run, "--no-gossip", "--listen", endpoints[name], *links]

    scenario = settings("record.recorders=2")
    started = [world.start("target", "tracking", *scenario, *options("target"), "--patience", "100")]
    shares = {"a": ["agent/0/**", "agent/1/**", "target/**", "beacon/*"], "b": ["agent/2/*", "agent/3/*", "beacon/2"]}
    for host, share in shares.items():
        keys = [part for key in share for part in ("--keys", key)]
        started.append(world.start("record", *options(host, "target"), "--name", host, *keys, "-o", f"{host}.mcap"))
    for agent in range(4):
        hubs = ["target", "a", "b", *range(agent)]
        started.append(world.start("agent", str(agent), *options(agent, *hubs), "--patience", "100"))
    for process in started:
        ended(process)
    done = world.done("merge", "a.mcap", "b.mcap", "-o", "run.mcap")
    assert "clock of b.mcap" in done.stdout
    assert "shared messages" in done.stdout
    merged = McapFile(world.log)
    topics = {message.channel.topic for message in McapFile(world.folder / "b.mcap").messages()}
    run = f"cbef/{world.run}"
    always = {f"{run}/event/{name}" for name in ("target", "record/b")}
    always |= {f"{run}/beacon/{agent}/signal" for agent in range(4)} | {f"{run}/event/agent/{i}" for i in range(4)}
    assert topics == always | {f"{run}/beacon/2"} | {
        f"{run}/agent/{agent}/{kind}" for agent in (2, 3) for kind in ("round", "estimate", "range")
    }
    assert merged.metadata["cbef.end"]["status"] == "finished"
    for verb in ("check", "verify"):
        world.done(verb, "run.mcap")
    assert world.metrics("run.mcap")["messages"]["missing"] == 0


@pytest.mark.parametrize("keys", [["agent/#"], ["agent/0/**", "**/round"], ["cbef/other/**"]])
def test_impossible_keys_are_refused(world, keys):
    options = [part for key in keys for part in ("--keys", key)]
    done = world.done("record", "--run", world.run, "--connect", "tcp/127.0.0.1:1", *options, status=2)
    assert len(done.stderr.splitlines()) == 1
    assert "key" in done.stderr


def test_a_killed_recorder_leaves_all_that_is_older_than_a_second(tmp_path: Path):
    noise = random.Random(1)  # noqa: S311
    # Beside other tests a recorder has few of the processors: so many messages leave it time.
    with Kills(tmp_path, pause=0.01) as kills:
        for number in range(4):
            kill = kills.kill(number, noise.uniform(0.0, 1.5))
            assert kill.older > 0
            assert kill.lost == 0, kill
            assert kill.signal == -signal.SIGKILL
