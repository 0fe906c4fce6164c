"""The measurements of a log through the same filter give the same messages; through another one, a log to compare.

test_every_fault.py estimates again what runs with every kind of fault have recorded.
"""

import json
import shutil
from collections.abc import Iterator

import msgpack
import numpy as np
import pytest

from tests.processes.again import again, said
from tests.processes.conftest import World
from tests.processes.recorder.test_log import copy_with, without_beacons
from tests.processes.target.test_datasets import small_set, track
from zenoh_cbef.log.read.trace import read_trace


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Iterator[World]:
    world = World(tmp_path_factory.mktemp("recorded"))
    world.complete("sensor.dropout_probability=0.1", 'fault=[{kind="loss", probability=0.2}]')
    yield world
    world.end()


@pytest.fixture(scope="module")
def tracked(tmp_path_factory) -> Iterator[World]:
    """The run of a data set in a plane whose folder is gone."""
    world = World(tmp_path_factory.mktemp("tracked"))
    folder = small_set(world.folder / "set")
    track(world, folder, ("0.1", "0.05", "1.0"), steps=40)
    shutil.rmtree(folder)
    yield world
    world.end()


def test_recorded_data_in_a_plane_give_the_same_messages_and_need_no_folder(tracked):
    assert said(again(tracked, tracked.log)) == said(tracked.log)
    free = again(tracked, tracked.log, "filter.kind=ci", "filter.initial_position=[5.0, 5.0, 1.0]")
    assert not np.array_equal(read_trace(free).estimates, read_trace(tracked.log).estimates)


def test_another_filter_is_set_beside_the_original(recorded):
    other = again(recorded, recorded.log, "filter.kind=local")
    done = recorded.call("compare", str(recorded.log), str(other), "--json")
    # The same truth, measurements, places and first estimates; alone an agent is sure of a wrong place.
    assert "another" not in done.stderr
    assert done.stderr.startswith("note: again: agents are too sure of themselves")
    assert done.stderr.count("\n") == 1
    first, second = json.loads(done.stdout)
    assert [first["filter"], second["filter"]] == ["sicf", "local"]
    assert first["position_rmse"] < second["position_rmse"]
    analysed = recorded.metrics(other)
    assert analysed["complete"] is True
    assert analysed["messages"]["missing"] == 0
    assert recorded.call("export", str(other), "--output", str(recorded.folder / "x.npz")).returncode == 0


def test_a_cut_log_is_estimated_as_far_as_it_goes(recorded, tmp_path):
    cut = tmp_path / "cut.mcap"
    copy_with(recorded.log, cut, until_step_20)
    trace = read_trace(again(recorded, cut))
    assert len(trace.time) == 20
    assert np.array_equal(trace.estimates, read_trace(recorded.log).estimates[:, :20])


def until_step_20(_topic: str, data: bytes) -> bytes | None:
    return data if msgpack.unpackb(data).get("k", 0) <= 20 else None


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed=5", "seed says how the log's ranges came about"),
        ("sensor.range_std=0.3", "filter.range_std in place of sensor.range_std"),
        ("steps=41", "beacons of 40 steps"),
        ('fault=[{kind="sensor-bias", bias=1.0}]', "faults of sensors"),
        ("filter.kind=kalman", "filter.kind"),
    ],
)
def test_what_was_measured_cannot_be_changed_afterwards(recorded, override, words):
    before = sorted(recorded.folder.rglob("*"))
    done = recorded.call("reestimate", str(recorded.log), "--set", override)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert sorted(recorded.folder.rglob("*")) == before


def test_a_log_without_beacons_is_refused(recorded, tmp_path):
    done = recorded.call("reestimate", str(without_beacons(recorded.log, tmp_path)))
    assert done.returncode == 2
    assert "holds no beacons" in done.stderr


def test_a_filter_that_diverges_stays_finite(recorded):
    """The paper's gain, of agents tens of metres apart, multiplies the error in every step."""
    trace = read_trace(again(recorded, recorded.log, "filter.kind=cbef", "filter.xi=1e6"))
    assert np.abs(trace.estimates).max() > 1e6
    assert np.isfinite(trace.estimates).all()


def test_a_filter_that_is_refused_leaves_nothing_behind(recorded):
    before = sorted(recorded.folder.rglob("*"))
    far = "filter.initial_position=[1e170, 0.0, 0.0]"
    done = recorded.call("reestimate", str(recorded.log), "--set", far)
    assert done.returncode == 2
    assert "filter.initial_position[0]" in done.stderr
    assert {*recorded.folder.rglob("*")} - {*before} <= {recorded.folder / "logs"}


def test_new_agents_on_recorded_beacons_send_what_is_computed_from_them(recorded, tmp_path):
    overrides = ("filter.kind=ci", "consensus.rounds=2", 'fault=[{kind="loss", probability=0.4}]')
    computed = again(recorded, recorded.log, *overrides)
    ran = tmp_path / "ran.mcap"
    options = [part for one in overrides for part in ("--set", one)]
    done = recorded.call("replay", str(recorded.log), "--to", "agents", *options, "--output", str(ran))
    assert done.returncode == 0, done.stderr
    assert said(ran) == said(computed)


def test_new_agents_run_on_recorded_data_without_their_folder(tracked, tmp_path):
    ran = tmp_path / "ran.mcap"
    done = tracked.call("replay", str(tracked.log), "--to", "agents", "--output", str(ran))
    assert done.returncode == 0, done.stderr
    assert said(ran) == said(tracked.log)


def test_a_realtime_run_is_estimated_as_in_lockstep(world):
    realtime = ("timing.mode=realtime", "dt=0.05", "steps=15", "sensor.dropout_probability=0.2")
    world.complete(*realtime)
    assert world.call("verify", str(world.log)).returncode == 2, "the log does not say what came when"
    first, second = read_trace(world.log), read_trace(again(world, world.log))
    assert np.array_equal(first.ranges, second.ranges, equal_nan=True)
    assert np.array_equal(first.truth, second.truth)
    assert np.isfinite(second.estimates).all()
