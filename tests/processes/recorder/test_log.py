"""What the log of a real run can be used for: proof, analysis, arrays, also when it is cut off or tampered with."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import pytest

from tests.log.made import made_log
from tests.processes.conftest import SMALL, World
from zenoh_cbef.analysis.design import design
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import McapWriter
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.scenario.plan import Plan

STEPS, AGENTS = 40, 4


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> Iterator[World]:
    world = World(tmp_path_factory.mktemp("recorded"))
    world.complete("sensor.dropout_probability=0.1")
    yield world
    world.end()


def copy_with(source: Path, target: Path, change, *, last: str | None = None) -> None:
    """The same log, every message passed through change(topic, data); None leaves it out.

    last: how the topics end whose messages are moved to the end.
    """
    file = McapFile(source)
    writer = McapWriter(target, library="test")
    for name, data in file.attachments.items():
        writer.add_attachment(name, "application/toml", data)
    for name, said in file.metadata.items():
        writer.add_metadata(name, said)
    channels = {}
    for message in sorted(file.messages(), key=lambda one: last is not None and one.channel.topic.endswith(last)):
        data = change(message.channel.topic, message.data)
        if data is None:
            continue
        topic = message.channel.topic
        if topic not in channels:
            schema = writer.register_schema(message.channel.schema_name, "jsonschema", b"{}")
            channels[topic] = writer.register_channel(topic, message.channel.message_encoding, schema)
        writer.add_message(channels[topic], message.log_time, message.publish_time, message.sequence, data)
    writer.close()


def without_beacons(log: Path, folder: Path) -> Path:
    """A copy of a log that lacks them."""
    copy_with(log, folder / "poor.mcap", lambda topic, data: None if "/beacon/" in topic else data)
    return folder / "poor.mcap"


def flip(kind: str, field: str, step: int):
    """A change that flips the lowest bit of one number in one message."""

    def change(topic: str, data: bytes) -> bytes:
        if not topic.endswith(kind):
            return data
        message = msgpack.unpackb(data)
        if message["k"] != step:
            return data
        value = message[field]
        array = np.frombuffer(value, "<u8").copy() if isinstance(value, bytes) else np.array(value).view(np.uint64)
        array.ravel()[0] ^= 1
        message[field] = array.tobytes() if isinstance(value, bytes) else array.view(np.float64).tolist()
        return msgpack.packb(message)

    return change


@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("agent/2/estimate", "state"),
        ("agent/2/estimate", "covariance"),
        ("agent/1/round", "payload"),
        ("beacon/0", "arrived"),
    ],
)
def test_one_flipped_bit_is_found(recorded, tmp_path, kind, field):
    step = 7
    if kind == "beacon/0":  # one that was heard
        heard = (msgpack.unpackb(m.data) for m in McapFile(recorded.log).messages() if m.channel.topic.endswith(kind))
        step = next(m["k"] for m in heard if m["k"] >= 5 and m["arrived"] is not None)
    tampered = tmp_path / "tampered.mcap"
    copy_with(recorded.log, tampered, flip(kind, field, step))
    verdict = recorded.verdict(1, log=tampered)
    assert f"step {step}" in verdict
    assert "in the log" in verdict


def test_an_untouched_copy_is_equal(recorded, tmp_path):
    copy = tmp_path / "copy.mcap"
    copy_with(recorded.log, copy, lambda _, data: data)
    recorded.verdict(log=copy)


@pytest.mark.parametrize(
    "filter_", ["filter.kind=sicf", "filter.kind=ci,filter.measurement=difference"], ids=["rounds", "rounds and ranges"]
)
def test_a_run_with_liars_is_proved(tmp_path, filter_):
    lies = ", ".join(
        f'{{kind="byzantine", agents=[{agent}], mode="{mode}"}}' for agent, mode in ((1, "random"), (2, "replay"))
    )
    world = World(tmp_path)
    try:
        world.complete("network.graph=complete", "consensus.trim=1", f"fault=[{lies}]", *filter_.split(","))
        assert "equal bit for bit" in world.verdict()
        assert world.metrics()["left_out"] == [1, 2]
    finally:
        world.end()


def test_a_log_without_beacons_cannot_be_judged(recorded, tmp_path):
    verdict = recorded.call("verify", str(without_beacons(recorded.log, tmp_path)))
    assert verdict.returncode == 2
    assert "beacons" in verdict.stdout


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_a_cut_log_is_described_analysed_and_verified_as_far_as_it_goes(recorded, tmp_path, share):
    whole = recorded.log.read_bytes()
    chunks = [record for record in McapFile(recorded.log)._walk.records() if record.opcode == 6]  # noqa: SLF001
    keep = chunks[0].end + int(share * (len(whole) - chunks[0].end)) if len(chunks) > 1 else chunks[0].end + 5
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[:keep])
    described = recorded.call("info", str(cut), "--json")
    assert described.returncode == 0
    assert json.loads(described.stdout)["complete"] is False
    analysed = recorded.call("analyze", str(cut), "--json")
    assert analysed.returncode == 0, analysed.stderr
    assert json.loads(analysed.stdout)["complete"] is False
    recorded.verdict(log=cut)


def test_analyze_prints_one_object_with_the_promised_names(recorded):
    done = recorded.call("analyze", str(recorded.log), "--json")
    metrics = json.loads(done.stdout)
    assert metrics["run"] == recorded.run
    assert (metrics["filter"], metrics["agents"], metrics["steps"]) == ("sicf", AGENTS, STEPS)
    assert len(metrics["msee"]["agents"]) == AGENTS
    assert metrics["msee"]["average"] == pytest.approx(np.mean(metrics["msee"]["agents"]))
    for name in ("position_rmse", "velocity_rmse"):
        assert metrics[name] > 0
        assert metrics["centralized"][name] > 0
        assert metrics["bound"][name] > 0
    ratio = metrics["position_rmse"] / metrics["centralized"]["position_rmse"]
    assert metrics["ratio_to_centralized"] == pytest.approx(ratio)
    assert set(metrics["messages"]) == {"sent", "recorded", "missing", "rejected"}
    assert len(metrics["links"]) == 2 * AGENTS  # a ring, both directions
    for link in metrics["links"]:
        assert link["sent"] == link["delivered"] == STEPS * 3
        assert link["lost"] == link["late"] == 0
        assert 0 < link["latency"] < 10


def test_the_bytes_of_a_step_are_those_that_were_foretold(recorded):
    scenario = read_header(open_log(recorded.log)).scenario.changed(name=recorded.run)
    metrics = recorded.metrics()
    told = design(Plan(scenario), search=False).configured.bytes_per_step
    assert metrics["bytes_per_step"] == pytest.approx(told, rel=0.01)


def test_runs_are_compared_side_by_side_and_differences_are_told(recorded, tmp_path):
    sibling = f"sibling-of-{recorded.run}"
    again = ("--set", "filter.kind=ci", "--run", sibling, "--output", str(tmp_path / "run.mcap"))
    assert recorded.call("reestimate", str(recorded.log), *again).returncode == 0
    page, table = tmp_path / "curves.html", tmp_path / "rows.csv"
    logs = [str(recorded.log), str(tmp_path)]
    done = recorded.call("compare", *logs, "--json", "-o", str(page), "-o", str(table))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    rows = json.loads(done.stdout)
    assert [row["filter"] for row in rows] == ["sicf", "ci"]
    metrics = recorded.metrics()
    for name in ("position_rmse", "velocity_rmse", "ratio_to_centralized", "disagreement", "bytes_per_step"):
        assert rows[0][name] == metrics[name]
    assert rows[0]["nees.average"] == metrics["nees"]["average"]
    assert rows[0]["missed"] == 0.0
    written = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["position_rmse"]) for row in written] == [row["position_rmse"] for row in rows]
    text = page.read_text()
    assert text.replace(sibling, "").count(recorded.run) > 0
    assert sibling in text
    other = made_log(tmp_path / "other.mcap", *SMALL, "sensor.dropout_probability=0.1", "seed=2")
    done = recorded.call("compare", str(recorded.log), str(other))
    assert done.returncode == 0
    assert "another truth, other measurements" in done.stderr


def test_skip_changes_the_window_but_not_the_msee(recorded):
    full, late = (
        json.loads(recorded.call("analyze", str(recorded.log), "--json", "--skip", skip).stdout)
        for skip in ("0", "0.5")
    )
    assert full["msee"] == late["msee"]
    assert full["position_rmse"] != late["position_rmse"]


def test_exported_arrays_have_the_promised_shapes_and_agree_with_the_metrics(recorded, tmp_path):
    output = tmp_path / "run.npz"
    assert recorded.call("export", str(recorded.log), "--to", "npz", "--output", str(output)).returncode == 0
    with np.load(output) as stored:
        arrays = dict(stored)
    expected = {
        "time": (STEPS,),
        "truth": (STEPS, 6),
        "positions": (AGENTS, STEPS, 3),
        "ranges": (AGENTS, STEPS),
        "initial": (AGENTS, 6),
        "estimates": (AGENTS, STEPS, 6),
        "covariances": (AGENTS, STEPS, 6, 6),
        "innovation": (AGENTS, STEPS),
        "edges": (AGENTS, 2),
    }
    assert {name: arrays[name].shape for name in expected} == expected
    missing = np.isnan(arrays["ranges"])
    assert 0.02 < missing.mean() < 0.25
    assert (np.isnan(arrays["innovation"]) == missing).all()
    distance = np.linalg.norm(arrays["truth"][None, :, :3] - arrays["positions"], axis=2)
    assert np.nanstd(arrays["ranges"] - distance) == pytest.approx(0.1, rel=0.3)
    metrics = recorded.metrics()
    error = arrays["estimates"] - arrays["truth"]
    assert np.sqrt((error[:, 10:, :3] ** 2).sum(axis=2).mean()) == pytest.approx(metrics["position_rmse"])
    assert (error**2).sum(axis=2).mean(axis=1) == pytest.approx(metrics["msee"]["agents"])


def test_csv_tables_carry_the_same_numbers(recorded, tmp_path):
    npz, folder = tmp_path / "run.npz", tmp_path / "tables"
    recorded.call("export", str(recorded.log), "--to", "npz", "--output", str(npz))
    assert recorded.call("export", str(recorded.log), "--to", "csv", "--output", str(folder)).returncode == 0
    table = np.genfromtxt(folder / "estimates.csv", delimiter=",", names=True)
    with np.load(npz) as arrays:
        x = table["x"].reshape(AGENTS, STEPS)
        assert (x == arrays["estimates"][:, :, 0]).all()


def test_every_message_carries_a_schema_its_sender_and_its_number(recorded):
    seen: dict[tuple[str, str], list[int]] = {}
    for message in McapFile(recorded.log).messages():
        assert message.channel.schema_encoding == "jsonschema"
        assert message.channel.message_encoding == "msgpack"
        body = msgpack.unpackb(message.data)
        assert body["run"] == recorded.run
        assert message.sequence == body["seq"]
        assert message.publish_time == body["sent"] <= message.log_time
        seen.setdefault((message.channel.topic, body["from"]), []).append(body["seq"])
    assert all(numbers == list(range(len(numbers))) for numbers in seen.values())


def without_round(topic: str, data: bytes) -> bytes:
    """What agent 1 would have said had it done without a message of its first neighbour in step 20."""
    message = msgpack.unpackb(data)
    if topic.endswith("agent/1/estimate") and message["k"] >= 20:
        message["received"][0] -= 1
        data = msgpack.packb(message)
    return flip("agent/1/round", "payload", 20)(topic, data)


def without_events(topic: str, data: bytes) -> bytes | None:
    """A log that lacks an event of agent 1, which could have said why its message differs."""
    if "/event" in topic:
        message = msgpack.unpackb(data)
        return None if (message["from"], message["kind"]) == ("agent/1", "here") else data
    return flip("agent/1/round", "payload", 20)(topic, data)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (without_round, "by step 20 agent 1 did without 1 messages from agent 0"),
        (without_events, "lacks events of agent/1"),
    ],
)
def test_a_run_that_did_without_a_message_is_not_called_different(recorded, tmp_path, change, reason):
    other = tmp_path / "other.mcap"
    copy_with(recorded.log, other, change)
    assert reason in recorded.verdict(2, log=other)
