"""Logs that lack something: what is not there is said, and never scored as if it had been measured."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.cli.command_line import call
from tests.log.made import START, made_log
from zenoh_cbef.analysis.coverage import stretches
from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.results import Scored, Yardstick
from zenoh_cbef.analysis.timeline import write_timeline
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.exchange import read_exchange
from zenoh_cbef.log.read.measurements import read_measurements
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.log.tools.filtering import filter_log
from zenoh_cbef.log.tools.selection import Selection
from zenoh_cbef.viewers.scene import read_scene

STEPS = 20


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return made_log(tmp_path_factory.mktemp("whole") / "run.mcap", f"steps={STEPS}", "agents.count=4")


@pytest.fixture
def part(whole, tmp_path):
    def cut(include: str = ".*", exclude: str = "nothing", start: int = 0, end: int = 1 << 63):
        path = tmp_path / f"part{len(list(tmp_path.iterdir()))}.mcap"
        selection = Selection((re.compile(include),), (re.compile(exclude),), start, end)
        filter_log(open_log(whole), path, selection)
        return path

    return cut


def analysed(path) -> Analysis:
    return analyze([read_trace(path)])[0]


def moment(step: int) -> int:
    return START + step * 100_000_000


def test_a_whole_log_lacks_nothing(whole):
    metrics = analysed(whole).metrics
    assert (metrics.complete, metrics.lacks) == (True, [])
    assert metrics.scored == Scored(agents=[0, 1, 2, 3], steps=[[6, 20]], centralized_steps=[[6, 20]])


def test_without_beacons_there_is_no_centralised_filter_and_no_bound(whole, part):
    metrics, before = analysed(part(r".*/(estimate|truth|event.*)")).metrics, analysed(whole).metrics
    assert metrics.position_rmse == before.position_rmse
    assert metrics.complete is False
    assert metrics.ratio_to_centralized is None
    assert metrics.centralized == metrics.bound == Yardstick(None, None, None)
    assert metrics.scored.centralized_steps == []
    assert metrics.bytes_per_step is None
    assert "beacons in steps 1 to 20 are not in the log" in metrics.lacks[0]


def test_without_beacons_of_one_agent_there_is_none_either(part):
    metrics = analysed(part(exclude=r".*/beacon/2")).metrics
    assert metrics.ratio_to_centralized is None
    assert "beacons of agent 2 " in metrics.lacks[0]


def test_without_events_nothing_is_known_of_what_processes_reported(tmp_path):
    path = tmp_path / "part.mcap"
    selection = Selection((re.compile(".*"),), (re.compile(".*/event.*"),), 0, 1 << 63)
    recorded = open_log(Path(__file__).parents[2] / "golden" / "sicf.mcap")
    filter_log(recorded, path, selection)
    metrics = analysed(path).metrics
    assert metrics.complete is False
    assert "no event is in the log: what processes reported, as of slowness or silence, is not known" in metrics.lacks


def test_the_centralised_filter_is_compared_over_its_own_steps(whole):
    trace, before = read_trace(whole), analysed(whole)
    unlogged = np.zeros(trace.ranges.shape, dtype=bool)
    unlogged[1, 11] = True
    some = analyze([type(trace)(**{**vars(trace), "unlogged": unlogged})])[0]
    assert some.metrics.scored.centralized_steps == [[6, 11]]
    own = np.sqrt((before.position_error[:, 5:11] ** 2).mean())
    central = np.sqrt((before.centralized_position_error[5:11] ** 2).mean())
    assert some.metrics.ratio_to_centralized == pytest.approx(own / central)
    assert np.isnan(some.bound[11:]).all()
    np.testing.assert_array_equal(some.bound[:11], before.bound[:11])


def test_steps_outside_the_log_are_absent(whole, part):
    path = part(start=moment(11), end=moment(16))
    found, before = analysed(path), analysed(whole)
    assert found.metrics.steps == 5
    assert found.metrics.scored.steps == [[11, 15]]
    assert found.metrics.complete is False
    np.testing.assert_array_equal(found.position_error[:, 10:15], before.position_error[:, 10:15])
    assert np.isnan(found.position_error[:, :10]).all()
    assert np.isnan(found.disagreement[:10]).all()
    assert any("no estimate of steps 1 to 10 " in said for said in found.metrics.lacks)
    scene = read_scene(path)
    assert scene.time[10] == pytest.approx(moment(11), abs=2e8)


def test_without_truth_there_are_no_errors_and_the_report_says_why(part, tmp_path):
    found = analysed(part(exclude=r".*/truth"))
    assert found.metrics.position_rmse is None
    assert found.metrics.nis is not None
    assert found.metrics.scored == Scored(agents=[], steps=[], centralized_steps=[])
    write_report(found, tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "the filter has no covariance" not in page
    assert "<td>the truth is not known</td>" in page


def test_an_agent_that_is_not_there_is_named(part):
    found = analysed(part(exclude=r".*/agent/3/.*")).metrics
    assert found.scored.agents == [0, 1, 2]
    assert "no estimate of agent 3 is there" in found.lacks[0]


@pytest.mark.parametrize("include", [r".*/(estimate|truth|event.*)", r".*/(estimate|round)", r".*/(beacon/.|estimate)"])
def test_a_timeline_of_a_part_is_drawn_and_says_what_is_not(part, tmp_path, include):
    exchange = read_exchange(part(include))
    for name in ("picture.svg", "picture.html"):
        write_timeline(exchange, tmp_path / name)
    assert "The log holds no " in exchange.notes[0]


def test_verify_says_how_many_messages_it_could_not_compare(part):
    verdict = verify(part(exclude=r".*/agent/1/round"))
    assert verdict.result == "equal"
    assert f"; {STEPS * 10} more are not in the log" in verdict.text
    assert "no estimate of agent 1" in verify(part(exclude=r".*/agent/1/.*")).text


def test_reestimate_says_what_was_not_measured(part):
    said = " ".join(read_measurements(part(exclude=r".*/(beacon/2|truth)")).lacks())
    assert "no beacon of agent 2" in said
    assert f"the truth of 0 of {STEPS} steps" in said


@pytest.mark.parametrize("verb", ["analyze", "compare", "timeline -o {out}.svg", "export -o {out}.npz"])
def test_the_verbs_say_it(part, tmp_path, monkeypatch, capsys, verb):
    path = part(r".*/(estimate|truth|event.*)")
    words = verb.format(out=tmp_path / "out").split()
    monkeypatch.chdir(tmp_path)
    status, _, err = call(monkeypatch, capsys, words[0], str(path), *words[1:])
    assert status == 0
    assert "note: " in err
    assert "beacon" in err


def test_stretches_are_first_and_last_steps():
    there = np.array([True, False, True, True, False, True])
    assert stretches(there) == [[1, 1], [3, 4], [6, 6]]
    assert stretches(~there[:0]) == []
