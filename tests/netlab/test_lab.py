"""The laboratory itself: hosts reach one another as their cables say, and nothing of it is in the machine's network."""

import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.netlab.conftest import netlab

CALL = "import socket, sys; socket.create_connection((sys.argv[1], 9), 0.5)"


def reaches(lab, source: str, destination: str) -> bool:
    """Whether a packet comes through: an answer, if only a refusal, is one."""
    words = [sys.executable, "-c", CALL, lab.address(destination)]
    done = subprocess.run(lab.command(source, words), capture_output=True, text=True, check=False)
    return "ConnectionRefusedError" in done.stderr


def in_time(lab, source: str, destination: str) -> bool:
    """As reaches, but the hosts may first have to ask again for each other's hardware addresses."""
    return any(reaches(lab, source, destination) for _ in range(20))


def state() -> tuple[str, ...]:
    """The machine's interfaces and routes."""
    asked = (["ip", "-o", "link"], ["ip", "route"])
    return tuple(subprocess.run(words, capture_output=True, text=True, check=True).stdout for words in asked)


def test_cables_and_switches_do_what_they_say(lab):
    assert in_time(lab, "a0", "target")
    lab.link("a0", up=False)
    assert not reaches(lab, "a0", "target")
    assert in_time(lab, "a1", "target")
    lab.link("a0", up=True)
    assert in_time(lab, "a0", "target")
    lab.mute("a0", on=True)
    assert not reaches(lab, "a0", "target")
    lab.mute("a0", on=False)
    assert in_time(lab, "a0", "target")
    lab.partition(["a0", "a1"])
    assert in_time(lab, "a0", "a1")
    assert in_time(lab, "a2", "target")
    assert not reaches(lab, "a0", "target")
    lab.partition([])
    assert in_time(lab, "a0", "target")


def test_the_machines_network_is_as_before_and_out_of_reach(lab):
    with netlab.Lab(["x"], lab.name + "b") as other:
        during = state()
        words = [sys.executable, "-c", CALL, "192.0.2.1"]
        done = subprocess.run(other.command("x", words), capture_output=True, text=True, check=False)
        assert "unreachable" in done.stderr
    assert during == state()
    assert netlab.PREFIX not in during[0]


def test_down_ends_processes_and_leaves_nothing(lab):
    with netlab.Lab(["x"], lab.name + "c") as other:
        process = subprocess.Popen(other.command("x", ["sh", "-c", "echo here; exec sleep 60"]), stdout=subprocess.PIPE)
        assert process.stdout is not None
        assert process.stdout.readline()
    assert process.wait(100) == -9
    assert other.name + "-" not in subprocess.run(["ip", "netns"], capture_output=True, text=True, check=True).stdout


def test_what_the_kernel_cannot_do_is_said(lab):
    can, problem = True, ""
    try:
        lab.impair("a0", delay_ms=300.0)
    except netlab.LabError as found:
        can, problem = False, str(found)
    assert can or "sch_netem" in problem or "no program" in problem
    if can:
        before = time.monotonic()
        assert in_time(lab, "a0", "target")
        assert time.monotonic() - before > 0.3
    with pytest.raises(netlab.LabError, match="no host 'nobody'"):
        lab.link("nobody", up=False)


def test_the_command_line_makes_and_removes_a_laboratory():
    program = [sys.executable, str(netlab.__file__), "--name", f"c{Path(sys.prefix).stat().st_ino % 10000}"]

    def call(*words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run([*program, *words], capture_output=True, text=True, check=False)

    try:
        assert call("up", "2").stdout.splitlines() == ["h0 10.77.0.10", "h1 10.77.0.11"]
        assert "10.77.0.11/16" in call("exec", "h1", "ip", "-o", "address").stdout
        for words in (["link", "h1", "down"], ["link", "h1", "up"], ["partition", "h0"], ["heal"]):
            assert call(*words).returncode == 0
    finally:
        assert call("down").returncode == 0
    assert "there is no laboratory" in call("hosts").stderr
