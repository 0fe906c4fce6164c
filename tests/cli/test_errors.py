"""A user's mistake gets one sentence on standard error and exit status 2, never a traceback."""

import socket
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.writer import Writer

from tests.cli.command_line import call

MISTAKES = {
    "unknown scenario": (["sim", "trakcing"], "did you mean 'tracking'"),
    "unknown fault": (["fault", "add", "dropout"], "did you mean 'sensor-dropout'"),
    "no fault at all": (["fault", "add", "nonsense"], "see 'zenoh-cbef fault kinds'"),
    "a verb of others": (["report", "x.mcap"], "Did you mean 'analyze --report'?"),
    "a verb of other programs": (["bag", "info", "x.mcap"], "Did you mean 'record', 'info', 'filter' or 'replay'?"),
    "an option of other programs": (["cat", "x.mcap", "--topics", "/a"], "option: --topics. Did you mean '-y'?"),
    "a number of an option with a letter": (["replay", "x.mcap", "-r", "0"], "--rate must be greater than or equal to"),
    "number in words": (["sim", "--seeds", "x"], "--seeds must be a whole number; see 'zenoh-cbef sim -h'"),
    "too few": (["sim", "--seeds", "0"], "--seeds must be greater than or equal to 1; see"),
    "half a number": (["sim", "--skip", "y"], "--skip must be a number; see"),
    "unknown format": (["export", "--to", "x"], "--to 'x' is not one of 'npz', "),
    "unknown key": (["sim", "--set", "consensus.roundz=3"], "did you mean 'consensus.rounds'"),
    "not a setting": (["sim", "--set", "consensus.rounds"], "a.b=value"),
    "xi of zero": (["sim", "--set", "filter.xi=0"], "filter.xi"),
    "disconnected": (["run", "--set", "network.edges=[[0,1]]"], "falls apart"),
    "unstable epsilon": (
        ["run", "--set", "consensus.weights=uniform", "--set", "consensus.epsilon=0.9"],
        "stable limit",
    ),
    "more agents than positions": (["run", "--set", "agents.positions=[[0,0,0]]"], "add positions"),
    "no dataset": (["run", "--set", "target.motion=dataset", "--set", "target.path=nowhere"], "anchors.csv"),
    "no log": (["analyze", "nowhere.mcap"], "there is no log"),
    "no endpoint": (["agent", "1", "--run", "x"], "--connect"),
    "no such endpoint": (["agent", "1", "--run", "x", "--connect", "localhost"], "is no endpoint"),
    "bad run name": (["agent", "1", "--run", "a/b", "--connect", "tcp/127.0.0.1:1"], "run name"),
    "bad run name, run": (["run", "--run", "a b"], "run name"),
    "bad run name, reestimate": (["reestimate", "nowhere.mcap", "--run", "a/b"], "run name"),
    "bad run name, target": (["target", "--run", ".."], "run name"),
    "bad run name, status": (["status", "--run", "a*"], "run name"),
    "bad run name, fault": (["fault", "list", "--run", "-a"], "run name"),
    "bad run name, record": (["record", "--run", "a#", "--connect", "tcp/127.0.0.1:1"], "run name"),
    "bad run name, health": (["health", "target", "--run", "$*"], "run name"),
    "long run name": (["stop", "--run", "a" * 250], "use at most 200"),
    "bad name of a recorder": (["record", "--run", "x", "--name", "a/b", "--connect", "tcp/127.0.0.1:1"], "name name"),
    "nobody answers": (
        ["agent", "1", "--run", "x", "--connect", "tcp/127.0.0.1:9", "--patience", "0.3"],
        "no target of run 'x' answers",
    ),
    "nothing to compare": (["compare", "nowhere.mcap"], "there is no log"),
    "no such picture": (["compare", "nowhere.mcap", "-o", "x.gif"], ".csv for the rows or .html"),
    "no percentage": (["design", "--within", "little"], "--within 1%"),
    "nothing to estimate from": (["reestimate", "nowhere.mcap"], "there is no log"),
    "nothing to replay": (["replay", "nowhere.mcap"], "there is no log"),
    "no folder": (["export", "nowhere.mcap", "--to", "npz"], "there is no log"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_one_sentence_with_its_remedy(monkeypatch, capsys, tmp_path, mistake):
    monkeypatch.chdir(tmp_path)
    arguments, words = MISTAKES[mistake]
    status, out, err = call(monkeypatch, capsys, *arguments)
    assert status == 2
    assert out == ""
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir()), "a refused command leaves nothing behind"


@pytest.mark.parametrize("verb", ["info", "analyze", "verify", "export", "reestimate", "replay"])
def test_a_file_that_is_no_mcap_is_refused(monkeypatch, capsys, tmp_path, verb):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.mcap").write_text("hello")
    status, _, err = call(monkeypatch, capsys, verb, "text.mcap")
    assert status == 2
    assert "no MCAP file" in err
    assert "Traceback" not in err


def test_an_empty_file_and_a_log_cut_before_its_scenario_are_told_as_such(monkeypatch, capsys, tmp_path):
    (tmp_path / "empty.mcap").touch()
    assert (
        "empty.mcap is no MCAP file: it is empty"
        in call(monkeypatch, capsys, "analyze", str(tmp_path / "empty.mcap"))[2]
    )
    whole = (Path(__file__).parents[1] / "golden" / "sicf.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:1000])
    status, _, err = call(monkeypatch, capsys, "analyze", str(tmp_path / "cut.mcap"))
    assert status == 2
    assert "damaged before its scenario" in err
    assert "()" not in call(monkeypatch, capsys, "info", str(tmp_path / "cut.mcap"))[1]


def test_a_foreign_mcap_is_described_but_not_analysed(monkeypatch, capsys, tmp_path):
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/x", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    assert call(monkeypatch, capsys, "info", str(path))[0] == 0
    status, _, err = call(monkeypatch, capsys, "analyze", str(path))
    assert status == 2
    assert "no log of zenoh-cbef" in err


def test_a_port_in_use_is_named(monkeypatch, capsys):
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        endpoint = f"tcp/127.0.0.1:{holder.getsockname()[1]}"
        status, _, err = call(monkeypatch, capsys, "target", "--listen", endpoint)
    assert status == 2
    assert endpoint in err
    assert "in use" in err


def test_a_log_is_never_overwritten(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run.mcap").write_text("precious")
    status, _, err = call(monkeypatch, capsys, "run", "--log", "run.mcap")
    assert status == 2
    assert "never overwritten" in err
    assert (tmp_path / "run.mcap").read_text() == "precious"


def test_cbef_warns_where_its_gain_cannot_contract(monkeypatch, capsys):
    status, out, _ = call(monkeypatch, capsys, "scenario", "check", "--set", "filter.kind=cbef")
    assert status == 0
    assert "largest eigenvalue of H^T H" in out
    status, out, _ = call(monkeypatch, capsys, "scenario", "check", "paper")
    assert status == 0
    assert "warning" not in out


def test_sim_says_which_scheme_was_picked_and_why(monkeypatch, capsys):
    short = ("sim", "--set", "steps=2")
    loss = ("--set", 'fault=[{kind="loss", probability=0.1}]')
    assert "consensus.scheme = average: no link has a fault" in call(monkeypatch, capsys, *short)[2]
    assert "consensus.scheme = running-sums: links have faults" in call(monkeypatch, capsys, *short, *loss)[2]
    given = call(monkeypatch, capsys, *short, *loss, "--set", "consensus.scheme=average")[2]
    assert "consensus.scheme" not in given


def test_a_new_scenario_can_be_checked_and_is_not_overwritten(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert call(monkeypatch, capsys, "scenario", "new", "mine.toml", "--from", "outliers")[0] == 0
    assert call(monkeypatch, capsys, "scenario", "check", "mine.toml")[0] == 0
    assert call(monkeypatch, capsys, "scenario", "new", "mine.toml")[0] == 2


def test_the_module_and_the_command_are_the_same_program():
    done = subprocess.run([sys.executable, "-m", "zenoh_cbef", "--version"], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("zenoh-cbef ")


def test_numbers_out_of_proportion_end_in_a_sentence(monkeypatch, capsys):
    absurd = ["--set", "steps=30", "--set", "filter.acceleration_std=1e5", "--set", "dt=1000"]
    status, _, err = call(monkeypatch, capsys, "sim", "tracking", *absurd)
    assert status == 2
    assert "zenoh-cbef: standard deviations are out of proportion" in err
    assert "Traceback" not in err
