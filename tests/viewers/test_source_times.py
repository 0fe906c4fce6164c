"""The times at which a recording's ranges were measured are in every export of a run of it."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections import defaultdict
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from typer.testing import CliRunner

import zenoh_cbef as zc
from tests.datasets.made import write
from tests.log.made import made_log
from zenoh_cbef.cli.export import VERB, Format
from zenoh_cbef.datasets import read_dataset

STEPS, DT = 20, 0.1
ANCHORS = "id,x,y,z\nhall,0,0,1\ndoor,4,0,1\nroof,1,5,3\n"


@pytest.fixture(scope="module", params=[0.0, 1_700_000_000.25], ids=["from-0", "since-1970"])
def log(request, tmp_path_factory):
    """The log of a run of ranges that come at times of their own, on the source's clock."""
    folder = tmp_path_factory.mktemp("recorded")
    begin, random = request.param, np.random.default_rng(1)
    late = np.sort(random.uniform(0.0, 0.9 * DT, (STEPS, 3)), axis=1)
    late[0, 0] = 0.0
    rows = [
        f"{float(begin + DT * step + late[step, number])!r},{name},{2.0 + 0.01 * step}\n"
        for step in range(STEPS)
        for number, name in enumerate(("hall", "door", "roof"))
    ]
    write(folder / "set", anchors=ANCHORS, ranges="t,anchor_id,range\n" + "".join(rows), truth=None)
    sets = ("target.motion=dataset", f'target.path="{folder / "set"}"', "network.graph=complete", f"dt={DT}")
    return made_log(folder / "run.mcap", *sets)


@pytest.fixture(scope="module")
def source(log):
    """When each anchor measured, s, of the recording itself, until the last step ends."""
    recorded = read_dataset(log.parent / "set")
    within = recorded.range_time <= recorded.range_time[0] + DT * (STEPS - 1)
    return [recorded.range_time[within & (recorded.range_anchor == anchor)] for anchor in range(3)]


def ends(source):
    """When the steps end."""
    return source[0][0] + DT * np.arange(STEPS)


def are(found, expected):
    """Times by agent, s, without those where nothing was measured."""
    for one, other in zip(found, expected, strict=True):
        known = np.asarray(one, dtype=np.float64)
        np.testing.assert_allclose(known[np.isfinite(known)], other, rtol=0.0, atol=1e-6)


def of_npz(path):
    return np.load(path)["range_time"]


def of_csv(path):
    found = defaultdict(list)
    with (path / "agents.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            found[row["agent"]].append(float(row["range_time"]))
    return [found[str(agent)] for agent in range(3)]


def of_parquet(path):
    read = pytest.importorskip("pyarrow.parquet").read_table
    return np.reshape(read(path / "agents.parquet")["range_time"].to_numpy(), (3, -1))


def of_dataset(path):
    again = read_dataset(path)
    return [again.range_time[again.range_anchor == anchor] for anchor in range(3)]


def of_ros2(path):
    found = defaultdict(list)
    with AnyReader([path]) as bag:
        for connection, _, data in bag.messages():
            if connection.topic.endswith("/range"):
                message: Any = bag.deserialize(data, connection.msgtype)
                found[connection.topic].append(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
    return [found[f"/agent_{agent}/range"] for agent in range(3)]


def of_viz(path):
    """The time of a message is that of its step; `range_age` tells how long before it the range was measured."""
    decoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    make_reader = pytest.importorskip("mcap.reader").make_reader
    found = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message, decoded in make_reader(stream, decoder_factories=[decoder]).iter_decoded_messages():
            if channel.topic.startswith("/agent/"):
                found[channel.topic].append(1e-9 * message.log_time - decoded.range_age)
    return [found[f"/agent/{agent}/metrics"] for agent in range(3)]


def of_tum(path):
    """Estimates alone are in it, at the ends of their steps."""
    return [np.loadtxt(path / f"agent_{agent}.tum")[:, 0] for agent in range(3)]


def of_rrd(path):
    """As `rerun rrd print` shows a curve: on the timeline `source`, when the step ended, and `range_age`."""
    command = [sys.executable, "-m", "rerun", "rrd", "print", "-vvv", str(path)]
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found = []
    for agent in range(3):
        chunk = printed.split(f"entity_path: /agents/{agent}/range_age", 1)[1].split("entity_path", 1)[0]
        rows = re.findall(r"(\d{4}-\d\d-\d\dT[\d:.]+) *┆[^┆]*┆ *\[([-\d.e]+)\]", chunk)
        ages = [float(age) for _, age in rows]
        found.append(1e-9 * np.array([stamp for stamp, _ in rows], dtype="datetime64[ns]").astype(np.int64) - ages)
    return found


READ = {
    Format.npz: of_npz,
    Format.csv: of_csv,
    Format.parquet: of_parquet,
    Format.dataset: of_dataset,
    Format.ros2: of_ros2,
    Format.viz: of_viz,
    Format.tum: of_tum,
    Format.rrd: of_rrd,
}


@pytest.mark.parametrize("kind", Format)
def test_every_export_has_the_times_of_the_source(log, source, tmp_path, kind):
    if kind is Format.rrd:
        pytest.importorskip("rerun", reason="the extra rerun is large")
    path = tmp_path / f"out{kind.suffix if kind in (Format.viz, Format.npz, Format.rrd) else ''}"
    said = CliRunner().invoke(VERB, [str(log), "--to", kind.value, "-o", str(path)])
    assert said.exit_code == 0, said.output
    are(READ[kind](path), [ends(source)] * 3 if kind is Format.tum else source)


def test_arrays_of_python_have_the_times_of_the_source(log, source):
    run = zc.load(log)
    frame = run.to_pandas("agents")
    columns = [frame[frame.agent == agent] for agent in range(3)]
    for found in (run.range_time, run.arrays["range_time"], run.to_xarray()["range_time"].values):
        are(found, source)
    are([one["range_time"].to_numpy() for one in columns], source)
    steps = run.source_time, run.to_xarray()["source_time"].values, columns[0]["source_time"].to_numpy()
    are(steps, [ends(source)] * 3)
