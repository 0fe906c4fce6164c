"""What `run` says as it goes: whole on a narrow terminal, with more on a wide one; who is slow; how Ctrl-C counts."""

import os
import re
import signal
import sys

import pytest

from tests.log.made import made_log
from tests.terminal import Terminal
from zenoh_cbef.cli.calling.stops import StopRequests
from zenoh_cbef.cli.run import _Display
from zenoh_cbef.cli.terminal import progress
from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.nodes.launch.launcher import Death
from zenoh_cbef.protocol.slow import REMEDY

SHOWN = """
from zenoh_cbef.cli.run import _Display
from zenoh_cbef.nodes.common.recording import Status
display = _Display(100000, 50)
with display.live:
    display.show(Status("mine", "run.mcap", 100000, agents=13))
    display.live.refresh()
    display.show(Status("mine", "run.mcap", 100000, True, 99998, 0.1234, 123456, 1234567, 7654321))
    display.live.refresh()
"""

OFTEN = """
from zenoh_cbef.cli.calling.main import main
from zenoh_cbef.cli.terminal import one_line
one_line._OFTEN_SECONDS = 0.0
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize("width", [80, 140])
def test_a_run_is_told_whole_at_any_width(monkeypatch, width):
    monkeypatch.delenv("COLUMNS", raising=False)
    with Terminal([sys.executable, "-c", SHOWN], width=width) as screen:
        assert screen.leave() == 0
    for whole in ("step  99998 of 100000 ", "error 0.1234 m 1234567 lost  7654321 late "):
        assert whole in screen.seen
    assert "waits for 37 of 50 agents" in screen.seen
    assert "…" not in screen.seen
    assert ("123456 messages" in screen.seen) == (width == 140)


def test_processes_that_do_not_keep_up_are_named_once_with_the_remedy(capsys):
    display, status = _Display(100, 12), Status("mine", "run.mcap", 100, slow=["agent/10", "agent/2"])
    display.show(status)
    display.show(status)
    assert capsys.readouterr().err == f"warning: agent 2 and agent 10 do not keep up with real time; {REMEDY}\n"
    status.slow.append("target")
    display.show(status)
    assert capsys.readouterr().err == f"warning: target does not keep up with real time; {REMEDY}\n"


def test_what_the_recorder_cannot_do_and_deaths_are_told_at_once(capsys):
    display, status = _Display(100, 12), Status("mine", "run.mcap", 100, behind=1, failure="the disk [/] is full")
    display.show(status)
    display.show(status)
    lacks, late = capsys.readouterr().err.splitlines()
    assert lacks == "warning: the log lacks what comes from now on: the disk [/] is full"
    assert late.startswith("warning: the recorder does not keep up")
    display.mourn(Death("agent 2", -9, ""))
    assert capsys.readouterr().err == "agent 2 was killed by signal 9\n"


def test_work_that_takes_long_is_told_in_lines_where_there_is_no_terminal(capsys, monkeypatch):
    with progress.bar("simulating", 30) as done:
        done(1)
        monkeypatch.setattr(progress, "_SECONDS", 0.0)
        done(20)
        monkeypatch.setattr(progress, "_SECONDS", 1e9)
        done(29)
        done(30)
        done(30)
    assert capsys.readouterr().err == "simulating: 20 of 30\nsimulating: 30 of 30\n"


def test_every_ctrl_c_of_a_run_is_counted_and_ends_nothing():
    before = signal.getsignal(signal.SIGINT)
    with StopRequests() as stops:
        assert stops() == 0
        os.kill(os.getpid(), signal.SIGINT)
        assert stops() == 1
        os.kill(os.getpid(), signal.SIGTERM)
        assert stops() == 2
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "said"), [("verify {log}", "step 3 of 3 executed again"), ("check {log}", "reading")]
)
def test_a_verb_that_reads_a_log_says_so_on_a_terminal_and_takes_it_away(monkeypatch, tmp_path, words, said):
    monkeypatch.delenv("COLUMNS", raising=False)
    log = made_log(tmp_path / "run.mcap", "steps=3")
    with Terminal([sys.executable, "-c", OFTEN, *words.format(log=log).split()]) as screen:
        assert screen.leave() == 0
    assert said in screen.seen
    assert re.search(r"\r(\x1b\[1A)?\x1b\[2?K", screen.seen)
