"""What a viewer hears of a run that goes on is what the export of its log holds."""

import math
import re
from contextlib import closing
from typing import Any

import pytest

from tests.lab.viewer import Viewer, decoded, exported_messages
from tests.processes.conftest import settings
from tests.waiting import until

pytest.importorskip("foxglove", reason="the extra 'foxglove' is not installed")
pytest.importorskip("mcap_protobuf", reason="the extra 'viz' is not installed")

LAST = 300
TOPICS = ("/metrics", "/agent/2/metrics")


def test_a_viewer_hears_a_run_as_its_export_shows_it(world):
    words = settings(f"steps={LAST}", 'fault=[{kind="loss", probability=0.2}]')
    lab = world.start("lab", "tracking", *words, "--foxglove", "--foxglove-port", "0", "--no-browser")
    assert lab.stderr is not None
    port = next(int(found[1]) for line in lab.stderr if (found := re.search(r"ws://127\.0\.0\.1:(\d+)", line)))
    heard: dict[str, dict[int, Any]] = {topic: {} for topic in TOPICS}
    with closing(Viewer(port)) as viewer:
        channels = viewer.channels(12)
        subscribed = [{"id": at, "channelId": channels[topic]["id"]} for at, topic in enumerate(TOPICS)]
        viewer.say(op="subscribe", subscriptions=subscribed)
        while any(LAST not in steps for steps in heard.values()):
            at, _, data = viewer.message()
            message = decoded(channels[TOPICS[at]], data)
            heard[TOPICS[at]][message.step] = message
    logs = until(lambda: list((world.folder / "logs").glob("lab-*/run.mcap")))
    for topic, steps in heard.items():
        assert len(steps) > 10
        told = {one.step: one for one in exported_messages(logs[0], world.folder / "viz.mcap")[topic]}
        for step, message in steps.items():
            for field in message.DESCRIPTOR.fields:
                found, expected = getattr(message, field.name), getattr(told[step], field.name)
                assert found == pytest.approx(expected, nan_ok=True, rel=1e-12) or (
                    # The centralised filter says nothing where the lab came after the first step.
                    field.name == "centralized_position_error" and math.isnan(found)
                ), (topic, step, field.name)
