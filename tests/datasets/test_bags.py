"""ROS 1 and ROS 2 bags become datasets, with the source's own times."""

from __future__ import annotations

import sqlite3
from contextlib import closing

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from tests.datasets.walked import CORNERS, EPOCH, STEPS, anchors_in, distance, imported, is_the_walk, place
from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.datasets.findings import findings
from zenoh_cbef.errors import UserError

RANGE, POINT, UWB, OWN = (
    "sensor_msgs/msg/Range",
    "geometry_msgs/msg/PointStamped",
    "px4_msgs/msg/SensorUwb",
    "mine/msg/Ranging",
)
KINDS = ("bag", "db3", "mcap")
MESSAGES = {
    UWB: """
uint64 timestamp
uint32 sessionid
uint32 time_offset
uint32 counter
uint16 mac
uint16 mac_dest
uint16 status
uint8 nlos
float32 distance
float32 aoa_azimuth_dev
""",
    OWN: "uint64 us\nuint8 who\nuint32 mm\n",
}
"""Definitions of types that no ROS has. The first is that of PX4 up to the field after the distance."""


def store_of(kind):
    store = get_typestore(Stores.ROS1_NOETIC if kind == "bag" else Stores.ROS2_HUMBLE)
    for name, text in MESSAGES.items():
        store.register(get_types_from_msg(text, name))
    return store


def write(path, kind, store, messages, *, version=9):
    """A bag as ROS writes it. messages: type, topic, time (ns) and fields; those that a type has besides are 0."""
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    serialized = store.serialize_ros1 if kind == "bag" else store.serialize_cdr
    with Writer1(path) if kind == "bag" else Writer(path, version=version, storage_plugin=plugin) as writer:
        topics = {}
        for name, topic, at, fields in messages:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, name, typestore=store)
            made = store.types[name](**(dict.fromkeys(store.types[name].__dataclass_fields__, 0) | fields))
            writer.write(topics[topic], at, serialized(made, name))
    return path


def header(store, at, frame):
    stamp = store.types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
    more = {"seq": 0} if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame, **more)


def ranges_and_truth(store):
    for k in range(STEPS):
        at = EPOCH * 10**9 + k * 10**8
        for name in CORNERS:
            yield RANGE, "/uwb", at + 5_000_000, {"header": header(store, at, name), "range": distance(k, name)}
        point = store.types["geometry_msgs/msg/Point"](*place(k))
        yield POINT, "/mocap", at, {"header": header(store, at, "map"), "point": point}


def numbered(tmp_path):
    """The anchors by numbers, 10 to 14."""
    rows = "".join(f"{number},{x},{y},{z}\n" for number, (x, y, z) in enumerate(CORNERS.values(), start=10))
    (tmp_path / "numbered.csv").write_text("id,x,y,z\n" + rows)
    return tmp_path / "numbered.csv"


def by_numbers(kind, fields):
    """Ranges of the numbered anchors. fields: of a number, a time (us) and a distance."""
    for k in range(STEPS):
        for number, name in enumerate(CORNERS, start=10):
            at = 1_000_000 + k * 100_000
            yield kind, "/ranging", 7 + at * 1000, fields(number, at, distance(k, name))


def of_px4(number, at, metres):
    return {"timestamp": at, "mac": 1, "mac_dest": number, "distance": metres}


def is_the_numbered_walk(folder):
    found = read_dataset(folder)
    assert found.labels == ("10", "11", "12", "13", "14")
    assert found.range_time.tolist() == pytest.approx([1.0 + 0.1 * k for k in range(STEPS) for _ in CORNERS], abs=1e-9)
    expected = [distance(k, name) for k in range(STEPS) for name in CORNERS]
    np.testing.assert_allclose(found.ranges, expected, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_ranges(tmp_path, kind):
    store = store_of(kind)
    path = write(tmp_path / ("walk.bag" if kind == "bag" else "walk"), kind, store, ranges_and_truth(store))
    stations = anchors_in(tmp_path)
    said = imported(path, "--anchors", stations, "-o", tmp_path / "set")
    assert "/mocap could be the truth: --truth /mocap" in said
    is_the_walk(read_dataset(tmp_path / "set"))
    imported(path, "--anchors", stations, "--truth", "/mocap", "-o", tmp_path / "set", "--force")
    known = read_dataset(tmp_path / "set")
    assert known.truth.tolist() == [list(place(k)) for k in range(STEPS)]
    assert not findings(known)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_px4(tmp_path, kind):
    path = tmp_path / ("flight.bag" if kind == "bag" else "flight")
    write(path, kind, store_of(kind), by_numbers(UWB, of_px4))
    imported(path, "--anchors", numbered(tmp_path), "-o", tmp_path / "set")
    is_the_numbered_walk(tmp_path / "set")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--topic", "/rangin"], "--topic /rangin: .*flight has no such topic; did you mean '/ranging'"),
        (["--truth", "/mocap"], "--truth /mocap: .*flight has no such topic; its topics are /ranging"),
        (["--map", "t=when"], "the messages have no field when"),
        (["--types", "nowhere.msg"], "cannot read --types nowhere.msg: No such file"),
        (["--types", __file__], "test_bags.py defines no message"),
    ],
)
def test_what_a_bag_lacks_is_told(tmp_path, words, said):
    write(tmp_path / "flight", "mcap", store_of("mcap"), by_numbers(UWB, of_px4))
    with pytest.raises(UserError, match=said):
        imported(tmp_path / "flight", "--anchors", numbered(tmp_path), "-o", tmp_path / "set", *words)


def test_a_truth_of_a_csv_file_beside_a_bag(tmp_path):
    write(tmp_path / "flight", "db3", store_of("db3"), by_numbers(UWB, of_px4))
    (tmp_path / "way.csv").write_text("t,x,y,z\n1,2,3,4\n2,3,4,5\n")
    words = ["--anchors", numbered(tmp_path), "-o", tmp_path / "set"]
    imported(tmp_path / "flight", *words, "--truth", tmp_path / "way.csv")
    assert read_dataset(tmp_path / "set").truth.tolist() == [[2.0, 3.0, 4.0], [3.0, 4.0, 5.0]]
    (tmp_path / "flight" / "metadata.yaml").unlink()
    with pytest.raises(UserError, match=r"no CSV file .* as .*flight/flight.db3"):
        imported(tmp_path / "flight", *words, "--force")


def test_a_file_that_is_no_bag_is_told(tmp_path):
    (tmp_path / "noise.bag").write_bytes(bytes(range(128, 256)))
    with pytest.raises(UserError, match=r"cannot read .*noise.bag as a ROS bag"):
        imported(tmp_path / "noise.bag", "--anchors", numbered(tmp_path), "-o", tmp_path / "set")


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_ones_own_type(tmp_path, kind):
    path = tmp_path / ("own.bag" if kind == "bag" else "own")
    own = by_numbers(OWN, lambda number, at, metres: {"us": at, "who": number, "mm": round(1000 * metres)})
    write(path, kind, store_of(kind), own)
    fields = ["t=us|us", "anchor=who", "range=mm|mm"]
    words = ["--topic", "/ranging", *(word for field in fields for word in ("--map", field))]
    imported(path, "--anchors", numbered(tmp_path), "-o", tmp_path / "set", *words)
    is_the_numbered_walk(tmp_path / "set")
    with pytest.raises(UserError, match=f"no range that is known; its messages are {OWN}"):
        imported(path, "--anchors", numbered(tmp_path), "-o", tmp_path / "other")
    with pytest.raises(UserError, match="the messages have no field metres; name one with --map"):
        imported(path, "--anchors", numbered(tmp_path), "-o", tmp_path / "other", *words, "--map", "range=metres")


def without_definitions(path):
    """A bag as ROS 2 up to Humble writes it."""
    with closing(sqlite3.connect(path / f"{path.name}.db3")) as database:
        database.execute("UPDATE schema SET schema_version = 3")
        database.execute("DROP TABLE message_definitions")
        database.commit()
    return path


@pytest.mark.slow
def test_a_bag_without_definitions_takes_them_from_files(tmp_path):
    path = write(tmp_path / "flight", "db3", store_of("db3"), by_numbers(UWB, of_px4), version=8)
    words = [without_definitions(path), "--anchors", numbered(tmp_path), "-o", tmp_path / "set"]
    with pytest.raises(UserError, match=r"not define px4_msgs/msg/SensorUwb; .* --types px4_msgs/msg/SensorUwb.msg"):
        imported(*words)
    (tmp_path / "SensorUwb.msg").write_text(MESSAGES[UWB])
    imported(*words, "--types", tmp_path / "SensorUwb.msg")
    is_the_numbered_walk(tmp_path / "set")


@pytest.mark.slow
def test_a_bag_without_definitions_needs_none_for_the_types_of_ros(tmp_path):
    store = store_of("db3")
    path = without_definitions(write(tmp_path / "walk", "db3", store, ranges_and_truth(store), version=8))
    imported(path, "--anchors", anchors_in(tmp_path), "--truth", "/mocap", "-o", tmp_path / "set")
    is_the_walk(read_dataset(tmp_path / "set"))
