"""The bag of ROS 2, as a reader that is not the writer's decodes it, and the trajectories for evo."""

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.log.made import START, made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.viewers.ros2 import write_ros2
from zenoh_cbef.viewers.scene import read_scene
from zenoh_cbef.viewers.tum import write_tum

STEPS, AGENTS = 40, 4
OUTAGE = 'fault=[{kind="outage", agents=[3], from=2.0, until=3.0}]'
SILENT = "sensor.dropout_probability=0.3"
TIMES = [START + 100_000_000 * step for step in range(1, STEPS + 1)]

reader = pytest.importorskip("mcap_ros2.reader", reason="mcap-ros2-support reads what rosbags writes")


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    overrides = f"steps={STEPS}", f"agents.count={AGENTS}", "network.graph=complete", OUTAGE, SILENT
    return read_scene(made_log(tmp_path_factory.mktemp("made") / "run.mcap", *overrides))


@pytest.fixture(scope="module")
def bag(scene, tmp_path_factory) -> Path:
    (folder,) = write_ros2(scene, tmp_path_factory.mktemp("ros") / "bag")
    return folder


@pytest.fixture(scope="module")
def shown(bag) -> dict[str, dict[int, object]]:
    """Messages by topic and time."""
    found: dict[str, dict[int, object]] = defaultdict(dict)
    for one in reader.read_ros2_messages(bag / "bag.mcap"):
        assert one.channel.message_encoding == "cdr"
        found[one.channel.topic][one.log_time_ns] = one.ros_msg
    return dict(found)


def numbers(message, names: str = "xyz") -> list[float]:
    return [getattr(message, name) for name in names]


def stamp_of(header) -> int:
    return header.stamp.sec * 10**9 + header.stamp.nanosec


def test_the_bag_has_its_topics_and_its_metadata_count_them(bag, shown):
    told = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert told["storage_identifier"] == "mcap"
    counted = {
        one["topic_metadata"]["name"]: (one["topic_metadata"]["type"], one["message_count"])
        for one in told["topics_with_message_count"]
    }
    kinds = {"odometry": "nav_msgs/msg/Odometry", "pose": "geometry_msgs/msg/PoseWithCovarianceStamped"}
    expected = {
        "/tf": "tf2_msgs/msg/TFMessage",
        "/target/odometry": "nav_msgs/msg/Odometry",
        "/markers": "visualization_msgs/msg/MarkerArray",
        **{f"/agent_{agent}/{name}": kind for agent in range(AGENTS) for name, kind in kinds.items()},
        **{f"/agent_{agent}/range": "sensor_msgs/msg/Range" for agent in range(AGENTS)},
    }
    assert counted == {topic: (kind, len(shown[topic])) for topic, kind in expected.items()}
    assert list(shown["/tf"]) == TIMES


def test_odometry_and_poses_are_the_states_and_covariances_of_the_log(scene, shown):
    trace = scene.trace
    for agent in range(AGENTS):
        for row, time in enumerate(TIMES):
            state, covariance = trace.estimates[agent, row], trace.covariances[agent, row]
            odometry, pose = shown[f"/agent_{agent}/odometry"][time], shown[f"/agent_{agent}/pose"][time]
            assert (stamp_of(odometry.header), odometry.header.frame_id) == (time, "world")
            assert odometry.child_frame_id == f"agent_{agent}_estimate"
            assert numbers(odometry.pose.pose.position) == numbers(pose.pose.pose.position) == state[:3].tolist()
            assert numbers(odometry.pose.pose.orientation, "xyzw") == [0.0, 0.0, 0.0, 1.0]
            assert numbers(odometry.twist.twist.linear) == state[3:].tolist()
            for told, part in ((odometry.pose, slice(3)), (pose.pose, slice(3)), (odometry.twist, slice(3, 6))):
                full = np.reshape(told.covariance, (6, 6))
                assert full[:3, :3].tolist() == covariance[part, part].tolist()
                assert not full[:3, 3:].any()
    truth = [shown["/target/odometry"][time] for time in TIMES]
    assert [[*numbers(one.pose.pose.position), *numbers(one.twist.twist.linear)] for one in truth] == (
        trace.truth.tolist()
    )


def test_ranges_are_there_where_the_agent_heard_one(scene, shown):
    trace = scene.trace
    assert np.isnan(trace.ranges).any()
    for agent in range(AGENTS):
        found = shown[f"/agent_{agent}/range"]
        heard = np.isfinite(trace.ranges[agent])
        assert list(found) == [time for time, there in zip(TIMES, heard, strict=True) if there]
        assert [one.range for one in found.values()] == trace.ranges[agent, heard].astype(np.float32).tolist()
        first = next(iter(found.values()))
        assert first.header.frame_id == f"agent_{agent}"
        assert (first.min_range, first.max_range) == (0.0, np.inf)
        assert first.variance == np.float32(trace.plan.range_std**2)


def test_frames_and_markers_are_where_the_log_says(scene, shown):
    trace = scene.trace
    for row, time in enumerate(TIMES):
        frames = {one.child_frame_id: one for one in shown["/tf"][time].transforms}
        assert {one.header.frame_id for one in frames.values()} == {"world"}
        places = {"target": trace.truth[row, :3]}
        places |= {f"agent_{agent}": trace.positions[agent, row] for agent in range(AGENTS)}
        places |= {f"agent_{agent}_estimate": trace.estimates[agent, row, :3] for agent in range(AGENTS)}
        assert {name: numbers(one.transform.translation) for name, one in frames.items()} == {
            name: place.tolist() for name, place in places.items()
        }
        markers = {(one.ns, one.id): one for one in shown["/markers"][time].markers}
        assert numbers(markers["target", 0].pose.position) == trace.truth[row, :3].tolist()
        for agent in range(AGENTS):
            assert numbers(markers["agents", agent].pose.position) == trace.positions[agent, row].tolist()
            assert markers["numbers", agent].text == str(agent)
            ellipsoid = markers["uncertainty", agent]
            assert numbers(ellipsoid.scale) == (2.0 * scene.ellipsoids.axes[agent, row]).tolist()
            turn = scene.ellipsoids.orientation[agent, row].tolist()
            assert numbers(ellipsoid.pose.orientation, "xyzw") == turn
        links = markers["links", 0]
        assert len(links.points) == len(links.colors) == 2 * len(scene.links)


def test_an_agent_without_a_covariance_has_zeros_and_no_ellipsoid(tmp_path):
    scene = read_scene(made_log(tmp_path / "run.mcap", "steps=3", "filter.kind=cbef"))
    (folder,) = write_ros2(scene, tmp_path / "bag")
    for one in reader.read_ros2_messages(folder / "bag.mcap"):
        if one.channel.topic == "/agent_0/odometry":
            assert not np.any(one.ros_msg.pose.covariance)
        if one.channel.topic == "/markers":
            assert {marker.action for marker in one.ros_msg.markers if marker.ns == "uncertainty"} == {2}


def test_a_bag_is_written_over_and_nothing_else_is(scene, bag, tmp_path):
    before = (bag / "bag.mcap").stat().st_size
    write_ros2(scene, bag)
    assert (bag / "bag.mcap").stat().st_size == before
    (tmp_path / "mine").mkdir()
    kept = tmp_path / "mine" / "run.mcap"
    kept.write_bytes(b"a log")
    with pytest.raises(UserError, match="is no bag"):
        write_ros2(scene, tmp_path / "mine")
    assert kept.read_bytes() == b"a log"


def test_trajectories_for_evo_are_the_truth_and_the_estimates(scene, tmp_path):
    paths = {path.name: path for path in write_tum(scene, tmp_path / "tum")}
    expected = {"truth.tum": scene.trace.truth, **{f"agent_{n}.tum": scene.trace.estimates[n] for n in range(AGENTS)}}
    assert paths.keys() == expected.keys()
    for name, states in expected.items():
        lines = [line.split() for line in paths[name].read_text().splitlines()]
        assert [int(words[0].replace(".", "")) for words in lines] == TIMES
        assert [list(map(float, words[1:4])) for words in lines] == states[:, :3].tolist()
        assert {tuple(words[4:]) for words in lines} == {("0", "0", "0", "1")}


def test_steps_without_a_number_are_left_out_of_a_trajectory(tmp_path):
    crash = 'fault=[{kind="crash", agents=[1], from=1.0}]'
    scene = read_scene(made_log(tmp_path / "run.mcap", "steps=20", crash))
    lengths = {path.name: len(path.read_text().splitlines()) for path in write_tum(scene, tmp_path / "tum")}
    assert lengths["agent_0.tum"] == 20
    assert lengths["agent_1.tum"] == int(np.isfinite(scene.trace.estimates[1, :, 0]).sum()) < 20
