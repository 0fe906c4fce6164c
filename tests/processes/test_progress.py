"""What the target believes of how far its agents are."""

import time
import uuid

from tests.waiting import until
from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.protocol.claims import Claims
from zenoh_cbef.protocol.messages import encode

ESTIMATE = {"state": [0.0] * 6, "innovation": None, "weight": None, "neighbours": [], "received": [], "lost": []}
ESTIMATE |= {"late": [], "latency": [], "covariance": None}


def test_an_estimate_of_a_step_that_was_not_begun_is_refused_and_counted():
    run = f"progress-{uuid.uuid4().hex[:12]}"
    with Node(Identity(run, "target", "target")) as node:
        progress = Progress(node, 2, 1.0, 0.0, claims=Claims(node.presence), begun=3)
        for step in (4, 1 << 62, 3):
            node.session.put(node.keys.estimate(1), encode(run, "agent/1", 0, time.time_ns(), {"k": step, **ESTIMATE}))

        def told() -> list[tuple[int, bytes]]:
            progress.drain()
            return progress.estimates()

        assert [step for step, _ in until(told)] == [3]
        assert progress.rejections.total == 2


def test_an_estimate_that_did_not_come_is_asked_for():
    run = f"progress-{uuid.uuid4().hex[:12]}"
    with Node(Identity(run, "target", "target")) as node:
        progress = Progress(node, 2, 60.0, 0.0, claims=Claims(node.presence), begun=3)
        for agent in range(2):
            node.presence.announce(f"agent/{agent}")
            key = node.keys.estimate(agent)
            data = encode(run, f"agent/{agent}", 0, time.time_ns(), {"k": 3, **ESTIMATE})
            # What an agent has sent and the target has not heard: as after a broken link, or in a flood.
            node.archive.open(key).keep(0, 3, data)
            node.archive.serve(key)
        assert node.wait_for(lambda live: {"agent/0", "agent/1"} <= live, 100.0)
        assert progress.wait(3)
        assert progress.silent() == []
