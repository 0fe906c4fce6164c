"""The ways in which a rival's messages travel, each as fast as we can make it: Unix sockets, ZeroMQ and MPI.

A process has its own message and those of its neighbours in arrays that are made once, `own` and `others`; a way sends
the one and reads into the other. Messages of one sender come in the order in which they were sent, so one that is a
round ahead does no harm. ZeroMQ and MPI are for this benchmark only, and are imported where they are used.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from importlib import import_module
from typing import Any

from benchmarks.exchange_part import Part
from zenoh_cbef.arrays import Floats

Swap = Callable[[], None]
"""Sends the own message to all neighbours, and waits for one of each of them."""

_RETRY_SECONDS = 0.01
_LAST_MILLISECONDS = 2000
"""For how long a process that closes goes on sending its last messages."""
_NAME = struct.Struct("<I")


@contextmanager
def unix_sockets(part: Part, own: Floats, others: Floats) -> Iterator[Swap]:
    """A pair of SOCK_SEQPACKET sockets for each edge: one system call sends a message, one reads it, whole."""
    with ExitStack() as stack:
        listener = stack.enter_context(_socket())
        listener.bind(part.endpoints[part.me])
        listener.listen(len(part.endpoints))
        links = dict[int, socket.socket]()
        for other in part.neighbours:
            if other < part.me:
                links[other] = stack.enter_context(_linked(part.endpoints[other]))
                links[other].send(_NAME.pack(part.me))
        while len(links) < len(part.neighbours):
            link = stack.enter_context(listener.accept()[0])
            links[_NAME.unpack(link.recv(_NAME.size))[0]] = link
        sends = [links[other].send for other in part.neighbours]
        reads = [links[other].recv_into for other in part.neighbours]
        yield _swap(sends, reads, own, others)


def _socket() -> socket.socket:
    return socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)


def _linked(path: str) -> socket.socket:
    while True:
        link = _socket()
        try:
            link.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):  # it does not listen yet
            link.close()
            time.sleep(_RETRY_SECONDS)
        else:
            return link


def _swap(sends: Sequence[Callable[[Any], object]], reads: Sequence[Any], own: Floats, others: Floats) -> Swap:
    """One call for each message sent, then one for each that is read, into its neighbour's row."""
    out, rows = own.data.cast("B"), [row.data.cast("B") for row in others]
    arrivals = list(zip(reads, rows, strict=True))

    def swap() -> None:
        for send in sends:
            send(out)
        for read, row in arrivals:
            read(row)

    return swap


@contextmanager
def zeromq(part: Part, own: Floats, others: Floats) -> Iterator[Swap]:
    """A publisher and a subscriber for each neighbour, over ipc, without limits beyond which messages are dropped."""
    zmq = import_module("zmq")
    with zmq.Context() as context, ExitStack() as stack:

        def opened(kind: int) -> Any:
            made = stack.enter_context(context.socket(kind))
            made.set_hwm(0)
            made.linger = _LAST_MILLISECONDS
            return made

        publisher = opened(zmq.XPUB)
        publisher.xpub_verbose = True
        publisher.bind(f"ipc://{part.endpoints[part.me]}")
        subscribers = [opened(zmq.SUB) for _ in part.neighbours]
        for subscriber, other in zip(subscribers, part.neighbours, strict=True):
            subscriber.subscribe(b"")
            subscriber.connect(f"ipc://{part.endpoints[other]}")
        for _ in part.neighbours:
            publisher.recv()  # a neighbour has subscribed: what is sent from now on reaches it
        yield _swap([publisher.send], [one.recv_into for one in subscribers], own, others)


@contextmanager
def mpi(part: Part, own: Floats, others: Floats) -> Iterator[Swap]:
    """One collective call along the graph's edges for a whole round."""
    world = import_module("mpi4py.MPI").COMM_WORLD
    graph = world.Create_dist_graph_adjacent(part.neighbours, part.neighbours)
    yield partial(graph.Neighbor_allgather, own, others)


def mpi_place() -> int:
    """The number that the launcher of MPI has given to this process."""
    return int(import_module("mpi4py.MPI").COMM_WORLD.Get_rank())


WAYS = {"unix": unix_sockets, "zeromq": zeromq, "mpi": mpi}
