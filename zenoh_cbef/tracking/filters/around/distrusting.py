"""An agent distrusts its own receiver while its ranges stay implausible."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.around.evidence import step
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.ranging import Measurement

LARGEST = 9.0
"""Where a NIS is cut off, so that a single outlier does not decide: three standard deviations."""

MEMORY = 5.0
"""How many of its own ranges an agent remembers."""

EXCESS = (3.0, 5.0)
"""By how much the mean cut NIS must be above the network's for distrust to begin, and for it to be full."""

KEPT = 0.9
"""How much of an agent's distance from the network's average is kept from step to step."""

WIDEST = 30.0
"""Factor of sigma at full distrust."""

CALM = 0.1
"""Distrust from which on an agent's ranges teach nothing of others."""

REPEATS = 5
"""How often in a row an agent may measure the very same range; noise alone makes each another one."""


@dataclass(frozen=True)
class Distrusting(Wrapping):
    """Any filter of information on own ranges, with one number more in its payload: how implausible its ranges are.

        S_i = H P_i H^T + sigma^2                           as if the range were trusted
        e_i <- e_i + (min(z_i^2/S_i, 9) - e_i)/5            where a range was measured; at first 1
        m_i <- average of e_j + 0.9 (m_j - former e_j)      over the network, as far as rounds reach
        d_i = step(e_i - max(m_i, 1); 3, 5)                 step(x; a, b): smooth, 0 up to a and 1 from b on
        sigma_i = (1 + 29 d_i^2) sigma                      in the next step

    Saturation bounds what a single wrong range can do, but one that is wrong in every step pulls in every step. An
    agent cannot tell alone whether its ranges are wrong or its estimate is. The network can: a wrong estimate
    makes the ranges of all agents implausible, and then no agent stands out. So an agent distrusts itself only as far
    as its e is above the others', and one that hears no neighbour stops to. One round does not reach all agents, but m
    is averaged over steps too: dynamic average consensus (Zhu and Martinez, Automatica 46(2), 2010), with a leak for
    lost messages. e is that of a trusted range, so distrust does not increase itself, and ends when ranges are
    plausible again.

    A receiver that is stuck is wrong by little at first, and the estimate follows it: its ranges stay plausible. But it
    says the same to the last bit, step after step, which no receiver with noise does. From its fifth repetition on a
    range is distrusted in full, d_i = 1.

    range_std: sigma (m), unless the measurement says otherwise. repeats: whether repetitions count. silence: after so
    many steps without a range e of an agent goes to m, a fifth of the way in a step; 0: never. Otherwise it counts for
    one whose ranges fit, and if the target turns, the few agents that hear it stand out among many that do not.
    """

    range_std: float
    repeats: bool = False
    silence: int = 0

    more = 1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with the noise that the distrust so far asks for, and the number."""
        inner = belief.parts[0] if belief.parts else belief
        count = len(belief.state)
        ones, none = np.ones(count), np.zeros(count)
        before, network, latest, repeated, since = belief.memory or (ones, ones, none, none, none)
        distrust = step(before - np.maximum(network, 1.0), *EXCESS)
        heard = np.isfinite(measurement.range)
        repeated = np.where(measurement.range == latest, repeated + 1.0, np.where(heard, 0.0, repeated))
        latest = np.where(heard, measurement.range, latest)
        if self.repeats:
            distrust = np.where(repeated >= REPEATS, 1.0, distrust)
        std = np.full(count, self.range_std) if measurement.range_std is None else measurement.range_std
        wide = (1.0 + (WIDEST - 1.0) * distrust * distrust) * std
        update = self.filter.update(inner, replace(measurement, range_std=wide, distrust=distrust))
        nis = trusted_nis(update.diagnostics, wide**2 - std**2)
        since = np.where(heard, 0.0, since + 1.0)
        unheard = np.where(since > self.silence, network, before) if self.silence else before
        mean = before + (np.where(np.isfinite(nis), np.minimum(nis, LARGEST), unheard) - before) / MEMORY
        number = mean + KEPT * (network - before)
        payload = np.concatenate([update.payload, number[:, None]], axis=1)
        return Update(
            payload, replace(update.diagnostics, distrust=distrust), (mean, latest, repeated, since), (update,)
        )

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief."""
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :-1]), update.parts[0])
        mean, *ranges = update.kept
        return replace(inner, memory=(mean, payload[:, -1].copy(), *ranges), parts=(inner,), chance=None)


def trusted_nis(told: Diagnostics, added: Floats) -> Floats:
    """NIS (n,) without the variance (n,), m^2, that was added to the range's; NaN where nothing was measured."""
    square = told.innovation**2
    usable = told.nis > 0.0
    predicted = square / np.where(usable, told.nis, 1.0) - added
    return np.where(usable, square / np.where(usable, predicted, 1.0), told.nis)
