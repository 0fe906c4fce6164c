"""The yardstick of `lockstep`: processes that exchange rounds over Zenoh and do nothing else.

As fast as we can make it: peers linked along the graph's edges only, no scouting, one FIFO channel per
neighbour read in the main thread, batch scheduling, dropping instead of blocking.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence

import zenoh

from benchmarks.exchange_part import Outcome, Part, end_with_parent, part_of, timed
from benchmarks.exchanging import exchanged, parts_of, slowest
from zenoh_cbef.machine import yield_to_others
from zenoh_cbef.nodes.launch.ports import free_ports
from zenoh_cbef.protocol.runtimes import ONE_RUNTIME
from zenoh_cbef.protocol.session import Connection, open_session

RUNTIMES = {"merged runtime": {"ZENOH_RUNTIME": ONE_RUNTIME}, "default runtime": {}}


def bare_rate(
    edges: Sequence[tuple[int, int]], count: int, *, rounds: int, size: int, environment: dict[str, str]
) -> float:
    """Measure the slowest process's rounds per second from a tenth to the end. RuntimeError if it hangs.

    size: bytes of a message.
    """
    parts = parts_of(edges, [f"tcp/127.0.0.1:{port}" for port in free_ports(count)])
    return slowest(exchanged(__name__, parts, [str(rounds), str(size)], environment=environment))


def exchange(part: Part, rounds: int, size: int) -> float:
    """Be one process; returns its rounds per second."""
    yield_to_others()
    lower = [part.endpoints[other] for other in part.neighbours if other < part.me]
    connection = Connection(connect=lower, listen=[part.endpoints[part.me]], gossip=False)
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
            rate = timed(rounds, _turn(publisher, subscribers, bytes(size)))
            # The last messages are still on their way, and no process waits for a neighbour that closes.
            time.sleep(0.5)
    return rate


def _wait_for(session: zenoh.Session, needed: set[str]) -> None:
    while True:
        replies = session.liveliness().get("bare-live/*")
        if needed <= {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}:
            return
        time.sleep(0.02)


def _turn(
    publisher: zenoh.Publisher,
    subscribers: Sequence[zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]]],
    data: bytes,
) -> Callable[[int], None]:
    handlers = [subscriber.handler for subscriber in subscribers]

    def turn(_: int) -> None:
        publisher.put(data)
        for handler in handlers:
            sample = handler.try_recv()
            if sample is None:
                sample = handler.recv()
            sample.payload.to_bytes()

    return turn


if __name__ == "__main__":
    end_with_parent()
    part = part_of(sys.argv[1], lambda: 0)
    Outcome(part.me, exchange(part, *map(int, sys.argv[2:])), []).tell()
