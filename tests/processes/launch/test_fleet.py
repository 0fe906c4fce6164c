"""Many agents of one host: they start, die, are started again, and are refused, and all end with their fleet."""

import os
import signal
import time

import pytest

from tests.processes.conftest import World, processes_of, settings
from tests.waiting import until
from zenoh_cbef.cli.terminal.ids import ids_of, shortened
from zenoh_cbef.errors import UserError
from zenoh_cbef.nodes.launch.children import Nursery
from zenoh_cbef.nodes.launch.fleet import SLOW_SECONDS, Fleet
from zenoh_cbef.nodes.launch.ports import free_ports


@pytest.mark.parametrize(
    ("text", "ids"), [("0-3", [0, 1, 2, 3]), ("7", [7]), ("5-6,0,3", [0, 3, 5, 6]), ("1-2,2-3", [1, 2, 3])]
)
def test_a_list_of_agents_is_read_and_written(text, ids):
    assert ids_of(text) == ids
    assert ids_of(shortened(ids)) == ids


@pytest.mark.parametrize("text", ["", "3-1", "a", "0-1000", "-1", "0..3", "1,,2"])
def test_what_is_no_list_of_agents_is_refused_by_name(text):
    with pytest.raises(UserError, match="is no list of agents; write it as in 0-49"):
        ids_of(text)


def test_a_forked_process_is_one_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "broken.json5").write_text("{")
    with Nursery() as nursery:
        words, said = tmp_path / "words", tmp_path / "said"
        with said.open("wb") as output:
            good = nursery.start(["--version"], {}, words, output.fileno())
            bad = nursery.start(["agent", "3", "--run", "r", "--config", "broken.json5"], {}, words)
            assert (good.wait(100), bad.wait(100)) == (0, 2)
        assert said.read_text().startswith("zenoh-cbef ")
        assert "Zenoh refuses broken.json5" in words.read_text()
        os.kill(nursery.pid, signal.SIGKILL)
        with pytest.raises(UserError, match="has ended; start the run again"):
            nursery.start(["--version"], {}, words)


def test_few_agents_of_a_fleet_start_at_once_and_all_in_the_end():
    join = ["--run", "none", "--connect", f"tcp/127.0.0.1:{free_ports(1)[0]}", "--patience", "0.2"]
    counts = []
    with Fleet({one: ["agent", str(one), *join] for one in range(5)}, at_once=2) as fleet:

        def count() -> None:
            now = time.monotonic()
            young = [one for one in fleet.members if one.child is not None and now - one.began < SLOW_SECONDS]
            counts.append(len(young))

        fleet.watch(count, lambda: 0)
    assert 1 <= max(counts) <= 2
    assert all(member.starts == 1 and member.refused for member in fleet.members)


def test_a_fleet_starts_again_what_dies_and_not_what_is_refused(world: World):
    place = f"tcp/127.0.0.1:{free_ports(1)[0]}"
    join = world.join(place)
    steps = settings("steps=400")
    target = world.start("target", "tracking", *steps, "--run", world.run, "--listen", place, "--patience", "100")
    record = world.start("record", *join, "--output", str(world.log))
    fleet = world.start("fleet", "0-4", *join)
    world.wait_for_messages()
    killed = world.pid_of("agent 2")
    os.kill(killed, signal.SIGKILL)
    out, err = fleet.communicate(timeout=100)
    assert (target.wait(100), record.wait(100)) == (0, 0), target.stderr
    assert out.splitlines() == ["agents 0-3 ended after step 400", "agent 2 had to be started again, 1 time in all"]
    assert f"agent 4: run '{world.run}' has agents 0 to 3, no agent 4" in err
    assert "agent 2 was killed by signal 9; it is started again" in err
    assert fleet.returncode == 1
    assert "agent/2 was started again" in world.verdict(2)


def test_a_fleet_ends_all_its_agents_when_it_is_told_to_and_when_it_dies(world: World):
    join = ["--run", world.run, "--connect", f"tcp/127.0.0.1:{free_ports(1)[0]}"]
    for number, status in ((signal.SIGINT, 130), (signal.SIGKILL, -9)):
        fleet = world.start("fleet", "0-2", *join)
        until(lambda: sum("zenoh_cbef agent" in line for line in processes_of(world.run).values()) >= 3, every=0.05)
        fleet.send_signal(number)
        assert fleet.wait(100) == status
        assert not world.wait_until_gone()
