"""Where logs go when the command line does not say."""

from contextlib import suppress
from pathlib import Path

import pytest

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.read.parts import find_log
from zenoh_cbef.log.tools.collection import new_folder, place_of_log


def fail_to_start(chosen: Path | None, log: bytes = b"") -> Path:
    """The place that a start had, after it has failed with this much in its log."""
    with suppress(InterruptedError), place_of_log("mine", chosen) as path:
        if log:
            path.with_name("run.mcap.active").write_bytes(log)
        raise InterruptedError
    return path


def test_a_failed_start_leaves_no_folder_and_its_name_is_free(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert str(fail_to_start(None)) == "logs/mine/run.mcap"
        assert not (tmp_path / "logs" / "mine").exists()


def test_what_was_logged_stays_also_after_a_failure(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    fail_to_start(None, b"precious")
    assert str(fail_to_start(None)) == "logs/mine-2/run.mcap"
    assert [one.name for one in (tmp_path / "logs").iterdir()] == ["mine"]


def test_a_folder_that_the_user_chose_is_left_alone(tmp_path):
    assert fail_to_start(tmp_path / "run.mcap") == tmp_path / "run.mcap"
    assert tmp_path.exists()


def test_a_folder_without_a_log_hides_no_run_of_its_name(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    for folder in ("logs/d1", "d1"):
        (tmp_path / folder).mkdir(parents=True)
    with pytest.raises(UserError, match="there is no log in the folder d1; give"):
        find_log(Path("d1"))
    (tmp_path / "logs/d1/run.mcap").write_bytes(b"")
    assert find_log(Path("d1")) == Path("logs/d1/run.mcap")
    (tmp_path / "d1/run.mcap.active").write_bytes(b"")
    assert find_log(Path("d1")) == Path("d1/run.mcap.active")
    with pytest.raises(UserError, match="there is no log d11; did you mean 'd1'"):
        find_log(Path("d11"))
    with pytest.raises(UserError, match="there is no log second; give"):
        find_log(Path("second"))


def test_no_run_takes_the_name_that_leads_to_the_newest(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match="logs/latest leads to the newest run; choose another --run"):
        new_folder("latest")
    assert not (tmp_path / "logs").exists()
