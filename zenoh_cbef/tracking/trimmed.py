"""Averaging that up to F wrong neighbours cannot mislead for long: W-MSR."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.consensus import Average


@dataclass
class TrimmedComponents(Average):
    """W-MSR of LeBlanc, Zhang, Koutsoukos, Sundaram (IEEE JSAC 31(4), 2013), component by component.

    In every round and for every component an agent leaves out the F largest of its neighbours' values that are
    larger than its own (all of them, if there are fewer), and likewise the F smallest. The weight of what is left
    out goes to its own value. Every component stays within the range of the honest agents' values.

    weights: (n, m), zero where padded. trim: F.
    """

    trim: int

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """One round."""
        own = self._value[:, None, :]
        arrived = np.broadcast_to(_arrived(self.weights, delivered)[:, :, None], received.shape)
        above, below = arrived & (received > own), arrived & (received < own)
        kept = arrived & ~_largest(received, above, self.trim) & ~_largest(-received, below, self.trim)
        return super().mix(received, kept)


@dataclass
class TrimmedMessages(Average):
    """W-MSR on whole messages: an agent leaves out the F neighbours that are farthest from its own value.

    If an agent trimmed each component of an information vector and matrix by itself, it would combine parts of
    different agents' messages into one that no agent sent. Leaving out whole messages, by distance as in
    Kuwaranancharoen, Xin, Sundaram (ACC 2020), keeps the result a convex combination of messages. A wrong message that
    stays is no farther away than some honest one, which bounds its effect.

    weights: (n, m), zero where padded. trim: F. distance: of messages (n, m, d) from the own (n, d), (n, m).
    """

    trim: int
    distance: Callable[[Floats, Floats], Floats]

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """One round."""
        arrived = _arrived(self.weights, delivered)
        # What did not arrive may hold anything.
        distance = self.distance(self._value, np.where(arrived[:, :, None], received, self._value[:, None, :]))
        kept = arrived & ~_largest(distance, arrived, self.trim)
        return super().mix(received, kept)


def _arrived(weights: Floats, delivered: Bools | None) -> Bools:
    present = weights > 0.0
    return present if delivered is None else present & delivered


def _largest(values: Floats, among: Bools, count: int) -> Bools:
    """Which of `values` are the `count` largest along axis 1 of those `among` them; of equals the first."""
    order = np.argsort(np.where(among, -values, np.inf), axis=1, kind="stable")
    chosen = np.zeros(values.shape, dtype=bool)
    np.put_along_axis(chosen, order[:, :count], True, axis=1)  # noqa: FBT003 - the values to put
    return chosen & among
