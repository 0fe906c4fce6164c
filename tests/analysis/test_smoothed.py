"""Smoothed paths of runs: better than the filter's, as good as a centralised smoother's, and honest about it."""

from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader

from tests.cli.command_line import call
from tests.log.made import made_log
from zenoh_cbef.analysis.error_charts import error_charts
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.smoothed import smoothed_run
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.smoothed import smoothed_trace
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.trace import SmoothedPath, Trace

LOSS = 'fault=[{kind="loss", probability=0.3}]'


def run(*overrides, seeds=(1,)):
    scenario = load("tracking", overrides).scenario
    return simulate([scenario.changed(seed=seed) for seed in seeds])


def path_of(trace: Trace) -> SmoothedPath:
    assert trace.smoothed is not None
    return trace.smoothed


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "most"), [("fault=[]", 1.02), (LOSS, 1.05)])
def test_agents_smooth_as_well_as_a_centralised_smoother(fault, most):
    found = [one.metrics for one in analyze(run("steps=90", "filter.lag_seconds=1", fault, seeds=range(1, 9)))]
    assert np.median([pick(one, "smoothed.ratio_to_centralized") for one in found]) < most
    better = [pick(one, "smoothed.position_rmse") / pick(one, "position_rmse") for one in found]
    assert 0.4 < np.median(better) < 0.7
    assert 0.7 < np.mean([pick(one, "smoothed.nees.average") for one in found]) / 6 < 1.3


def test_a_lag_as_long_as_the_run_is_the_whole_run_smoothed():
    (whole,) = run("steps=40", "filter.lag_seconds=100")
    again = smoothed_run(replace(whole, smoothed=None))
    assert np.array_equal(path_of(whole).states, path_of(again).states)
    assert np.array_equal(path_of(whole).covariances, path_of(again).covariances)


def test_a_run_that_does_not_smooth_says_nothing_of_it():
    (trace,) = run("steps=20")
    assert trace.smoothed is None
    assert analyze([trace])[0].metrics.smoothed is None


def test_agents_that_are_away_or_forget_leave_gaps_that_the_whole_run_bridges():
    fault = 'fault=[{kind="crash", agents=[2], from=1.0, until=2.0}, {kind="pause", agents=[4], from=1.0, until=2.0}]'
    (trace,) = run("steps=40", "filter.lag_seconds=0.3", fault)
    told = np.asarray(np.isfinite(path_of(trace).states).all(axis=2))
    # An agent that is killed at step 10 had not yet told of steps 7 to 9; the one that goes on tells three steps late.
    assert np.flatnonzero(~told[2]).tolist() == list(range(6, 19))
    assert np.flatnonzero(~told[4]).tolist() == list(range(6, 16))
    assert told[[0, 1, 3, 5]].all()
    whole = path_of(smoothed_run(trace))
    assert np.isfinite(whole.states).all()
    assert np.linalg.norm(whole.states[2, :, :3] - whole.states[0, :, :3], axis=1).max() < 0.5


def test_estimates_that_cannot_be_smoothed_are_refused_with_the_remedy():
    with pytest.raises(UserError, match=r"'cbef' has no covariance.*reestimate LOG --smooth --set filter.kind=sicf"):
        smoothed_run(run("steps=5", "filter.kind=cbef")[0])
    with pytest.raises(UserError, match=r"filter.lag_seconds.*'cbef-scaled' has no covariance; set filter.kind"):
        load("tracking", ["filter.kind=cbef-scaled", "filter.lag_seconds=1"])


@pytest.mark.slow
@pytest.mark.parametrize("motion", ["filter.motion=turn", "target.motion=circle"])
def test_a_filter_that_knows_more_than_the_log_smooths_with_all_of_it(motion):
    (trace,) = run("steps=100", motion, "filter.lag_seconds=20")
    found = analyze([trace])[0].metrics
    assert pick(found, "smoothed.position_rmse") < 0.7 * pick(found, "position_rmse")
    assert 0.8 < pick(found, "smoothed.ratio_to_centralized") < 1.2


@pytest.mark.parametrize("motion", ["filter.motion=acceleration", "target.motion=circle"])
def test_of_a_log_it_smooths_with_all_of_it_too(motion, tmp_path):
    """The agents' own smoothed estimates, had they waited for the whole run."""
    log = made_log(tmp_path / "run.mcap", "steps=30", motion)
    live = made_log(tmp_path / "live.mcap", "steps=30", motion, "filter.lag_seconds=3")
    done: list[int] = []
    found, note = smoothed_trace(read_trace(log), log, progress=done.append)
    assert done == list(range(1, 31))
    assert note == ""
    expected = path_of(read_trace(live))
    assert np.array_equal(path_of(found).states, expected.states)
    assert np.array_equal(path_of(found).covariances, expected.covariances)
    whole = read_trace(live)
    assert smoothed_trace(whole, live)[0] is whole


@pytest.mark.slow
def test_the_path_of_a_filter_computed_again_has_no_gap_where_an_agent_was_away(tmp_path):
    fault = 'fault=[{kind="crash", agents=[2], from=1.0, until=2.0}]'
    log = made_log(tmp_path / "run.mcap", "steps=40", "target.motion=circle", fault)
    found, note = smoothed_trace(read_trace(log), log)
    path = path_of(found).states
    assert note == ""
    assert np.linalg.norm(path[2, :, :3] - path[0, :, :3], axis=1).max() < 0.5


def test_a_path_of_other_estimates_than_the_log_s_says_so(tmp_path):
    log = made_log(tmp_path / "run.mcap", "steps=10", "target.motion=circle")
    trace = read_trace(log)
    trace.estimates[1, 4] += 1e-9
    note = smoothed_trace(trace, log)[1]
    assert note.endswith("as in lockstep: the smoothed path is of that, and 1 of the log's 60 estimates differ")


def test_covariances_that_are_none_count_as_missing():
    (trace,) = run("steps=20")
    trace.covariances[1, 7] = 0.0
    trace.covariances[2, 8] = -np.eye(6)
    assert np.isfinite(path_of(smoothed_run(trace)).covariances).all()


@pytest.mark.slow
def test_the_verbs_smooth(monkeypatch, capsys, tmp_path):
    log = made_log(tmp_path / "run.mcap", "steps=30")
    again = tmp_path / "again.mcap"
    status, _, err = call(monkeypatch, capsys, "reestimate", str(log), "--smooth", "-o", str(again), "--run", "again")
    assert status == 0, err
    assert verify(again).result == "equal"
    assert np.array_equal(path_of(read_trace(again)).states, path_of(smoothed_run(read_trace(log))).states)
    status, _, _ = call(monkeypatch, capsys, "export", str(log), "--smooth", "-o", str(tmp_path / "smooth.npz"))
    assert status == 0
    exported = np.load(tmp_path / "smooth.npz")
    assert np.array_equal(exported["smoothed"], path_of(read_trace(again)).states)
    assert exported["smoothed_covariances"].shape == (6, 30, 6, 6)
    status, out, _ = call(monkeypatch, capsys, "analyze", str(log), "--smooth")
    assert status == 0
    assert "smoothed position" in out
    for smooth in ([], ["--smooth"]):
        status, out, _ = call(monkeypatch, capsys, "compare", str(log), *smooth)
        assert (status, "smooth" in out) == (0, bool(smooth))
    status, out, _ = call(monkeypatch, capsys, "export", str(log), "--smooth", "-o", str(tmp_path / "smooth.mcap"))
    assert status == 0
    with (tmp_path / "smooth.mcap").open("rb") as file:
        paths = [message for *_, message in make_reader(file).iter_messages(topics=["/smoothed/path"])]
    assert len(paths) == 30


def test_the_report_shows_the_smoothed_path(tmp_path):
    (trace,) = run("steps=30", "filter.lag_seconds=0.5", "filter.planar_height=0")
    analysis = analyze([trace])[0]
    position = error_charts(analysis)[0]
    assert [one.name for one in position.references] == ["centralised filter", "posterior bound", "smoothed"]
    assert np.isfinite(position.references[2].values).all()
    write_report(analysis, tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    for said in ("smoothed position RMSE (m)", "smoothed NEES, average", "smoothed, mean of the agents"):
        assert said in text


def test_a_filter_without_covariance_cannot_be_smoothed(monkeypatch, capsys, tmp_path):
    log = made_log(tmp_path / "run.mcap", "steps=5")
    status, _, err = call(monkeypatch, capsys, "reestimate", str(log), "--smooth", "--set", "filter.kind=cbef")
    assert status == 2
    assert "--smooth needs a filter with a covariance, which 'cbef' has not; add --set filter.kind=sicf" in err
