"""What a host must have is asked for before anything is started."""

import resource
import subprocess
import uuid

import pytest

from tests.processes.conftest import COMMAND, processes_of
from zenoh_cbef import machine

RUN = f"room-{uuid.uuid4().hex[:12]}"


def start(limit: int, soft: int, hard: int, *arguments: str, folder) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        preexec_fn=lambda: resource.setrlimit(limit, (soft, hard)),
    )


JOIN = ("--run", RUN, "--connect", "tcp/127.0.0.1:1", "--patience", "0.5")


@pytest.mark.parametrize(
    ("limit", "size", "arguments", "words"),
    [
        (resource.RLIMIT_NOFILE, 64, ("run", "tracking", "--run", RUN, "--set", "agents.count=40"), "open files"),
        (resource.RLIMIT_NOFILE, 64, ("target", "tracking", "--set", "agents.count=40"), "open files"),
        (resource.RLIMIT_NOFILE, 24, ("agent", "0", *JOIN), "open files"),
        (resource.RLIMIT_NOFILE, 24, ("record", *JOIN), "open files"),
        (resource.RLIMIT_AS, 700 << 20, ("run", "tracking", "--run", RUN), "address space"),
        (resource.RLIMIT_AS, 700 << 20, ("agent", "0", *JOIN), "address space"),
    ],
)
def test_a_limit_is_one_sentence_with_the_remedy_before_the_start(tmp_path, limit, size, arguments, words):
    done = start(limit, size, size, *arguments, folder=tmp_path)
    assert done.returncode == 2, done.stderr
    (sentence,) = [line for line in done.stderr.splitlines() if line.startswith("zenoh-cbef: ")]
    assert words in sentence
    assert "ulimit" in sentence
    assert "Traceback" not in done.stderr
    assert [*tmp_path.rglob("*")] == []
    assert processes_of(RUN) == {}


def test_the_soft_limit_is_raised_where_that_is_allowed(tmp_path):
    done = start(resource.RLIMIT_NOFILE, 20, 4096, "doctor", "--agents", "40", "--json", folder=tmp_path)
    assert '"with 40 agents a process may need ' in done.stdout
    assert "open files" not in done.stdout


def test_memory_for_all_processes_is_asked_for(tmp_path, monkeypatch):
    told = tmp_path / "meminfo"
    told.write_text("MemTotal: 9 kB\nMemAvailable:  1000000 kB\nSwapFree: 24000 kB\n")
    monkeypatch.setattr(machine, "_MEMORY_INFO", told)
    assert machine.memory_short(20) == ""
    assert "21 processes need about 1.1 GB of memory, and 1 GB are free" in machine.memory_short(21)
    monkeypatch.setattr(machine, "_MEMORY_INFO", tmp_path / "none")
    assert machine.memory_short(10**6) == ""


def test_threads_and_ports_for_all_processes_are_asked_for(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "_GROUPS", tmp_path)
    (tmp_path / "pids.max").write_text("max\n")
    monkeypatch.setattr(resource, "getrlimit", lambda _: (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    assert machine.threads_short(10**6) == ""
    (tmp_path / "pids.max").write_text("600\n")
    assert machine.threads_short(50) == ""
    assert "51 processes need about 612 threads, and this user may have 600" in machine.threads_short(51)
    monkeypatch.setattr(machine, "_PORTS", tmp_path / "ports")
    assert machine.ports_short(10**6) == ""
    (tmp_path / "ports").write_text("32768\t32867\n")
    assert machine.ports_short(50) == ""
    assert "51 processes listen on a TCP port each, and the system hands out 100" in machine.ports_short(51)
