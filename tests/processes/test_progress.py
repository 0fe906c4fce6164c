"""What the target believes of how far its agents are."""

import time
import uuid

from zenoh_cbef.nodes.common.node import Identity, Node
from zenoh_cbef.nodes.target.progress import Progress
from zenoh_cbef.protocol.messages import encode

ESTIMATE = {"state": [0.0] * 6, "innovation": None, "weight": None, "neighbours": [], "received": [], "lost": []}
ESTIMATE |= {"late": [], "latency": [], "covariance": None}


def test_an_estimate_of_a_step_that_was_not_begun_is_refused_and_counted():
    run = f"progress-{uuid.uuid4().hex[:12]}"
    with Node(Identity(run, "target", "target")) as node:
        progress = Progress(node, 2, 1.0, 0.0, begun=3)
        for step in (4, 1 << 62, 3):
            node.session.put(node.keys.estimate(1), encode(run, "agent/1", 0, time.time_ns(), {"k": step, **ESTIMATE}))
        until = time.monotonic() + 20.0
        while not progress.estimates() and time.monotonic() < until:
            progress.drain()
            time.sleep(0.01)
        assert [step for step, _ in progress.estimates()] == [3]
        assert progress.rejections.total == 2
