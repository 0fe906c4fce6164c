"""Full disks, closed streams, files that cannot be read and Ctrl-C at any time end in one sentence and a status."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.waiting import until

COMMAND = [sys.executable, "-m", "zenoh_cbef"]

# Stands in front of the program: sends it Ctrl-C when a module is about to be imported, or when Python ends.
AT_IMPORT = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Finder())
from zenoh_cbef.cli.calling.main import main
main()
"""
AT_EXIT = """
import atexit, os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == "typer":
            atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))
sys.meta_path.insert(0, Finder())
from zenoh_cbef.cli.calling.main import main
main()
"""
# Sends Ctrl-C when the last objects go, or when an error is told.
AT_FINALISATION = """
import os, signal
class Last:
    def __del__(self, kill=os.kill, me=os.getpid()):
        kill(me, signal.SIGINT)
last = Last()
from zenoh_cbef.cli.calling.main import main
main()
"""
AT_WORDS = """
import os, signal, sys
class Words:
    def write(self, text):
        os.kill(os.getpid(), signal.SIGINT)
        return sys.__stderr__.write(text)
    def flush(self):
        sys.__stderr__.flush()
sys.stderr = Words()
from zenoh_cbef.cli.calling.main import main
main()
"""


PRINTING = ["info {log}", "cat {log}", "check {log}", "scenario show", "--help"]
"""Verbs that print in each of the ways there are."""


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
@pytest.mark.parametrize("words", PRINTING)
def test_a_full_output_is_one_sentence_and_status_2(log: Path, tmp_path: Path, words: str) -> None:
    with Path("/dev/full").open("w") as full:
        command = [*COMMAND, *words.format(log=log).split()]
        done = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
        mute = subprocess.run(command, cwd=tmp_path, stdout=full, stderr=full, check=False)
    assert done.returncode == mute.returncode == 2
    why = "No space left on device; make room, or name another place"
    assert done.stderr == f"zenoh-cbef: cannot write the output: {why}\n"


def test_on_a_full_disk_no_half_of_a_file_is_left(log: Path, tmp_path: Path) -> None:
    copy = shutil.copy(log, tmp_path / "run.mcap")

    def nothing_grows_beyond_a_page() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))

    command = [*COMMAND, "analyze", str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, preexec_fn=nothing_grows_beyond_a_page)
    assert "position RMSE" in done.stdout
    assert "metrics.json: File too large" in done.stderr
    assert not (tmp_path / "metrics.json").exists()


@pytest.mark.parametrize("closed", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_change_nothing(log: Path, closed: str) -> None:
    command = f"'{sys.executable}' -m zenoh_cbef cat '{log}' {closed}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert done.stderr == ""


def test_a_reader_that_leaves_is_no_mistake(log: Path) -> None:
    script = f"'{sys.executable}' -m zenoh_cbef cat '{log}' | head -n 1"
    done = subprocess.run(["bash", "-c", script], capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert len(done.stdout.splitlines()) == 1


@pytest.mark.parametrize("words", ["run {it}", "experiment {it}"])
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, words: str) -> None:
    # A folder cannot be read as a file by the superuser either, whom permissions do not stop.
    unreadable = tmp_path / "mine.toml"
    unreadable.mkdir()
    command = [*COMMAND, *words.format(it=unreadable).split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    what = {"run": "scenario", "experiment": "experiment"}[words.split(maxsplit=1)[0]]
    assert done.stderr == f"zenoh-cbef: {unreadable} is a folder; name the file of the {what}\n"


@pytest.mark.parametrize(
    ("module", "words"),
    [
        ("typing", "sim"),  # before the first line of the program, but for what imports it
        ("typer", "run"),
        ("numpy", "verify {log}"),
        ("zenoh", "replay {log}"),
        ("plotly.offline", "analyze {log} --report"),  # the verb is under way already, and has told what it found
    ],
)
def test_ctrl_c_within_an_import_is_one_line(log: Path, tmp_path: Path, module: str, words: str) -> None:
    command = [sys.executable, "-c", AT_IMPORT.format(module=module), *words.format(log=log).split()]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 130
    assert done.stderr == "zenoh-cbef: interrupted\n"
    assert ("position RMSE" in done.stdout) == ("--report" in words)  # what was found by then is not lost


def test_ctrl_c_when_all_is_done_is_one_line(log: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", AT_EXIT, "info", str(log)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 130
    assert done.stderr == "zenoh-cbef: interrupted\n"


@pytest.mark.parametrize(("script", "status"), [(AT_FINALISATION, 2), (AT_WORDS, 130)])
def test_ctrl_c_after_a_verb_has_failed_never_kills(tmp_path: Path, script: str, status: int) -> None:
    words = [sys.executable, "-c", script, "info", "missing.mcap"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == status
    assert "Traceback" not in done.stderr


def test_a_job_that_ignores_ctrl_c_goes_on(log: Path) -> None:
    script = AT_IMPORT.format(module="numpy").replace("import os, signal, sys", "import os, signal, sys\nignore()")
    script = f"import signal\ndef ignore(): signal.signal(signal.SIGINT, signal.SIG_IGN)\n{script}"
    done = subprocess.run([sys.executable, "-c", script, "info", str(log)], capture_output=True, check=False)
    assert done.returncode == 0


def test_ctrl_c_ends_an_experiment_and_its_workers_with_one_line(tmp_path: Path) -> None:
    (tmp_path / "long.toml").write_text("seeds = 100000\n")
    command = [*COMMAND, "experiment", "long.toml", "--jobs", "2"]
    with subprocess.Popen(
        command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as running:
        try:
            until(lambda: len(workers_of(running.pid)) >= 2)
            assert running.poll() is None
            os.killpg(running.pid, signal.SIGINT)  # as a terminal does, the workers get it as well
            _, said = running.communicate(timeout=100)
        finally:
            leave_none(running.pid)
    assert running.returncode == 130
    assert len(said.splitlines()) == 1
    assert "interrupted" in said
    assert workers_of(running.pid) == []


def workers_of(group: int) -> list[int]:
    """The live processes of a group that joblib started."""
    told = subprocess.run(["ps", "-A", "-o", "pid=,pgid=,stat=,args="], capture_output=True, text=True, check=True)
    rows = [line.split(maxsplit=3) for line in told.stdout.splitlines()]
    return [int(row[0]) for row in rows if row[1] == str(group) and "Z" not in row[2] and "loky" in row[3]]


def leave_none(group: int) -> None:
    for pid in workers_of(group):
        os.kill(pid, signal.SIGKILL)
