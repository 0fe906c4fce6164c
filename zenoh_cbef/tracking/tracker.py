"""One step of a batch of agents: measure, exchange for some rounds, conclude. No clock, socket or thread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.consensus import Consensus
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.wrapping import resumed
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.isolating import Isolating
from zenoh_cbef.tracking.moderation import (
    LARGEST,
    immoderate,
    immoderate_belief,
    is_moderate,
    is_within,
)
from zenoh_cbef.tracking.newcomer import merged
from zenoh_cbef.tracking.ranging import Measurement, Space, unheard
from zenoh_cbef.tracking.triggered import Triggered


@dataclass(frozen=True)
class Estimate:
    """A step's result: state (n, 6), covariance (n, 6, 6) or None, and the agents' diagnostics, (n,) each.

    refused: (n,), which agents refused the update, as its result was not finite or too large, and use the prediction.
    """

    state: Floats
    covariance: Floats | None
    diagnostics: Diagnostics
    refused: Bools


class Tracker:
    """The filter and its consensus stage, step after step. The caller carries the messages.

    A step is `measure`, then as many `exchange` as there are rounds, then `conclude`. What `measure` and
    `exchange` return is what every agent of the batch sends in the coming round, (n, d). `exchange` takes one round's
    messages (n, m, d), of which some were delivered (n, m), None for all.

    overcounted: (n,), how often n times an agent's average counts a range that the network has once; None: once.

    Forged messages can make a step overflow. The tracker finds that in its results, so its callers keep NumPy from
    warning of it (np.errstate).
    """

    def __init__(
        self, filter_: Filter, consensus: Consensus, space: Space, initial: Belief, overcounted: Floats | None = None
    ) -> None:
        self.filter = filter_
        self.consensus, self.exchange = consensus, consensus.mix
        self.space = space
        self.belief = initial
        self._overcounted = None if overcounted is None or (overcounted == 1.0).all() else overcounted
        self._update: Update | None = None
        self._newcomers: tuple[Belief, Bools] | None = None
        self._none = self._refused = np.zeros(len(initial.state), dtype=bool)

    def adopt(self, belief: Belief, rows: Bools) -> None:
        """Let some agents (n,) begin the next step with a belief that is not their own."""
        self._newcomers = resumed(self.filter, belief), rows

    def measure(self, measurement: Measurement) -> Floats:
        """Begin a step with what was measured; returns the first consensus message."""
        if self._overcounted is not None:
            measurement = replace(measurement, overcounted=self._overcounted)
        self._measurement, self._refused = measurement, self._none
        update = self._begin(measurement)
        if not is_within(LARGEST, update.payload):
            update, self._refused = self._without(update, immoderate(update.payload))
        self._update = update
        if isinstance(self.consensus, Isolating):
            self.consensus.look(*self._begun(), update.diagnostics.nis)
        return self.consensus.start(update.payload)

    def _begun(self) -> tuple[Belief, Bools]:
        """The belief that the step began with, and which agents (n,) have it from others."""
        if self._newcomers is None:
            return self.belief, np.zeros(len(self.belief.state), dtype=bool)
        belief, rows = self._newcomers
        known = np.where(rows[:, None, None], belief.known_covariance, self.belief.known_covariance)
        return Belief(np.where(rows[:, None], belief.state, self.belief.state), known), rows

    def _begin(self, measurement: Measurement) -> Update:
        if self._newcomers is None:
            return self.filter.update(self.belief, measurement)
        belief, rows = self._newcomers
        begun = self.filter.update(belief, measurement)
        # An agent that comes late has no former belief, only the initial one, which asks for a first fix.
        return begun if rows.all() else merged(self.filter.update(self.belief, measurement), begun, rows)

    def conclude(self) -> Estimate:
        """End the step. Agents whose result is immoderate take back what they measured and heard."""
        if self._update is None:
            raise RuntimeError("conclude() comes after measure()")
        update, mixed = self._update, self.consensus.result()
        if not is_within(LARGEST, mixed):
            update, wild = self._without(update, immoderate(mixed))
            mixed = np.where(wild[:, None], update.payload, mixed)
            self._refused = self._refused | wild
        belief = self.filter.conclude(mixed, update)
        if not is_moderate(belief):
            belief, update = self._predicted(belief, update)
        self.belief, self._newcomers = belief, None
        covariance, bias, diagnostics = belief.covariance, belief.bias, update.diagnostics
        if isinstance(self.consensus, Isolating):
            diagnostics = replace(diagnostics, isolated=self.consensus.judge())
        if isinstance(self.consensus, Triggered):
            diagnostics = replace(diagnostics, silent=self.consensus.silent)
        if bias is not None:
            diagnostics = replace(diagnostics, bias=bias.value, bias_std=bias.std, bias_weight=bias.weight)
        if (status := belief.status) is not None:
            diagnostics = replace(diagnostics, status=status.which, status_seconds=status.seconds)
        if (excess := self.belief.excess) is not None:
            diagnostics = replace(diagnostics, excess=excess)
        return Estimate(
            self.space.embed_state(belief.state),
            None if covariance is None else self.space.embed_covariance(covariance),
            diagnostics,
            self._refused,
        )

    def _predicted(self, belief: Belief, update: Update) -> tuple[Belief, Update]:
        """What the step leaves, where that is immoderate a prediction."""
        wild = immoderate_belief(belief)
        nothing = self._begin(unheard(self._measurement))
        predicted = self.filter.conclude(nothing.payload, nothing)
        # Where the prediction is not finite either, the scenario diverges by itself.
        wild &= ~immoderate_belief(predicted)
        self._refused = self._refused | wild
        return chosen(belief, predicted, wild), merged(update, nothing, wild)

    def _without(self, update: Update, rows: Bools) -> tuple[Update, Bools]:
        """An update in which some agents (n,) have heard nothing, and for which of them that gives a finite result."""
        nothing = self._begin(unheard(self._measurement))
        better = rows & ~immoderate(nothing.payload)
        return merged(update, nothing, better), better
