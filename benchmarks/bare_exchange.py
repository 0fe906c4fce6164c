"""The yardstick of `lockstep`: processes that exchange rounds over Zenoh and do nothing else.

As fast as we can make it: peers linked along the graph's edges only, no scouting, one FIFO channel per
neighbour read in the main thread, batch scheduling, dropping instead of blocking.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import zenoh

from benchmarks.common import children, end_with_parent
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.runtimes import ONE_RUNTIME
from zenoh_cbef.protocol.session import Connection, open_session, yield_to_others

_PATIENCE_SECONDS = 120.0
RUNTIMES = {"merged runtime": {"ZENOH_RUNTIME": ONE_RUNTIME}, "default runtime": {}}


@dataclass(frozen=True)
class Part:
    """One process of the exchange. ports: of all processes. size: bytes of a message."""

    me: int
    neighbours: list[int]
    ports: list[int]
    rounds: int
    size: int


def bare_rate(
    edges: Sequence[tuple[int, int]], count: int, *, rounds: int, size: int, environment: dict[str, str]
) -> float:
    """Measure the slowest process's rounds per second from a tenth to the end. RuntimeError if it hangs."""
    ports = free_ports(count)
    with children() as family:
        started = []
        for agent in range(count):
            near = [b if a == agent else a for a, b in edges if agent in (a, b)]
            part = json.dumps(asdict(Part(agent, sorted(near), ports, rounds, size)))
            started.append(family.start(__name__, [part], environment, listen_to=True))
        until = time.monotonic() + _PATIENCE_SECONDS
        return min(float(family.wait(child, until - time.monotonic())) for child in started)


def exchange(part: Part) -> float:
    """Be one process; returns its rounds per second."""
    yield_to_others()
    endpoints = [f"tcp/127.0.0.1:{port}" for port in part.ports]
    lower = [endpoints[other] for other in part.neighbours if other < part.me]
    connection = Connection(connect=lower, listen=[endpoints[part.me]], gossip=False)
    with open_session(connection) as session:
        subscribers = [
            session.declare_subscriber(f"bare/{other}", zenoh.handlers.FifoChannel(64)) for other in part.neighbours
        ]
        publisher = session.declare_publisher(
            f"bare/{part.me}",
            congestion_control=zenoh.CongestionControl.DROP,
            allowed_destination=zenoh.Locality.REMOTE,
        )
        # Declarations travel in order: a process that sees our token knows our subscriptions.
        with session.liveliness().declare_token(f"bare-live/{part.me}"):
            _wait_for(session, {f"bare-live/{other}" for other in part.neighbours})
            rate = _rounds(publisher, subscribers, part)
            # The last messages are still on their way, and no process waits for a neighbour that closes.
            time.sleep(0.5)
    return rate


def _wait_for(session: zenoh.Session, needed: set[str]) -> None:
    while True:
        replies = session.liveliness().get("bare-live/*")
        if needed <= {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}:
            return
        time.sleep(0.02)


def _rounds(
    publisher: zenoh.Publisher,
    subscribers: Sequence[zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]],
    part: Part,
) -> float:
    handlers = [subscriber.handler for subscriber in subscribers]
    data, warm = bytes(part.size), part.rounds // 10
    began = time.perf_counter()
    for round_ in range(part.rounds):
        if round_ == warm:
            began = time.perf_counter()
        publisher.put(data)
        for handler in handlers:
            sample = handler.try_recv()
            if sample is None:
                sample = handler.recv()
            sample.payload.to_bytes()
    return (part.rounds - warm) / (time.perf_counter() - began)


if __name__ == "__main__":
    end_with_parent()
    print(exchange(Part(**json.loads(sys.argv[1]))))
