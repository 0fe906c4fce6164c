"""What a recorder sees of a run while it goes by."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence

from zenoh_cbef.nodes.common.recording import Status
from zenoh_cbef.protocol.keys import address
from zenoh_cbef.protocol.kinds import ESTIMATE, TRUTH, EstimateMessage, Kind, M, TruthMessage
from zenoh_cbef.protocol.messages import BadMessage, decode_all

_KEPT = 256
"""Steps that are kept while estimates are missing: more than agents can be apart."""
_READ = ("v", "run", "from", "k", "state", "lost", "late")
"""What is read of an estimate."""
_MOST_TRUTHS, _MOST_BYTES = 100, 1 << 19
"""Steps that may wait to be read, fewer than are kept; and bytes."""


class Overview:
    """Keeps a Status up to date from the messages that go by.

    present: tells how many agents are there. left_out: agents whose errors do not count, as they send wrong values.
    axes: of positions, 2 in a plane. reached: the latest step of which an estimate was read. heard: the same for each
    agent.
    """

    def __init__(
        self, status: Status, present: Callable[[], int], left_out: Collection[int] = (), axes: int = 3
    ) -> None:
        self.status = status
        self.present = present
        self.left_out, self._axes = left_out, axes
        self._expected = 1
        self.reached = 0
        self.heard: dict[int, int] = {}
        self._truth: dict[int, list[float]] = {}
        self._errors: dict[int, list[float | None]] = {}
        self._links: dict[int, tuple[int, int]] = {}
        self._waiting: dict[str, list[tuple[str, bytes]]] = {"truth": [], "estimate": []}
        self._bytes = 0

    def note_slow(self, process: str) -> None:
        """A process of the run has said that it does not keep up."""
        if process not in self.status.slow:
            self.status.slow.append(process)

    def see(self, kind: str, key: str, messages: Sequence[bytes]) -> None:
        """Take truth or estimate messages of a key into account, with others at the next `catch_up`, or when many wait.

        To read many at once takes a fraction of the time.
        """
        waiting = self._waiting[kind]
        waiting += [(key, data) for data in messages]
        self._bytes += sum(map(len, messages))
        if len(self._waiting["truth"]) > _MOST_TRUTHS or self._bytes > _MOST_BYTES:
            self.catch_up()

    def catch_up(self) -> None:
        """Read what waits."""
        waiting, self._waiting, self._bytes = self._waiting, {"truth": [], "estimate": []}, 0
        # At the end all processes have left before their last words are read.
        self._expected = self.present() or self._expected
        for _, truth in self._read(TRUTH, waiting["truth"]):
            self._see_truth(truth)
        for agent, estimate in self._read(ESTIMATE, waiting["estimate"], _READ):
            self._see_estimate(agent, estimate)

    def _read(
        self, kind: Kind[M], waiting: Sequence[tuple[str, bytes]], names: Collection[str] | None = None
    ) -> Iterator[tuple[int, M]]:
        """The agent of the key, and the message, of all that are as promised."""
        try:
            found = decode_all(kind, [data for _, data in waiting], run=self.status.run, names=names)
        except BadMessage:
            for one in waiting if len(waiting) > 1 else ():
                yield from self._read(kind, [one], names)
            return
        for (key, _), message in zip(waiting, found, strict=True):
            at = address(key)
            if at is not None and message["from"] == at.owner:
                yield at.agent, message

    def _see_truth(self, message: TruthMessage) -> None:
        self._truth[message["k"]] = message["state"]
        if len(self._truth) > _KEPT:
            # An agent that is there and says nothing would have all of them kept.
            self._forget(min(self._truth))

    def _see_estimate(self, agent: int, message: EstimateMessage) -> None:
        step = message["k"]
        self.status.began = True
        self.reached = max(self.reached, min(step, self.status.steps))
        self.heard[agent] = max(self.heard.get(agent, 0), step)
        self._links[agent] = (sum(message["lost"]), sum(message["late"]))
        truth = self._truth.get(step)
        if truth is None:
            self._go_on_without_truth()
            return
        errors = self._errors.setdefault(step, [])
        apart = [a - b for a, b in zip(message["state"][: self._axes], truth[: self._axes], strict=True)]
        # A forged estimate can be too far off for its square: a product is infinite then, where a power would raise.
        errors.append(None if agent in self.left_out else sum(one * one for one in apart))
        if len(errors) >= self._expected:
            self.status.step = step
            counted = [one for one in errors if one is not None]
            self.status.error = math.sqrt(sum(counted) / len(counted)) if counted else None
            self._count_links()
            self._forget(step)

    def _go_on_without_truth(self) -> None:
        """Where no truth is known any more, a step is done when all agents have told their estimates of it.

        A target can be ahead of agents that are too slow for more steps than are kept.
        """
        done = min(self.heard.values()) if len(self.heard) >= self._expected else 0
        if self.status.step < done < min(self._truth, default=done + 1):
            self.status.step = min(done, self.status.steps)
            if self._truth:
                self.status.error = None
            self._count_links()

    def _count_links(self) -> None:
        self.status.lost = sum(lost for lost, _ in self._links.values())
        self.status.late = sum(late for _, late in self._links.values())

    def _forget(self, step: int) -> None:
        for old in [known for known in self._truth if known <= step]:
            del self._truth[old]
            self._errors.pop(old, None)
