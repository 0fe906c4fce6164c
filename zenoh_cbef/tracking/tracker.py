"""One step of a batch of agents: measure, exchange for some rounds, conclude. No clock, socket or thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.consensus import Consensus
from zenoh_cbef.tracking.filters.base import Belief, Bias, Filter, Update
from zenoh_cbef.tracking.filters.wrapping import resumed
from zenoh_cbef.tracking.newcomer import merged
from zenoh_cbef.tracking.ranging import Measurement, Space

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Estimate:
    """A step's result: state (n, 6), covariance (n, 6, 6) or None; innovation, weight, nis, nis_degrees (n,).

    distrust: (n,), how far the agent distrusted its range, from 0 to 1; NaN for a filter that always trusts.
    bias: (n, 3), of the agent's ranges: value, std (m) and weight, see filters.base.Bias; NaN where there is none.
    """

    state: Floats
    covariance: Floats | None
    innovation: Floats
    weight: Floats
    nis: Floats
    nis_degrees: Ints
    distrust: Floats
    bias: Floats


class Tracker:
    """The filter and its consensus stage, step after step. The caller carries the messages.

    A step is `measure`, then as many `exchange` as there are rounds, then `conclude`. What `measure` and
    `exchange` return is what every agent of the batch sends in the coming round, (n, d).
    """

    def __init__(self, filter_: Filter, consensus: Consensus, space: Space, initial: Belief) -> None:
        self.filter = filter_
        self.consensus = consensus
        self.space = space
        self.belief = initial
        self._update: Update | None = None
        self._newcomers: tuple[Belief, Bools] | None = None

    def adopt(self, belief: Belief, rows: Bools) -> None:
        """Let some agents (n,) begin the next step with a belief that is not their own."""
        self._newcomers = resumed(self.filter, belief), rows

    def measure(self, measurement: Measurement) -> Floats:
        """Begin a step with what was measured; returns the first consensus message."""
        self._update = self.filter.update(self.belief, measurement)
        if self._newcomers is not None:
            belief, rows = self._newcomers
            self._update = merged(self._update, self.filter.update(belief, measurement), rows)
            self._newcomers = None
        return self.consensus.start(self._update.payload)

    def exchange(self, received: Floats, delivered: Bools | None) -> Floats:
        """Take in one round's messages (n, m, d), of which some were delivered (n, m), None for all."""
        return self.consensus.mix(received, delivered)

    def conclude(self) -> Estimate:
        """End the step."""
        if self._update is None:
            raise RuntimeError("conclude() comes after measure()")
        self.belief = self.filter.conclude(self.consensus.result(), self._update)
        covariance, update = self.belief.covariance, self._update
        count = len(self.belief.state)
        return Estimate(
            self.space.embed_state(self.belief.state),
            None if covariance is None else self.space.embed_covariance(covariance),
            update.innovation,
            update.weight,
            np.full(count, np.nan) if update.nis is None else update.nis,
            np.zeros(count, dtype=np.int64) if update.nis_degrees is None else update.nis_degrees,
            np.full(count, np.nan) if update.distrust is None else update.distrust,
            _bias_columns(self.belief.bias, count),
        )


def _bias_columns(bias: Bias | None, count: int) -> Floats:
    if bias is None:
        return np.full((count, 3), np.nan)
    return np.stack([bias.value, bias.std, bias.weight], axis=1)
