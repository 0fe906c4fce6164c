"""Recordings in other formats become datasets, with the source's own times."""

from __future__ import annotations

import math

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from typer.testing import CliRunner

from zenoh_cbef.cli.importing import VERB
from zenoh_cbef.datasets import read_dataset, write_dataset
from zenoh_cbef.datasets.findings import findings
from zenoh_cbef.datasets.importing.columns import map_of
from zenoh_cbef.datasets.importing.units import units_of
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.viewers.recording import dataset_of

CORNERS = {
    "a": (0.0, 0.0, 2.0),
    "b": (20.0, 1.0, 2.0),
    "c": (19.0, 15.0, 2.0),
    "d": (1.0, 12.0, 2.0),
    "e": (9.0, 18.0, 2.0),
}
EPOCH = 1_700_000_000
STEPS = 200


def place(k):
    return (10.0 + 6.0 * math.cos(0.05 * k), 7.0 + 5.0 * math.sin(0.05 * k), 1.0)


def distance(k, anchor):
    return math.dist(place(k), CORNERS[anchor])


def imported(*arguments):
    """Call the verb; returns what it printed."""
    said = CliRunner().invoke(VERB, [*map(str, arguments)])
    if said.exception is not None and not isinstance(said.exception, SystemExit):
        raise said.exception
    return said.output


def anchors_in(folder, length=1.0, head="id,x,y,z"):
    rows = "".join(f"{name},{x / length},{y / length},{z / length}\n" for name, (x, y, z) in CORNERS.items())
    (folder / "stations.csv").write_text(f"{head}\n{rows}")
    return folder / "stations.csv"


def is_the_walk(dataset, begin=float(EPOCH)):
    assert dataset.labels == tuple(CORNERS)
    assert len(dataset.ranges) == STEPS * len(CORNERS)
    steps = np.round((dataset.range_time - begin) / 0.1).astype(int)
    np.testing.assert_allclose(dataset.range_time, begin + 0.1 * steps, atol=1e-6)
    expected = [distance(k, dataset.labels[each]) for k, each in zip(steps, dataset.range_anchor, strict=True)]
    np.testing.assert_allclose(dataset.ranges, expected, atol=1e-3)
    np.testing.assert_allclose(dataset.anchors, list(CORNERS.values()), atol=1e-9)


def long_rows(unit, separator, comma="."):
    for k in range(STEPS):
        for name in CORNERS:
            values = [str(EPOCH * 1000 + 100 * k), name, "good", f"{distance(k, name) / unit:.3f}".replace(".", comma)]
            yield separator.join(values)


@pytest.mark.parametrize(
    ("head", "unit", "marks", "options"),
    [
        ("stamp_ms;Station;quality;Dist [mm]", 0.001, (";", ","), ["--map", "anchor=station"]),
        ("stamp,anchor,quality,rng", 0.3048, (",", "."), ["--map", "range=rng", "--unit", "range=ft"]),
        ("timestamp\tid\tquality\trange", 1.0, ("\t", "."), ["--unit", "t=ms"]),
    ],
)
def test_csv_with_any_columns_units_and_separators(tmp_path, head, unit, marks, options):
    text = "\n".join(["# a comment", head, *long_rows(unit, *marks)])
    (tmp_path / "log.csv").write_text("\ufeff" + text, encoding="utf-8")
    stations = anchors_in(tmp_path, 0.3048, "name,x_ft,y_ft,z_ft")
    said = imported(tmp_path / "log.csv", "--anchors", stations, "-o", tmp_path / "set", *options)
    is_the_walk(read_dataset(tmp_path / "set"))
    assert "none: no errors are shown" in said
    assert (tmp_path / "set" / "first-fix.png").stat().st_size > 1000
    scenario = load(str(tmp_path / "set" / "scenario.toml")).scenario
    assert (scenario.dt, scenario.length) == (0.1, STEPS)
    assert scenario.target.origin == pytest.approx(EPOCH - 0.1)
    with pytest.raises(UserError, match="--force"):
        imported(tmp_path / "log.csv", "--anchors", stations, "-o", tmp_path / "set", *options)


def test_columns_of_a_file_without_a_header_are_known_by_their_place(tmp_path):
    rows = [(3152.0 + 0.25 * k, 2, k % 4, 10.0 + k) for k in range(40)]
    (tmp_path / "log.txt").write_text("".join("  ".join(f"{one:.9e}" for one in row) + "\n" for row in rows))
    (tmp_path / "nodes.csv").write_text("0,0,0,0\n1,60,0,0\n2,60,60,0\n3,0,60,0\n")
    columns = ["ranges.t=1", "ranges.anchor=3", "ranges.range=4", "anchors.anchor=1", "x=2", "y=3", "z=4"]
    options = [part for one in columns for part in ("--map", one)]
    imported(tmp_path / "log.txt", "--anchors", tmp_path / "nodes.csv", "-o", tmp_path / "set", *options)
    dataset = read_dataset(tmp_path / "set")
    assert dataset.labels == ("0", "1", "2", "3")
    np.testing.assert_allclose(dataset.ranges, [row[3] for row in rows], atol=1e-6)


def test_a_folder_with_a_column_for_each_anchor_and_a_truth(tmp_path):
    source = tmp_path / "monday"
    source.mkdir()
    anchors_in(source)
    wide = [",".join([str(EPOCH + 0.1 * k), *(f"{distance(k, each):.6f}" for each in CORNERS)]) for k in range(STEPS)]
    (source / "uwb.csv").write_text("\n".join(["t," + ",".join(f"d_{each}" for each in CORNERS), *wide]))
    known = [",".join(map(str, (EPOCH + 0.1 * k, *place(k)))) for k in range(50)]
    (source / "mocap.csv").write_text("\n".join(["time,pos_x,pos_y,pos_z", *known]))
    said = imported(source, "-o", tmp_path / "set", "--map", "range=d_*")
    is_the_walk(read_dataset(tmp_path / "set"))
    assert "the truth covers 4.9" in said
    assert "only those are scored" in said


def test_what_cannot_be_used_is_left_out_and_told(tmp_path):
    rows = [f"{0.1 * k},{name},{distance(k, name)}" for k in range(STEPS) for name in CORNERS]
    (tmp_path / "log.csv").write_text("\n".join(["t,anchor,range", *rows, "1,z,2", "2,a,nan", "3,b,-1"]))
    said = imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), "-o", tmp_path / "set")
    for told in ("1 range of anchor z, which has no position, left out", "1 row of log.csv", "1 negative range left"):
        assert told in said
    is_the_walk(read_dataset(tmp_path / "set"), 0.0)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--map", "rnage=d"], "is not MEANING=COLUMN"),
        (["--unit", "range=yd"], "is no unit"),
        (["--map", "ranges.range=nothing"], "has no such column"),
        ([], "which column is range"),
    ],
)
def test_mistakes_are_told_with_the_remedy(tmp_path, words, said):
    (tmp_path / "log.csv").write_text("t,anchor,quux\n0,a,1\n")
    with pytest.raises(UserError, match=said):
        imported(tmp_path / "log.csv", "--anchors", anchors_in(tmp_path), "-o", tmp_path / "set", *words)


def store_of(version):
    return get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)


def messages(store, version):
    """Type, topic, time (ns) and message: ranges, and the truth."""
    types = store.types
    for k in range(STEPS):
        at = EPOCH * 10**9 + k * 10**8
        stamp = types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
        more = {"seq": k} if version == 1 else {}
        for name in CORNERS:
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=name, **more)
            told = {"field_of_view": 0.1, "min_range": 0.0, "max_range": 99.0, "range": distance(k, name)}
            kind = "sensor_msgs/msg/Range"
            yield (
                kind,
                "/uwb",
                at + 5_000_000,
                types[kind](
                    header=header,
                    radiation_type=1,
                    **told,
                    **({} if "variance" not in types[kind].__dataclass_fields__ else {"variance": 0.0}),
                ),
            )
        point = types["geometry_msgs/msg/Point"](*place(k))
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="map", **more)
        kind = "geometry_msgs/msg/PointStamped"
        yield kind, "/mocap", at, types[kind](header=header, point=point)


@pytest.mark.parametrize("kind", ["bag", "db3", "mcap"])
def test_a_bag_of_ranges(tmp_path, kind):
    version = 1 if kind == "bag" else 2
    store, path = store_of(version), tmp_path / ("walk.bag" if kind == "bag" else "walk")
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer1(path) if version == 1 else Writer(path, version=9, storage_plugin=plugin) as writer:
        topics = {}
        for name, topic, at, message in messages(store, version):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, name, typestore=store)
            data = store.serialize_ros1(message, name) if version == 1 else store.serialize_cdr(message, name)
            writer.write(topics[topic], at, data)
    stations = anchors_in(tmp_path)
    said = imported(path, "--anchors", stations, "-o", tmp_path / "set")
    assert "/mocap could be the truth: --truth /mocap" in said
    is_the_walk(read_dataset(tmp_path / "set"))
    imported(path, "--anchors", stations, "--truth", "/mocap", "-o", tmp_path / "set", "--force")
    known = read_dataset(tmp_path / "set")
    assert known.truth.tolist() == [list(place(k)) for k in range(STEPS)]
    assert not findings(known)


def test_a_bag_of_ones_own_type(tmp_path):
    store = store_of(2)
    store.register(get_types_from_msg("uint64 us\nuint8 who\nuint32 mm\n", "mine/msg/Ranging"))
    names = dict(enumerate(CORNERS))
    with Writer(tmp_path / "own", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/ranging", "mine/msg/Ranging", typestore=store)
        for k in range(STEPS):
            for number, name in names.items():
                told = store.types["mine/msg/Ranging"](k * 100_000, number, round(1000 * distance(k, name)))
                writer.write(connection, k * 10**8, store.serialize_cdr(told, "mine/msg/Ranging"))
    rows = "".join(f"{number},{x},{y},{z}\n" for number, (x, y, z) in enumerate(CORNERS.values()))
    (tmp_path / "numbered.csv").write_text("id,x,y,z\n" + rows)
    fields = ["t=us|us", "anchor=who", "range=mm|mm"]
    words = ["--topic", "/ranging", *(word for field in fields for word in ("--map", field))]
    imported(tmp_path / "own", "--anchors", tmp_path / "numbered.csv", "-o", tmp_path / "set", *words)
    found = read_dataset(tmp_path / "set")
    np.testing.assert_allclose(found.ranges[:5], [distance(0, name) for name in CORNERS], atol=1e-3)
    assert found.range_time[-1] == pytest.approx(0.1 * (STEPS - 1))
    with pytest.raises(UserError, match="no range that is known; its messages are mine/msg/Ranging"):
        imported(tmp_path / "own", "--anchors", tmp_path / "numbered.csv", "-o", tmp_path / "other")


def walk(tmp_path, *, order="abcde", truth=True, lengths=1.0, seconds=1.0):
    """The walk as a dataset. order: whose ranges stand under each anchor's name; lengths, seconds: wrong units."""
    folder = tmp_path / "walk"
    folder.mkdir()
    (folder / "anchors.csv").write_text(anchors_in(tmp_path).read_text())
    named = dict(zip(CORNERS, order, strict=True))
    rows = [
        f"{0.1 * k * seconds},{name},{distance(k, named[name]) * lengths}" for k in range(STEPS) for name in CORNERS
    ]
    (folder / "ranges.csv").write_text("\n".join(["t,anchor_id,range", *rows]))
    if truth:
        known = [",".join(map(str, (0.1 * k * seconds, *place(k)))) for k in range(STEPS)]
        (folder / "truth.csv").write_text("\n".join(["t,x,y,z", *known]))
    return read_dataset(folder)


@pytest.mark.parametrize("truth", [True, False])
def test_swapped_anchors_are_found_with_and_without_a_truth(tmp_path, truth):
    [said] = findings(walk(tmp_path, order="acbde", truth=truth))
    assert said.startswith("anchor b and c look swapped")


@pytest.mark.parametrize("truth", [True, False])
def test_nothing_is_odd_about_a_good_recording(tmp_path, truth):
    assert findings(walk(tmp_path, truth=truth)) == []


def test_times_in_milliseconds_are_told(tmp_path):
    assert "milliseconds; import them with --unit t=ms" in findings(walk(tmp_path, seconds=1000.0))[0]


def test_a_run_becomes_a_dataset_that_gives_the_same_ranges(tmp_path):
    [trace] = simulate([load("tracking", ["steps=40"]).scenario])
    write_dataset(dataset_of(trace), tmp_path / "set")
    [again] = simulate([load("tracking", ["target.motion=dataset", f'target.path="{tmp_path / "set"}"']).scenario])
    np.testing.assert_allclose(again.ranges, trace.ranges, atol=1e-6)
    np.testing.assert_allclose(again.truth[1:-1, :3], trace.truth[1:-1, :3], atol=1e-6)
    moving = load("tracking", ["agents.motion=formation", "agents.velocity=[1,0,0]", "steps=5"]).scenario
    with pytest.raises(UserError, match="agents of this run move"):
        dataset_of(simulate([moving])[0])


def test_maps_and_units_are_read_from_words():
    assert map_of(["range=d_*", "truth.t=Stamp"]) == {"range": "d_*", "truth.t": "Stamp"}
    units = units_of(["mm", "anchors=ft", "t=us"])
    assert [str(units.length(file, "x", "x")) for file in ("anchors", "truth")] == ["0.3048", "0.001"]
