"""Agents that are cut off from the others count their ranges as often as they have them, and no more."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around import roll_call
from zenoh_cbef.tracking.filters.around.returning import FEW_BEND, widened
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement, unheard


@dataclass(frozen=True)
class CutOff(Wrapping):
    """Any filter of the network's information, with a number more in its payload for each agent: whether it is there.

        g_i: of how many agents an agent knows that they are (see `roll_call`)
        V, O <- g/n (V, O) + (1 - g/n) (V0, O0)       V0, O0: the payload without a range, the prior's n-th part

    Averages are taken for the n-th part of the network's information. In a group of g agents that no message of the
    others reaches, n times the average holds each of its ranges n/g times: that group would be too sure of itself. Its
    priors are the whole network's, so they stay as they are.

    A group of fewer agents than there are axes cannot tell where the target is. What it does not see drifts, and with
    it the directions of its ranges, each of which then seems to tell of more than it does. So the variance of such a
    range has twenty times what linearising leaves out (see `Returning`), an agent's that is alone a hundred times
    (settings.alone_bend), and such ranges do not count for the status: the group coasts. Of a target that turns, the
    group knows too little even so: it goes on by prediction.

    Agents that tell each other their ranges count each once anyway, and of a few ranges they keep many hypotheses
    (settings.splits): then the number only tells the status.

    By the eleventh rules (settings.presumes) agents took all others to be there before the first step. From the twelfth
    to the nineteenth (no settings.alone_bend) one that heard no neighbour went on by prediction.
    """

    settings: FilterSettings

    @classmethod
    def numbers(cls, settings: FilterSettings) -> int:
        """How many numbers a payload has more."""
        return settings.network_size if settings.cut_off else 0

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and what the agent knows of the others."""
        count, agents = len(belief.state), self.settings.network_size
        inner = belief.parts[0] if belief.parts else belief
        known, share = belief.memory or (np.full((count, agents), float(self.settings.presumes)), np.ones(count))
        apart, few = np.count_nonzero(share < 1.0), self._few(share)
        if np.count_nonzero(few):
            if not self.settings.splits:
                heard = self.settings.space, inner, measurement, self.settings.range_std
                times = np.where(self._alone(share), self.settings.alone_bend or FEW_BEND, FEW_BEND)
                measurement = widened(few, *heard, times=times)
            measurement = replace(measurement, few=few)
        update = self.filter.update(inner, measurement)
        nothing = replace(unheard(measurement), forgets=self.settings.joins_fix)
        quiet = self.filter.update(inner, nothing).payload if apart else update.payload
        if measurement.agent is None:
            raise ValueError("agents that may be cut off have numbers")
        told = roll_call.told(known, measurement.agent)
        payload = np.concatenate([update.payload, told], axis=1)
        return Update(payload, update.diagnostics, (share, quiet), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, from the information that its group has."""
        (share, quiet), before = update.kept, update.parts[0]
        agents = self.settings.network_size
        mixed, known = np.ascontiguousarray(payload[:, :-agents]), roll_call.known_of(payload[:, -agents:])
        there = roll_call.count(known, self.settings.cut_off) / agents
        # Those that come back are heard at once, those that go only fade.
        share = np.maximum(share, there)
        if np.count_nonzero(share < 1.0) and not self.settings.splits:
            part = share[:, None]
            alone = self._alone(share) & (self.settings.alone_bend is None and not self.settings.presumes)
            predicts = self._few(share) if self.settings.models else alone
            mixed = np.where(part < 1.0, part * mixed + (1.0 - part) * quiet, mixed)
            mixed = np.where(predicts[:, None], before.payload, mixed)
        inner = self.filter.conclude(mixed, before)
        return Belief(
            inner.state, inner.covariance, inner.bias, (known, there), (inner,), inner.status, excess=inner.excess
        )

    def _few(self, share: Floats) -> Bools:
        """Which agents (n,) are in a group of fewer than there are axes; share: of all agents, (n,)."""
        return np.asarray(share * self.settings.network_size < self.settings.space.axes - 0.5)

    def _alone(self, share: Floats) -> Bools:
        """Which agents (n,) are in no group."""
        return np.asarray(share * self.settings.network_size < 1.5)
