"""Interrupted and killed: the log stays readable, dead processes are named, and no process is left behind."""

import json
import os
import signal
import socket
import sys
import time
from pathlib import Path

import pytest

from tests.processes.conftest import ended, processes_of, settings
from tests.waiting import until
from zenoh_cbef.cli.calling import main as command_line
from zenoh_cbef.nodes.launch import launcher
from zenoh_cbef.nodes.launch.ports import free_ports

LONG = "steps=100000"


def test_ctrl_c_once_stops_all_at_the_same_step_and_the_log_still_verifies(world):
    run = world.under_way(LONG)
    run.send_signal(signal.SIGINT)
    out, _ = ended(run, 130)
    assert "position RMSE" in out
    assert not world.wait_until_gone()
    assert "the run ended at step" in world.verdict()


def test_ctrl_c_before_the_first_step_names_no_process_as_dead(world):
    run = world.start_run(LONG)
    until(lambda: any("zenoh_cbef agent 0 " in line for line in processes_of(world.run).values()))
    run.send_signal(signal.SIGINT)
    _, err = ended(run, 130)
    assert "ended with status" not in err
    assert not world.wait_until_gone()


def wait_until_taken(run) -> None:
    """Until no signal waits for the process, which on a busy machine could take two for one."""

    def waits() -> bool:
        lines = Path(f"/proc/{run.pid}/status").read_text().splitlines()
        return any(int(line.split()[1], 16) for line in lines if line.startswith(("SigPnd", "ShdPnd")))

    until(lambda: not waits())


def test_ctrl_c_twice_stops_now_and_leaves_a_readable_log(world):
    run = world.under_way(LONG)
    os.kill(world.pid_of("target"), signal.SIGSTOP)  # a polite stop would now take its time
    run.send_signal(signal.SIGINT)
    wait_until_taken(run)
    time.sleep(0.5)
    assert run.poll() is None
    run.send_signal(signal.SIGINT)
    out, err = ended(run, 130)
    assert "ended at once; 'analyze " in err
    assert out == "", "the log is long, and who asks twice does not wait for its analysis"
    assert not world.wait_until_gone()
    world.done("info", str(world.log))


def test_a_killed_agent_is_named_and_the_others_finish(world):
    run = world.under_way("steps=300")
    os.kill(world.pid_of("agent 2"), signal.SIGKILL)
    out, err = ended(run, 1)
    assert "agent 2 was killed by signal 9" in err
    assert "300 steps (incomplete)" not in out
    metrics = world.metrics()
    into_two = [link for link in metrics["links"] if link["source"] == 2]
    assert all(link["sent"] < 3 * 300 and link["lost"] <= 3 for link in into_two), "the dead send nothing"
    assert "agent 2 left" in world.verdict(2)


def test_a_killed_recorder_loses_little_and_the_log_so_far_is_analysed(world):
    run = world.under_way("steps=300", size=100_000)
    os.kill(world.pid_of("record"), signal.SIGKILL)
    next(line for line in run.stderr if line == "recorder was killed by signal 9\n")
    assert run.poll() is None, "it is told at once"
    out, err = ended(run, 1)
    assert "agent" not in err.replace("agents", "")
    assert f"'zenoh-cbef recover {world.log}.active -o LOG' makes a whole one" in err
    assert "incomplete" in out
    assert "? not logged" in out
    for verb in ("info", "analyze", "verify"):
        assert world.call(verb, str(world.log)).returncode == 0, verb


def test_a_killed_target_leaves_the_agents_predicting_to_the_end(world):
    run = world.under_way("steps=250")
    os.kill(world.pid_of("target"), signal.SIGKILL)
    out, err = ended(run, 1)
    assert "target was killed by signal 9" in err
    assert "250 steps (incomplete)" in out
    analysed = world.call("analyze", str(world.log), "--json")
    assert "NaN" not in analysed.stdout
    assert json.loads(analysed.stdout)["complete"] is False


def test_a_hung_agent_is_left_behind_and_ended(world):
    run = world.under_way("steps=150", "zenoh.lease_ms=1000")
    os.kill(world.pid_of("agent 1"), signal.SIGSTOP)
    _, err = ended(run, 1)
    assert "agent 1 had to be ended" in err
    assert not world.wait_until_gone()


@pytest.mark.parametrize("others", [["agent 1"], ["record"]])
def test_a_hung_target_is_ended_when_all_others_are_done(world, others):
    run = world.under_way("steps=150", "zenoh.lease_ms=1000", "timing.patience=1")
    for name in ("target", *others):
        os.kill(world.pid_of(name), signal.SIGSTOP)
    _, err = ended(run, 1)
    assert "target had to be ended" in err
    assert not world.wait_until_gone()


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_launcher_that_is_killed_leaves_no_orphan_and_a_closed_log(world, number):
    run = world.under_way(LONG)
    run.send_signal(number)
    run.wait(100)
    assert not world.wait_until_gone()
    assert world.log.exists()
    world.verdict()


def test_a_port_that_another_program_took_first_makes_the_run_start_again(monkeypatch, capsys, tmp_path):
    with socket.socket() as thief:
        thief.bind(("127.0.0.1", 0))
        thief.listen()
        taken = thief.getsockname()[1]
        offers = iter([[taken]])
        honest = free_ports
        monkeypatch.setattr(launcher, "free_ports", lambda count: (next(offers, []) + honest(count))[:count])
        log = tmp_path / "run.mcap"
        monkeypatch.setattr(
            sys, "argv", ["zenoh-cbef", "run", "tracking", *settings(), "--log", str(log), "--no-report"]
        )
        with pytest.raises(SystemExit) as ended:
            command_line.main()
    assert not ended.value.code, capsys.readouterr().err
    assert log.exists()
