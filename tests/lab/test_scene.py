"""What the page is given of a step is what the log says of it."""

import json
import time

import numpy as np
import pytest

from tests.log.made import made_log
from tests.waiting import until
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.lab.answers import Page
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.judged import judged
from zenoh_cbef.lab.scene import CURVES, Scene
from zenoh_cbef.lab.sources import LogSource, Source
from zenoh_cbef.lab.under_way import under_way
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.pages.packing import framed
from zenoh_cbef.plain import read_toml
from zenoh_cbef.protocol.slow import SLOW
from zenoh_cbef.scenario.load import parse
from zenoh_cbef.tracking.status import ACQUIRING, FAINT

FAULTS = (
    'fault=[{kind="loss", probability=0.3, from=1.0, until=2.0}, {kind="outage", agents=[3], from=2.5, until=3.0},'
    '{kind="crash", agents=[1], from=3.2, until=3.6}]'
)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    keys = ("seed=6", "steps=40", "agents.count=4", "network.graph=complete", "filter.status=true")
    return made_log(tmp_path_factory.mktemp("lab") / "run.mcap", *keys, FAULTS)


def whole(source: Source) -> Scene:
    """The scene of a log that is read to its end, however busy the machine is."""
    source.shown.set()
    until(lambda: source.state == "log")
    return source.scene


@pytest.fixture(scope="module")
def scene(log) -> Scene:
    return whole(LogSource(log))


@pytest.fixture(scope="module")
def trace(log):
    return read_trace(log)


def test_what_is_shown_of_a_step_between_rounds_is_what_agents_tell_of_it_afterwards(scene):
    rounds, told = scene.plan.rounds, 0
    for step in range(5, 40):
        whole, marks = under_way(scene, step, rounds)
        later, afterwards = scene.frame(step), scene.marks(step)
        for row, each in enumerate(afterwards):
            if each:
                told += 1
                assert marks[row] == each, (step, row)
                np.testing.assert_array_equal(whole["links"][row, :3], later["links"][row, :3])
        np.testing.assert_array_equal(whole["truth"], later["truth"])
        np.testing.assert_array_equal(whole["estimate"], scene.frame(step - 1)["estimate"])
        assert [one[:-1] for one in marks] == under_way(scene, step, rounds - 1)[1]
    assert told > 100


def test_a_frame_holds_the_numbers_of_its_step(scene, trace):
    assert scene.newest == 40
    for step in (1, 15, 40):
        frame, row = scene.frame(step), step - 1
        np.testing.assert_array_equal(frame["truth"], trace.truth[row])
        np.testing.assert_array_equal(frame["estimate"], trace.estimates[:, row])
        np.testing.assert_array_equal(frame["place"], trace.positions[:, row])
        upper = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
        for place, (i, j) in enumerate(upper):
            np.testing.assert_array_equal(frame["spread"][:, place], trace.covariances[:, row, i, j])
        np.testing.assert_array_equal(frame["said"][:, 2], trace.diagnostics.nis[:, row])
    gone = scene.frame(34)
    assert np.isnan(gone["estimate"][1]).all()
    assert np.isfinite(gone["estimate"][[0, 2, 3]]).all()


def test_marks_say_what_became_of_each_message_of_a_step(scene):
    links = scene.frame(15)["links"]
    marks = scene.marks(15)
    assert [mark.count("x") for mark in marks] == links[:, 1].astype(int).tolist()
    assert {len(mark) for mark in marks} == {10}
    assert not any(scene.marks(5))


def test_messages_of_single_steps_add_up_to_those_of_the_run(scene, trace):
    fresh = np.nansum([scene.frame(step)["links"] for step in range(1, 41)], axis=0)
    order = np.lexsort((trace.links.source, trace.links.destination))
    assert scene.links.tolist() == np.stack([trace.links.source, trace.links.destination], axis=1)[order].tolist()
    np.testing.assert_array_equal(fresh[:, 0], trace.links.delivered[order])
    np.testing.assert_array_equal(fresh[:, 1], trace.links.lost[order])
    quiet, lossy, cut = scene.frame(5)["links"], scene.frame(15)["links"], scene.frame(27)["links"]
    assert not quiet[:, 1].any()
    assert lossy[:, 1].sum() > 0.15 * lossy[:, :2].sum()
    touched = (scene.links == 3).any(axis=1)
    assert not cut[touched, 0].any()
    assert not cut[~touched, 1].any()


def test_curves_are_those_of_the_analysis_whole_or_in_pieces(scene, trace):
    [analysis] = analyze([trace])
    whole = scene.curves(0, 40)
    assert tuple(whole) == CURVES
    expected = np.sqrt(np.nanmean(analysis.position_error**2, axis=0))
    np.testing.assert_allclose(whole["error"], expected, rtol=1e-12)
    np.testing.assert_allclose(whole["disagreement"], analysis.disagreement, rtol=1e-9, atol=1e-15)
    pieces = [scene.curves(first, last) for first, last in ((0, 1), (1, 13), (13, 34), (34, 40))]
    for name, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([one[name] for one in pieces]), values)


def test_a_trail_ends_where_the_step_is(scene, trace):
    trail = scene.trail(20, 12, 5)
    assert trail["steps"][-1] == 20
    assert trail["steps"][0] == 9
    rows = trail["steps"].astype(int) - 1
    np.testing.assert_array_equal(trail["truth"], trace.truth[rows, :3])
    np.testing.assert_array_equal(trail["estimates"][:, :, :3], np.moveaxis(trace.estimates[:, rows, :3], 0, 1))
    drawn = np.where(trace.diagnostics.status.T[rows] == ACQUIRING, FAINT, 1.0)
    np.testing.assert_array_equal(trail["estimates"][:, :, 3], drawn)
    assert np.isfinite(scene.trail(39, 3, 3)["estimates"]).any()
    assert len(scene.trail(1, 12, 5)["steps"]) == 1


def test_the_verdict_names_what_is_wrong(scene):
    assert judged(scene, 0).level == "none"
    assert "acquiring" in judged(scene, 3).words
    assert "the network is in 2 parts" in judged(scene, 29).words
    assert judged(scene, 29).level == "bad"
    assert "away: agent 1" in judged(scene, 34).words
    assert judged(scene, 40).words.startswith("tracking: 3 of 4 agents, error 0.")
    assert judged(scene, 40).level == "good"


def test_the_verdict_is_about_honest_agents(tmp_path):
    liar = 'fault=[{kind="byzantine", agents=[3], mode="drift", magnitude=3.0}]'
    scene = whole(LogSource(made_log(tmp_path / "run.mcap", "steps=40", "agents.count=4", liar)))
    [analysis] = analyze([read_trace(tmp_path / "run.mcap")])
    honest = np.sqrt(np.nanmean(analysis.position_error[:3] ** 2, axis=0))
    np.testing.assert_allclose(scene.curves(0, 40)["error"], honest, rtol=1e-12)
    assert "of 3 agents" in judged(scene, 3).words
    assert "left out: agent 3, as of wrong values" in judged(scene, 40).words


def test_errors_beyond_what_is_claimed_are_called_overconfident(log):
    scene = whole(LogSource(log))
    scene.recording.truth.numbers("state", 40)[:, :, :3] += 30.0
    assert "overconfident: errors are" in judged(scene, 31).words


def test_a_host_that_is_too_slow_is_said_from_the_step_on_in_which_an_agent_told_so(log):
    scene = whole(LogSource(log))
    events, at = scene.recording.events, int(scene.recording.estimates.stamps(20).sent[:, 19].max())
    events.append(events[-1]._replace(sent=at, message={**events[-1].message, "kind": SLOW, "from": "agent/2"}))
    assert "too slow" not in judged(scene, 19).words
    assert judged(scene, 20).words.startswith("agent 2 does not keep up: this host is too slow for dt; raise dt")
    assert "too slow" in judged(scene, 40).words


def read(data: bytes) -> tuple[dict, dict]:
    size = int.from_bytes(data[:4], "little")
    told, at, arrays = json.loads(data[4 : 4 + size]), 4 + size, {}
    assert at % 4 == 0
    for name, shape in told["arrays"]:
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, "<f4", count, at).reshape(shape)
        at += 4 * count
    assert at == len(data)
    return told, arrays


@pytest.fixture
def bench(log):
    bench = Bench({"tracking": "as it is"})
    bench.open_log(str(log))
    assert bench.source is not None
    whole(bench.source)
    return bench


def test_a_page_gets_what_it_asks_for(bench, trace):
    page = Page(bench)
    scene, _ = read(page.answer({"ask": "scene"}))
    assert (scene["agents"], scene["newest"], scene["state"], scene["live"]) == (4, 40, "log", False)
    told, arrays = read(page.answer({"ask": "frame", "step": 20, "curves": 30, "events": 0, "trail": 10}))
    assert (told["step"], told["curves"], told["number"]) == (20, [30, 40], 1)
    np.testing.assert_array_equal(arrays["estimate"], trace.estimates[:, 19].astype(np.float32))
    assert arrays["curve error"].shape == (10,)
    assert arrays["trail estimates"].shape[1:] == (4, 4)
    assert [one["words"] for one in told["faults"]] == ["loss 30 %", "outage of agent 3", "crash of agent 1"]
    assert "trail truth" not in read(page.answer({"ask": "frame", "step": 1}))[1]


@pytest.mark.parametrize(
    ("asked", "sentence"),
    [
        ({"ask": "fault", "table": {"kind": "loss"}}, "this is a log"),
        ({"ask": "fault", "table": 3}, "no table"),
        ({"ask": "undo"}, "nothing to undo"),
        ({"ask": "clear", "number": True}, "lacks number"),
        ({"ask": "stop"}, "its run has ended"),
        ({"ask": "open", "log": "no/such"}, "there is no log"),
        ({"ask": "join", "run": "nosuch"}, "no run 'nosuch' goes on"),
        ({"ask": ["x"]}, "does not know"),
        ({}, "does not know"),
    ],
)
def test_what_cannot_be_is_answered_with_a_sentence(bench, asked, sentence):
    told, _ = read(Page(bench).answer(asked))
    assert sentence in told["error"]


@pytest.mark.parametrize("step", [-5, 0, 10**9, "x", None, 2.5, True])
def test_any_step_gives_a_frame_of_the_log(bench, step):
    asked = {"ask": "frame", **dict.fromkeys(("step", "curves", "events", "trail"), step)}
    told, arrays = read(Page(bench).answer(asked))
    assert 1 <= told["step"] <= 40
    assert arrays["estimate"].shape == (4, 6)


def test_before_anything_is_open_the_page_is_told_to_choose():
    page = Page(Bench({}))
    assert "choose a scenario" in read(page.answer({"ask": "scene"}))[0]["error"]
    assert read(page.answer({"ask": "what"}))[0]["scenarios"] == {}


def test_the_session_is_a_scenario_that_repeats_it(bench, log):
    again = parse(read_toml(bench.scenario_text()), "the session")
    assert [one.kind for one in again.fault] == ["loss", "outage", "crash"]
    assert again.changed(fault=()) == read_trace(log).scenario.changed(fault=())


def test_a_frame_begins_its_numbers_at_a_multiple_of_four():
    for words in ("", "a", "ab", "abc"):
        read(framed({"words": words}, {"one": np.arange(3.0)}))


def test_stretches_of_steps_hold_the_messages_of_the_run(trace):
    until, counts = trace.passing.until, trace.passing.counts
    assert until[-1] == 40
    for place, of in enumerate((trace.links.delivered, trace.links.lost, trace.links.late)):
        np.testing.assert_array_equal(np.nansum(counts[:, :, place], axis=1), of)
    cut = (trace.links.source == 3) | (trace.links.destination == 3)
    assert not counts[cut][:, (until > 25) & (until < 30), 0].any()


def test_a_log_beside_is_shown_at_the_same_time(bench, tmp_path):
    slow = made_log(tmp_path / "slow.mcap", "steps=15", "dt=0.2", "agents.count=3")
    bench.put_beside(str(slow))
    assert bench.beside is not None
    whole(bench.beside)
    page = Page(bench)
    scene, _ = read(page.answer({"ask": "scene"}))
    assert (scene["beside"]["agents"], scene["beside"]["newest"]) == (3, 15)
    told, arrays = read(page.answer({"ask": "frame", "step": 20, "curves": 40, "beside": 5}))
    assert (told["beside"]["step"], told["beside"]["curves"]) == (10, [5, 15])
    other = whole(LogSource(slow))
    np.testing.assert_array_equal(arrays["beside estimate"], other.frame(10)["estimate"].astype(np.float32))
    np.testing.assert_array_equal(arrays["beside curve error"], other.curves(5, 15)["error"].astype(np.float32))
    assert arrays["curve error"].shape == (0,)


@pytest.mark.slow
def test_a_long_log_is_shown_while_the_rest_of_it_is_read(tmp_path):
    long = made_log(tmp_path / "long.mcap", "steps=100", "agents.count=3", "record.chunk_bytes=1024")
    source = LogSource(long, at_once=0.0)
    source.shown.set()
    until = time.monotonic() + 120.0
    while source.state != "log":
        assert source.state == "is read"
        assert time.monotonic() < until
        with source.lock:
            assert source.scene.newest >= 1
        time.sleep(0.01)
    np.testing.assert_array_equal(source.scene.frame(100)["truth"], read_trace(long).truth[99])
