"""A batch too large for a core's cache, as several trackers that take turns: every agent computes the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.rows import Rows, some, together
from zenoh_cbef.tracking.graph import Neighbours
from zenoh_cbef.tracking.ranging import Measurement, Space
from zenoh_cbef.tracking.tracker import Estimate, Tracker


@dataclass(frozen=True)
class Part:
    """The agents of one tracker: their rows of the batch (p,), and the rows of their neighbours (p, m).

    linked: whether its consensus stage takes what all agents sent.
    """

    tracker: Tracker
    rows: Rows
    neighbours: Neighbours
    linked: bool = False


class Parts:
    """Trackers of parts of a batch, with the interface of one; `exchange` takes the messages that all agents sent."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self._parts = parts
        self._count = sum(len(part.rows) for part in parts)
        self._alone = len(parts) == 1
        self._places = np.argsort(np.concatenate([part.rows for part in parts]))
        # What neighbours sent, laid out neighbour by neighbour.
        self._sources = [np.ascontiguousarray(part.neighbours.index.T) for part in parts if not part.linked]
        self._widths = [part.neighbours.index.shape[1] for part in parts]

    @property
    def space(self) -> Space:
        """Where the target moves."""
        return self._parts[0].tracker.space

    @property
    def belief(self) -> Belief:
        """The beliefs of all agents."""
        if self._alone:
            return self._parts[0].tracker.belief
        return together([part.tracker.belief for part in self._parts], [part.rows for part in self._parts])

    def adopt(self, belief: Belief, rows: Bools) -> None:
        """Let some agents (n,) begin the next step with a belief that is not their own."""
        for part in self._parts:
            part.tracker.adopt(belief if self._alone else some(belief, part.rows), rows[part.rows])

    def measure(self, measurement: Measurement) -> Floats:
        """Begin a step; returns the first consensus messages, (n, d)."""
        if self._alone:
            return self._parts[0].tracker.measure(measurement)
        return self._joined([part.tracker.measure(_some(measurement, part)) for part in self._parts])

    def exchange(self, sent: Floats, delivered: Bools | None) -> Floats:
        """One round: what all agents sent (n, d), of which neighbours get what is delivered (n, m), None for all."""
        if self._alone:
            return self._taken_in(0, sent, delivered)
        following = np.empty_like(sent)
        for place, part in enumerate(self._parts):
            came = None if delivered is None else delivered[part.rows, : self._widths[place]]
            following[part.rows] = self._taken_in(place, sent, came)
        return following

    def _taken_in(self, place: int, sent: Floats, delivered: Bools | None) -> Floats:
        part = self._parts[place]
        if part.linked:
            return part.tracker.exchange(sent, delivered)
        return part.tracker.exchange(
            self._heard(place, sent), part.neighbours.present if delivered is None else delivered
        )

    def _heard(self, place: int, sent: Floats) -> Floats:
        return sent.take(self._sources[place], axis=0).swapaxes(0, 1)

    def conclude(self) -> Estimate:
        """End the step."""
        if self._alone:
            return self._parts[0].tracker.conclude()
        found = [part.tracker.conclude() for part in self._parts]
        said = Diagnostics.of(self._count)
        for part, one in zip(self._parts, found, strict=True):
            said.put(part.rows, one.diagnostics)
        covariances = [one.covariance for one in found if one.covariance is not None]
        return Estimate(
            self._joined([one.state for one in found]),
            self._joined(covariances) if covariances else None,
            said,
            np.concatenate([one.refused for one in found])[self._places],
        )

    def _joined(self, each: Sequence[Floats]) -> Floats:
        """The arrays of all parts, by the rows of the batch."""
        joined = np.empty((self._count, *each[0].shape[1:]), dtype=each[0].dtype)
        for part, values in zip(self._parts, each, strict=True):
            joined[part.rows] = values
        return joined


def _some(measurement: Measurement, part: Part) -> Measurement:
    rows, width = part.rows, part.neighbours.index.shape[1]
    return replace(
        measurement,
        position=measurement.position[rows],
        range=measurement.range[rows],
        age=measurement.age[rows],
        neighbour_position=measurement.neighbour_position[rows, :width],
        neighbour_range=measurement.neighbour_range[rows, :width],
        agent=None if measurement.agent is None else measurement.agent[rows],
    )
