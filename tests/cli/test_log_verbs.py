"""The log tools as commands: exit statuses, and one sentence for a mistake."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.cli.command_line import call
from tests.log.hand_made import written
from tests.log.made import made_log
from tests.within import within
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.tools.collection import GOES_ON
from zenoh_cbef.outside.registry import registered


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Logs: whole, cut within its data, and foreign, which is of no run."""
    path = tmp_path_factory.mktemp("logs")
    data = written(path / "whole.mcap", 50, "record.chunk_bytes=4096").read_bytes()
    (path / "cut.mcap").write_bytes(data[: len(data) // 2])
    (path / "text.mcap").write_text("no log")
    with McapWriter(path / "foreign.mcap", library="test") as writer:
        writer.add_message(writer.register_channel("key", "", 0), 0, 0, 0, b"x")
    return path


@pytest.mark.parametrize(
    ("words", "status"),
    [
        ("check whole.mcap", 0),
        ("check cut.mcap", 1),
        ("check foreign.mcap", 2),
        ("check nothing.mcap", 2),
        ("cat cut.mcap", 3),
        ("filter whole.mcap -y .*/round -o {new}", 0),
        ("filter cut.mcap -o {new}", 3),
        ("filter whole.mcap -y a -n b -o {new}", 2),
        ("filter whole.mcap -o whole.mcap", 2),
        ("filter whole.mcap --start noon -o {new}", 2),
        ("merge whole.mcap cut.mcap -o {new}", 3),
        ("merge whole.mcap ./whole.mcap -o {new}", 2),
        ("merge whole.mcap foreign.mcap -o {new}", 2),
        ("recover whole.mcap -o {new}", 0),
        ("recover cut.mcap -o {new}", 3),
        ("recover text.mcap -o {new}", 1),
        ("recover cut.mcap -o cut.mcap", 2),
    ],
)
def test_exit_statuses_tell_what_happened(folder: Path, tmp_path: Path, words: str, status: int) -> None:
    new = tmp_path / "new.mcap"
    done = within(folder, *words.format(new=new).split())
    assert done.returncode == status, done.stderr
    assert "Traceback" not in done.stderr
    assert new.exists() == ("{new}" in words and status in (0, 3))
    assert list(tmp_path.glob("*.active")) == []
    if status == 2:
        assert len(done.stderr.splitlines()) == 1


def test_info_says_of_a_foreign_file_that_it_is_foreign_and_whether_it_is_whole(folder: Path) -> None:
    data = (folder / "foreign.mcap").read_bytes()
    (folder / "half.mcap").write_bytes(data[:60])
    whole, half = within(folder, "info", "foreign.mcap"), within(folder, "info", "half.mcap")
    for done in (whole, half):
        assert done.returncode == 0
        assert "none, as this is no log of zenoh-cbef" in done.stdout
        assert "killed" not in done.stdout
        assert "complete" not in done.stdout
    assert "state:       whole" in whole.stdout
    assert "state:       cut off" in half.stdout
    assert "state:       complete" in within(folder, "info", "whole.mcap").stdout


def test_what_cat_prints_is_one_object_a_line(folder: Path) -> None:
    done = within(folder, "cat", "whole.mcap", "-y", "cbef/made/agent/1/.*", "-S", "0s", "-E", "0.1s")
    shown = [json.loads(line) for line in done.stdout.splitlines()]
    assert {line["topic"].rsplit("/", 1)[1] for line in shown} == {"estimate", "range", "round"}
    assert all(line["data"]["from"] == "agent/1" for line in shown)


def test_cat_and_filter_say_where_nothing_matches(folder: Path) -> None:
    nothing = within(folder, "cat", "whole.mcap", "-y", "no/such/topic")
    assert (nothing.returncode, nothing.stdout) == (0, "")
    assert "'zenoh-cbef info whole.mcap' has its topics" in nothing.stderr
    assert within(folder, "cat", "whole.mcap", "-y", "cbef/made/agent/1/.*").stderr == ""
    nothing = within(folder, "filter", "whole.mcap", "-y", "no/such/topic", "-o", "nothing.mcap")
    assert nothing.returncode == 0
    assert "'zenoh-cbef info whole.mcap' has its topics" in nothing.stderr


@pytest.mark.parametrize("verb", ["check", "info", "recover"])
def test_a_log_that_is_being_written_is_not_called_damaged(monkeypatch, capsys, tmp_path, verb):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    whole = made_log(tmp_path / "run.mcap", "steps=5")
    log = tmp_path / "run.mcap.active"
    log.write_bytes(whole.read_bytes()[:-2000])
    output = ["-o", str(tmp_path / "new.mcap")] if verb == "recover" else []
    with registered("made", []):
        status, out, err = call(monkeypatch, capsys, verb, str(log), *output)
    assert status == 0
    assert GOES_ON in out + err
    assert "killed" not in out + err
    assert "lost" not in (out + err).replace("nothing was lost", "")
    (tmp_path / "new.mcap").unlink(missing_ok=True)
    _, out, err = call(monkeypatch, capsys, verb, str(log), *output)
    assert GOES_ON not in out + err
