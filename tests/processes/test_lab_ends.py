"""A lab and the run that it started end with what started them, however that ended."""

import os
import signal
import sys
from pathlib import Path

import pytest

from tests.processes.conftest import ended, settings
from tests.waiting import until
from zenoh_cbef.outside.registry import known_runs

pytest.importorskip("uvicorn", reason="the extra 'lab' is not installed")

# In real time, as what is looked at comes after the run has begun, and lockstep would keep both cores busy until then.
WORDS = ("lab", "tracking", *settings("steps=100000", "timing.mode=realtime", "dt=0.5"), "--no-browser")
STARTER = "import subprocess, sys; lab = subprocess.Popen(sys.argv[1:]); print(lab.pid, flush=True); lab.wait()"


def children(pid: int) -> list[int]:
    """A process and all that it started."""
    found = [int(one) for one in Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()]
    return [pid, *(each for one in found for each in children(one))]


def is_there(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_bytes().rsplit(b")", 1)[1].split()[0] != b"Z"
    except OSError:
        return False


@pytest.mark.parametrize("killed", ["lab", "starter"])
def test_a_lab_that_is_killed_or_whose_starter_is_leaves_nothing_behind(world, monkeypatch, tmp_path, killed):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # other tests have runs on this host, too
    starter = world.start(*WORDS, prefix=[sys.executable, "-c", STARTER])
    assert starter.stdout is not None
    assert starter.stderr is not None
    lab = int(starter.stdout.readline())
    next(line for line in starter.stderr if "the lab is at" in line)
    started = children(lab)
    assert len(started) > 6
    try:
        until(known_runs)
        os.kill(lab if killed == "lab" else starter.pid, signal.SIGKILL)
        until(lambda: not any(map(is_there, started)), "some are left", 300.0, every=0.1)
    finally:
        for pid in filter(is_there, started):
            os.kill(pid, signal.SIGKILL)
    assert not known_runs()


def test_ctrl_c_is_how_a_lab_ends(world):
    lab = world.start("lab", "--no-browser")
    assert lab.stderr is not None
    assert "Ctrl-C ends it" in lab.stderr.readline()
    lab.send_signal(signal.SIGINT)
    assert ended(lab) == ("", "")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--set", "nonsense=1"), "starting tracking\nzenoh-cbef: tracking: nonsense is not a key of a scenario"),
        (("--beside", "none.mcap"), "zenoh-cbef: there is no log none.mcap"),
    ],
)
def test_a_lab_that_cannot_begin_says_why_once_and_starts_no_run(world, words, said):
    called = world.done("lab", "tracking", *words, "--no-browser", status=2)
    assert called.stderr.startswith(said)
