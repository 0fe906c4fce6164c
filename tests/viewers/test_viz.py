"""The export for viewers, read again with the public libraries: what it shows is what the log says."""

import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from mcap.reader import make_reader

from tests.log.made import START, made_log
from zenoh_cbef.analysis.chi2 import chi2_quantile
from zenoh_cbef.errors import UserError
from zenoh_cbef.viewers.rerun_file import write_rrd
from zenoh_cbef.viewers.scene import quaternions, read_scene
from zenoh_cbef.viewers.viz import write_viz

OUTAGE = 'fault=[{kind="outage", agents=[3], from=2.0, until=3.0}]'
STEPS, AGENTS = 40, 4


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    log = made_log(
        tmp_path_factory.mktemp("made") / "run.mcap",
        *(f"steps={STEPS}", f"agents.count={AGENTS}", "network.graph=complete", OUTAGE),
    )
    return read_scene(log)


@pytest.fixture(scope="module")
def shown(scene, tmp_path_factory) -> dict[str, list]:
    """Every message of the export by topic, as the public reader decodes it."""
    decoder = pytest.importorskip("mcap_protobuf.decoder").DecoderFactory()
    path, _ = write_viz(scene, tmp_path_factory.mktemp("viz") / "viz.mcap")
    found = defaultdict(list)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[decoder])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema is not None
            assert schema.encoding == channel.message_encoding == "protobuf"
            found[channel.topic].append((schema.name, message.log_time, decoded))
    return dict(found)


def vector(message) -> list[float]:
    return [message.x, message.y, message.z]


def turned(pose) -> np.ndarray:
    """The rotation matrix of a pose's unit quaternion, by its definition."""
    x, y, z, w = (getattr(pose.orientation, name) for name in "xyzw")
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@given(arrays(np.float64, 3, elements=st.floats(-1, 1)), st.floats(-3.1, 3.1))
def test_quaternions_turn_as_their_matrices(axis, angle):
    length = np.linalg.norm(axis)
    x, y, z = axis / length if length > 0.01 else (0.0, 0.0, 1.0)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    found = quaternions(matrix[None])[0]
    expected = np.array([*(np.sin(angle / 2) * np.array([x, y, z])), np.cos(angle / 2)])
    assert min(np.abs(found - expected).max(), np.abs(found + expected).max()) < 1e-7


def test_channels_are_of_the_schemas_that_viewers_draw(shown):
    kinds = {topic: messages[0][0] for topic, messages in shown.items()}
    assert kinds == {
        "/tf": "foxglove.FrameTransforms",
        "/agents": "foxglove.PointCloud",
        "/estimates": "foxglove.PointCloud",
        "/target/path": "foxglove.PosesInFrame",
        "/estimate/path": "foxglove.PosesInFrame",
        "/scene": "foxglove.SceneUpdate",
        "/log": "foxglove.Log",
        "/metrics": "cbef.NetworkMetrics",
        **{f"/agent/{agent}/metrics": "cbef.AgentMetrics" for agent in range(AGENTS)},
    }
    steps = [START + 100_000_000 * step for step in range(1, STEPS + 1)]
    for topic, messages in shown.items():
        assert topic == "/log" or [time for _, time, _ in messages] == steps


def test_frames_points_and_paths_are_where_the_log_says(shown, scene):
    trace = scene.trace
    for row in (0, 17, STEPS - 1):
        frames = {one.child_frame_id: vector(one.translation) for one in shown["/tf"][row][2].transforms}
        assert frames["target"] == trace.truth[row, :3].tolist()
        assert frames["agent/2"] == trace.positions[2, row].tolist()
        assert frames["agent/2/estimate"] == trace.estimates[2, row, :3].tolist()
        cloud = shown["/agents"][row][2]
        assert [field.name for field in cloud.fields] == ["x", "y", "z", "agent", "range"]
        points = np.frombuffer(cloud.data, "<f4").reshape(-1, cloud.point_stride // 4)
        assert points[:, :3] == pytest.approx(trace.positions[:, row], rel=1e-6)
        assert points[:, 4] == pytest.approx(trace.ranges[:, row], rel=1e-6)
        path = [vector(pose.position) for pose in shown["/target/path"][row][2].poses]
        assert path == trace.truth[: row + 1, :3].tolist()


def test_ellipsoids_are_the_covariances(shown, scene):
    reach = chi2_quantile(0.95, 3.0)
    for row in (0, STEPS - 1):
        entities = {one.id: one for one in shown["/scene"][row][2].entities}
        for agent in range(AGENTS):
            (sphere,) = entities[f"uncertainty of agent {agent}"].spheres
            turn = turned(sphere.pose)
            covariance = turn @ np.diag((np.array(vector(sphere.size)) / 2.0) ** 2 / reach) @ turn.T
            assert covariance == pytest.approx(scene.trace.covariances[agent, row, :3, :3], rel=1e-6, abs=1e-9)
            assert vector(sphere.pose.position) == scene.trace.estimates[agent, row, :3].tolist()


def test_links_are_red_while_an_agent_is_cut_off(shown, scene):
    for row, cut in ((10, False), (25, True), (35, False)):
        (links,) = (one.lines[0] for one in shown["/scene"][row][2].entities if one.id == "links")
        assert len(links.points) == len(links.colors) == 2 * AGENTS * (AGENTS - 1)
        for place, (source, destination) in enumerate(scene.links.tolist()):
            colour = links.colors[2 * place]
            assert vector(links.points[2 * place]) == scene.trace.positions[destination, row].tolist()
            assert (colour.r > colour.g) == (cut and 3 in (source, destination))


def test_plots_are_the_numbers_of_the_analysis(shown, scene):
    errors = np.sqrt((scene.analysis.position_error**2).mean(axis=0))
    assert [one.position_error for _, _, one in shown["/metrics"]] == pytest.approx(errors)
    assert [one.step for _, _, one in shown["/metrics"]] == list(range(1, STEPS + 1))
    mine = [one.nees for _, _, one in shown["/agent/1/metrics"]]
    assert mine == pytest.approx(scene.analysis.nees[1])
    cut = [one.delivered for _, _, one in shown["/agent/3/metrics"]]
    assert (cut[10], cut[25], cut[35]) == (1.0, 0.0, 1.0)


def test_events_tell_who_said_what(shown):
    texts = [(one.name, one.message) for _, _, one in shown["/log"]]
    assert texts[0] == ("target", "run made started")
    assert ("agent/3", f"agent 3 ended after step {STEPS}") in texts


def test_the_layout_names_channels_and_fields_that_are_there(scene, shown, tmp_path):
    _, layout = write_viz(scene, tmp_path / "x.mcap")
    panels = json.loads(layout.read_text())["configById"]
    assert set(panels["3D!world"]["topics"]) <= set(shown)
    assert panels["RosOut!log"]["topicToRender"] in shown
    plotted = [path["value"] for panel in panels.values() for path in panel.get("paths", ())]
    assert plotted
    for path in plotted:
        topic, field = path.split(".")
        assert field in shown[topic][0][2].DESCRIPTOR.fields_by_name


def test_channels_and_their_numbers_are_documented(shown):
    page = (Path(__file__).resolve().parents[2] / "docs" / "viewers.md").read_text(encoding="utf-8")
    for topic, messages in shown.items():
        assert f"`{re.sub('[0-9]+', '{id}', topic)}`" in page
        assert f"`{messages[0][0]}`" in page
        if messages[0][0].startswith("cbef."):
            assert all(f"`{field.name}`" in page for field in messages[0][2].DESCRIPTOR.fields)


def test_a_plane_has_discs_and_a_filter_without_covariance_none(tmp_path):
    flat = read_scene(made_log(tmp_path / "flat.mcap", "steps=5", "filter.planar_height=1.0"))
    assert flat.ellipsoids.axes[:, :, 0] == pytest.approx(1e-3)
    reach = chi2_quantile(0.95, 2.0)
    areas = np.prod(flat.ellipsoids.axes[:, :, 1:], axis=2) / reach
    assert areas == pytest.approx(np.sqrt(np.linalg.det(flat.trace.covariances[:, :, :2, :2])))
    none = read_scene(made_log(tmp_path / "none.mcap", "steps=5", "filter.kind=cbef"))
    assert np.isnan(none.ellipsoids.axes).all()
    if "foxglove_schemas_protobuf" in sys.modules:
        assert all(path.exists() for path in write_viz(none, tmp_path / "none-viz.mcap"))


@pytest.mark.parametrize("package", ["mcap_protobuf", "foxglove_schemas_protobuf", "rerun"])
def test_a_missing_package_is_named(scene, tmp_path, monkeypatch, package):
    write, extra = (write_rrd, "rerun") if package == "rerun" else (write_viz, "viz")
    for name in [name for name in sys.modules if name.split(".")[0] == package]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(UserError, match=rf"zenoh-cbef\[{extra}\]"):
        write(scene, tmp_path / "x")
    assert not list(tmp_path.iterdir()), "a refused export leaves nothing behind"


@pytest.mark.processes
def test_a_recording_of_rerun_holds_the_scene(scene, tmp_path: Path):
    pytest.importorskip("rerun", reason="rerun-sdk is large and not installed by 'make install'; see docs/replay.md")
    (path,) = write_rrd(scene, tmp_path / "run.rrd")
    for verb in ("verify", "print"):
        done = subprocess.run(
            [sys.executable, "-m", "rerun", "rrd", verb, str(path)], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    for entity in ("world/agents", "world/target", "world/uncertainty", "world/links", "metrics/nees", "events"):
        assert f"/{entity}" in done.stdout, entity
