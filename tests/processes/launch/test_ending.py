"""A process tells its launcher as data why it ends; its words on standard error decide nothing."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys

import pytest

from zenoh_cbef.nodes.common.ending import PLACE, Ending, ending_at


@pytest.mark.parametrize("told", [Ending("crash", 12), Ending("crash"), Ending("port")])
def test_an_ending_arrives_as_it_was_told(monkeypatch, tmp_path, told):
    monkeypatch.setenv(PLACE, str(tmp_path / "ending.json"))
    told.tell()
    assert ending_at(tmp_path / "ending.json") == told


def test_without_a_launcher_an_ending_is_told_nowhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv(PLACE, raising=False)
    Ending("port").tell()
    assert list(tmp_path.iterdir()) == []
    assert ending_at(tmp_path / "ending.json") is None


def test_half_an_ending_is_none(tmp_path):
    (tmp_path / "ending.json").write_text('{"cause": "cra')
    assert ending_at(tmp_path / "ending.json") is None


def test_a_process_that_its_scenario_kills_tells_for_how_long(monkeypatch, tmp_path):
    monkeypatch.setenv(PLACE, str(tmp_path / "ending.json"))
    done = subprocess.run(
        [sys.executable, "-c", "from zenoh_cbef.nodes.common.standstill import die; die(20, 50)"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL
    assert ending_at(tmp_path / "ending.json") == Ending("crash", 30)
    assert done.stderr == "the scenario's crash kills this process at step 20, until step 50\n"


def test_a_target_whose_port_is_taken_tells_so(monkeypatch, tmp_path):
    monkeypatch.setenv(PLACE, str(tmp_path / "ending.json"))
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        command = [sys.executable, "-m", "zenoh_cbef", "target", "--listen", endpoint]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert ending_at(tmp_path / "ending.json") == Ending("port")
