"""What viewers get of the lab over a real WebSocket is what the export holds; they may order nothing."""

from base64 import b64decode
from contextlib import closing

import numpy as np
import pytest

from tests.lab.viewer import Viewer, exported
from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.lab.bench import Bench
from zenoh_cbef.lab.foxglove import Foxglove
from zenoh_cbef.lab.guard import Guard
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.read.recording import read_recording
from zenoh_cbef.viewers.growing import GrowingScene
from zenoh_cbef.viewers.scene import read_scene

pytest.importorskip("foxglove", reason="the extra 'foxglove' is not installed")

STEPS, AGENTS = 12, 4
OUTAGE = 'fault=[{kind="outage", agents=[3], from=0.4, until=0.7}]'
KEYS = (f"steps={STEPS}", f"agents.count={AGENTS}", "network.graph=complete", OUTAGE)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    return made_log(tmp_path_factory.mktemp("viewers") / "run.mcap", *KEYS)


@pytest.fixture(scope="module")
def shown(log):
    return exported(log, log.with_name("viz.mcap"))


@pytest.fixture
def bench(log):
    bench = Bench({}, measured=True)
    bench.open_log(str(log))
    yield bench
    bench.close()


@pytest.mark.slow
def test_a_viewer_gets_the_channels_and_the_numbers_of_the_export(bench, shown):
    with Foxglove(bench, "127.0.0.1", 0, None) as served, closing(Viewer(served.port)) as viewer:
        assert viewer.info["capabilities"] == []
        channels = viewer.channels(len(shown))
        told = {(topic, one["schemaName"], b64decode(one["schema"])) for topic, one in channels.items()}
        assert told == set(shown)
        assert {one["encoding"] for one in channels.values()} == {"protobuf"}
        topics = dict(enumerate(sorted(channels)))
        viewer.say(
            op="subscribe",
            subscriptions=[{"id": at, "channelId": channels[topic]["id"]} for at, topic in topics.items()],
        )
        expected = {topic: messages for (topic, _, _), messages in shown.items()}
        last = max(max(messages) for messages in expected.values())
        came: set[str] = set()
        while came < {topic for topic in topics.values() if topic != "/log"}:
            at, time, data = viewer.message()
            assert data in expected[topics[at]][time], (topics[at], time)
            if time == last:
                came.add(topics[at])


def test_viewers_order_nothing_unless_that_was_asked_for(bench):
    with Foxglove(bench, "127.0.0.1", 0, None) as served, closing(Viewer(served.port)) as viewer:
        viewer.say(op="advertise", channels=[{"id": 1, "topic": "/lab/order", "encoding": "json", "schemaName": ""}])
        assert "clientPublish" in viewer.told("status")["message"]


def test_orders_need_the_token_of_the_lab(bench):
    guard = Guard()
    with Foxglove(bench, "127.0.0.1", 0, guard) as served, closing(Viewer(served.port)) as viewer:
        assert viewer.info["capabilities"] == ["services"]
        [service] = viewer.told("advertiseServices")["services"]
        assert service["name"] == "/lab/order"
        for token in (None, "wrong", 3):
            assert "lacks the token" in viewer.ordered(service["id"], ask="stop", token=token)["error"]
        assert "one of clear, fault" in viewer.ordered(service["id"], ask="open", token=guard.token)["error"]
        assert "its run has ended" in viewer.ordered(service["id"], ask="stop", token=guard.token)["error"]


def test_a_port_that_is_taken_is_named(bench):
    with Foxglove(bench, "127.0.0.1", 0, None) as served, pytest.raises(UserError, match=f"port {served.port}"):
        Foxglove(bench, "127.0.0.1", served.port, None)


def test_another_log_takes_the_place_of_the_first(bench, tmp_path):
    other = made_log(tmp_path / "other.mcap", "steps=3", "agents.count=3")
    with Foxglove(bench, "127.0.0.1", 0, None) as served, closing(Viewer(served.port)) as viewer:
        gone = {one["id"] for one in viewer.channels(12).values()}
        bench.open_log(str(other))
        assert set(viewer.told("unadvertise")["channelIds"]) <= gone
        assert "/agent/3/metrics" not in viewer.channels(11)


@pytest.mark.parametrize("more", [(), ("filter.bias=estimate",), ("filter.start=given",)])
def test_stretches_have_the_numbers_of_the_whole(tmp_path, more):
    log = made_log(tmp_path / "run.mcap", *KEYS, *more)
    whole, growing = read_scene(log), GrowingScene(read_recording(open_log(log)))
    for since, until in ((0, 1), (1, 2), (2, 7), (7, STEPS), (3, 5)):
        part = growing.stretch(since, until, whole=until == STEPS)
        for told, found in ((whole.metrics(), part.metrics()), (whole.agent_metrics(2), part.agent_metrics(2))):
            for name, values in told.items():
                np.testing.assert_array_equal(found[name], values[since:until], err_msg=name)
        np.testing.assert_array_equal(part.delivered, whole.delivered[:, since:until])
    growing = GrowingScene(read_recording(open_log(log)))
    events = [
        one for since in range(STEPS) for one in growing.stretch(since, since + 1, whole=since == STEPS - 1).events
    ]
    assert events == sorted(whole.events, key=lambda one: one.time)
