"""Many seeds of one scenario on several cores: the figures of one core, no more processes than needed, and Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.command_line import call
from tests.waiting import until
from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment import cores, seeds
from zenoh_cbef.experiment.seeds import metrics_of
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.load import load

SHORT = ("steps=10", "agents.count=4", "network.graph=ring", "fault=[{kind='loss', probability=0.3}]")


def ignore(_: object) -> None:
    """Take what is told."""


@pytest.fixture
def scenario(monkeypatch: pytest.MonkeyPatch) -> Scenario:
    """A short run, of which two seeds are a batch."""
    monkeypatch.setattr(cores, "_BATCH", 80)
    monkeypatch.setattr(cores, "_SHARED", 80)
    return load("tracking", SHORT).scenario


def figures(scenario: Scenario, count: int, jobs: int, progress: Callable[[int], None] = ignore) -> list[Metrics]:
    return metrics_of(scenario, count, 0.25, jobs, progress=progress, tell=ignore)


def test_figures_are_the_same_whatever_the_batches(scenario, monkeypatch):
    scenario = scenario.changed(seed=2**64 - 3)
    finished = list[int]()
    parts = figures(scenario, 7, 1, finished.append)
    assert [one.seed for one in parts] == [(2**64 - 3 + more) % 2**64 for more in range(7)]
    assert finished == sorted(finished)
    assert finished[-1] == 7
    monkeypatch.setattr(cores, "_BATCH", 10**6)
    assert figures(scenario, 7, 1) == parts


@pytest.mark.processes
@pytest.mark.parametrize("seed", [1, 2**64 - 3])
def test_figures_are_the_same_whatever_the_jobs_and_the_batches(scenario, monkeypatch, seed):
    scenario = scenario.changed(seed=seed)
    finished = list[int]()
    spread = figures(scenario, 7, 2, finished.append)
    assert spread == figures(scenario, 7, 1) == figures(scenario, 7, 3)
    assert [one.seed for one in spread] == [(seed + more) % 2**64 for more in range(7)]
    assert finished == sorted(finished)
    assert finished[-1] == 7
    monkeypatch.setattr(cores, "_BATCH", 10**6)
    assert figures(scenario, 7, 2) == spread


def test_what_fits_in_one_batch_stays_in_this_process(scenario, monkeypatch):
    done = list[int]()

    def note(*_: object) -> list[Metrics]:
        done.append(os.getpid())
        return []

    monkeypatch.setattr(seeds, "analyze", note)
    figures(scenario, 2, 2)
    assert done == [os.getpid()]


def test_where_the_system_tells_no_cores_of_a_process_those_of_the_machine_count(monkeypatch):
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 5)
    assert (cores.workers(0), cores.workers(2)) == (5, 2)


def test_the_first_seed_that_diverges_is_told(scenario, monkeypatch):
    def refuse(trace):
        if trace.scenario.seed >= 3:
            raise UserError(f"seed {trace.scenario.seed} diverges")

    monkeypatch.setattr(seeds, "refuse_divergence", refuse)
    with pytest.raises(UserError, match=r"^seed 3 diverges"):
        figures(scenario, 9, 1)


def test_without_joblib_one_core_simulates_and_says_so(scenario, monkeypatch):
    monkeypatch.setitem(sys.modules, "joblib", None)
    told = list[str]()
    assert len(metrics_of(scenario, 5, 0.25, 2, progress=ignore, tell=told.append)) == 5
    (sentence,) = told
    assert sentence == (
        "simulating on several cores needs joblib; run: pip install 'zenoh-cbef[experiment]'; until then one core "
        "simulates"
    )


@pytest.mark.processes
@pytest.mark.usefixtures("scenario")
def test_the_verb_spreads_seeds_over_jobs(monkeypatch, capsys):
    words = ["sim", "tracking", "--seeds", "5", "--json", *(word for one in SHORT for word in ("--set", one))]
    one, two = (call(monkeypatch, capsys, *words, "--jobs", jobs) for jobs in ("1", "2"))
    assert one[:2] == two[:2]
    assert one[0] == 0
    assert json.loads(one[1])["seeds"] == [1, 2, 3, 4, 5]


def children_of(process: int) -> set[int]:
    """The processes that this one has started and that are there."""
    listed = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii")
    return {int(word) for word in listed.split()}


def gone(process: int) -> bool:
    """Whether a process has ended; one that waits to be collected has."""
    try:
        return Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.mark.processes
def test_ctrl_c_ends_all_processes_in_one_word():
    words = [sys.executable, "-m", "zenoh_cbef", "sim", "tracking", "--seeds", "100000", "--jobs", "2"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    workers = set[int]()
    try:
        # Two workers and joblib's resource tracker.
        workers = until(lambda: found if len(found := children_of(process.pid)) >= 3 else None)
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        out, err = process.communicate(timeout=100)
        until(lambda: all(map(gone, workers)))
    finally:
        process.kill()
        for one in workers:
            if not gone(one):
                os.kill(one, signal.SIGKILL)
    assert (process.returncode, out) == (130, "")
    assert err.splitlines()[-1] == "zenoh-cbef: interrupted"
    assert "Traceback" not in err
