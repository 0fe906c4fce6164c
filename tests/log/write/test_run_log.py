"""What a log counts as lost is what cannot be read back."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import free_path
from zenoh_cbef.log.mcap import pile
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.protocol.messages import encode
from zenoh_cbef.scenario.model import Record

KEY = "cbef/test/event"


def write(log: RunLog, numbers: range) -> None:
    for number in numbers:
        log.add(KEY, encode("test", "target", number, number, {"kind": "x", "text": "", "data": {}}), number)


@pytest.fixture
def log(tmp_path: Path) -> RunLog:
    (tmp_path / "logs").mkdir()
    made = RunLog(tmp_path / "logs" / "run.mcap", Record())
    made.describe(source="", resolved="", run={})
    write(made, range(10))
    made.flush()
    return made


def test_what_came_is_lost_where_the_folder_was_removed_and_another_part_begins(log):
    shutil.rmtree(log.path.parent)
    write(log, range(10, 15))
    log.flush()
    assert "No such file" in log.failure
    assert (log.count, log.dropped) == (0, 15)
    write(log, range(15, 20))
    log.close({})
    assert (log.count, log.dropped) == (5, 15)
    (part,) = log.path.parent.glob("*.mcap")
    assert [message.sequence for message in McapFile(part).messages()] == [*range(15, 20)]


def test_a_folder_that_is_removed_just_before_the_end_is_noticed(log):
    shutil.rmtree(log.path.parent)
    log.close({})
    assert (log.count, log.dropped) == (0, 10)


def test_another_part_begins_where_the_file_was_removed(log):
    log.active.unlink()
    log.flush()
    write(log, range(10, 15))
    log.close({})
    assert (log.count, log.dropped) == (5, 10)
    (part,) = log.path.parent.glob("*.mcap")
    assert [message.sequence for message in McapFile(part).messages()] == [*range(10, 15)]


def test_nothing_is_lost_of_a_log_that_was_moved(log, tmp_path):
    log.path.parent.rename(tmp_path / "elsewhere")
    write(log, range(10, 15))
    log.close({})
    assert "No such file" in log.failure
    assert (log.count, log.dropped) == (15, 0)
    assert len(list(McapFile(tmp_path / "elsewhere" / log.active.name).messages())) == 15


FULL = """
import json, resource, signal, sys
from pathlib import Path
from tests.log.write.test_run_log import write
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.scenario.model import Record
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
for limit in map(int, sys.argv[2:]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    log = RunLog(Path(sys.argv[1]) / f"{limit}.mcap", Record(chunk_bytes=2048, compression="none"))
    log.describe(source="", resolved="", run={})
    for first in range(0, 1000, 7):
        write(log, range(first, first + 7))
        if not first % 4:
            log.flush()
    log.close({})
    print(json.dumps([limit, log.count, log.dropped, str(log.failure)]))
"""


@pytest.mark.processes
def test_what_does_not_fit_on_a_full_disk_is_counted(tmp_path):
    limits = [2_000, 5_000, 20_011, 60_000]
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(tmp_path), *map(str, limits)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert [limit for limit, *_ in told] == limits
    for limit, count, dropped, failure in told:
        path = tmp_path / f"{limit}.mcap"
        file = path if path.exists() else path.with_name(f"{limit}.mcap.active")
        assert "too large" in failure
        assert (count, dropped) == (len(list(open_log(file).messages())), 1001 - count)


def test_the_index_of_a_long_log_lies_on_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(pile, "_IN_MEMORY", 256)
    path = tmp_path / "log.mcap"
    with McapWriter(path, library="test") as writer:
        channel = writer.register_channel("key", "", 0)
        for number in range(100):
            writer.add_message(channel, number, number, number, b"x")
            writer.flush()
    assert [*tmp_path.iterdir()] == [path]
    file = McapFile(path)
    assert (file.complete, file.damage, file.summary().chunks) == (True, [], 100)
    assert [message.sequence for message in file.messages()] == [*range(100)]


@pytest.mark.parametrize("there", [True, False])
def test_what_is_put_aside_comes_back_also_where_there_is_no_place_for_it(tmp_path, there):
    records = [bytes([number % 251]) * 1000 for number in range(500)]
    one = pile.Pile(tmp_path if there else tmp_path / "gone")
    for record in records:
        one.add(record)
    assert one.in_memory < 70_000 if there else one.in_memory == 500_000
    assert one.read() == b"".join(records)
    one.close()


def test_a_log_of_several_files_names_no_more_made_up_keys_than_one(tmp_path):
    log = RunLog(tmp_path / "run.mcap", Record(rotate_bytes=20_000))
    for number in range(3000):
        log.add(f"cbef/run/nonsense/{number}", encode("run", "agent/1", 0, 0, {"kind": "x", "text": "x"}), 0)
        log.add(f"cbef/run/event/record/{number}", encode("run", f"record/{number}", 0, 0, {"kind": "x"}), 0)
        log.flush()
    log.close({})
    assert (tmp_path / "run.2.mcap").exists()
    assert log.foreign == 4000


def test_names_that_processes_chose_leave_room_for_the_keys_of_the_run(log):
    def send(key: str, sender: str) -> str:
        return log.add(f"cbef/run/{key}", encode("run", sender, 0, 0, {"kind": "x", "text": "x"}), 0)

    for number in range(1500):
        send(f"event/receiver/{number}", f"receiver/{number}")
        send(f"nonsense/{number}", f"receiver/{number}")
    assert log.foreign == 1000
    assert send("event/agent/1", "agent/1") == "event"
    assert send("event/target", "target") == "event"
    assert log.foreign == 1000
    # The target counts on every key of a crowd; a look at one sender's gaps does not look at the others'.
    log.add("cbef/run/beacon/1", encode("run", "target", 3, 0, {"k": 1}), 0)
    log.add("cbef/run/beacon/1", encode("run", "receiver/1", 2, 0, {"k": 1}), 0)
    assert log.gaps("target") == [("target", "cbef/run/beacon/1", 0, 2)]
    assert len(log.gaps()) == 2


@pytest.mark.parametrize("left", ["run.mcap.active", "run.2.mcap.active"])
def test_what_a_killed_recorder_left_is_not_written_over(tmp_path, left):
    path = tmp_path / "run.mcap"
    assert free_path(path) == path
    if left != "run.mcap.active":
        path.write_bytes(b"whole")
    (tmp_path / left).write_bytes(b"precious")
    if not path.exists():
        with pytest.raises(UserError, match=rf"{left} is being written, or its recorder was killed"):
            RunLog(path, Record())
    (tmp_path / "run-2.mcap").write_bytes(b"of the recorder after it")
    assert free_path(path) == tmp_path / "run-3.mcap"
    RunLog(free_path(path), Record()).close({})
    assert (tmp_path / left).read_bytes() == b"precious"


@pytest.mark.processes
def test_a_log_that_cannot_be_begun_leaves_no_file(tmp_path):
    script = (
        "import resource, sys; from pathlib import Path; from zenoh_cbef.log.write.run_log import RunLog;"
        "from zenoh_cbef.scenario.model import Record; resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300));"
        "RunLog(Path(sys.argv[1]), Record()).describe(source='x' * 1000, resolved='', run={})"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path / "run.mcap")], capture_output=True, text=True, check=False
    )
    assert "cannot write" in done.stderr.splitlines()[-1]
    assert [*tmp_path.iterdir()] == []
