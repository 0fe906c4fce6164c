"""An agent learns how often its ranges are wrong, and how often those after wrong ones are, too."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.distrusting import KEPT
from zenoh_cbef.tracking.filters.around.evidence import step
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.outliers import UNTOLD, Untold
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

_USUAL = np.log(3.0)
"""Logarithm of the largest residual that noise explains, in its standard deviations."""

_STANDS_OUT = np.log(2.0), np.log(4.0)
"""By how much that logarithm is above the network's for a range to begin to be wrong, and to be wrong for sure."""

_RANGES = 50.0
"""How many ranges after right ones an agent remembers."""

_FADES = 0.97
"""What each range after a wrong one leaves of the count of those before."""

_LEAST, _MOST = UNTOLD[0], 0.98
"""Between what a range may be likely to be wrong before it is heard."""


@dataclass(frozen=True)
class Bursts(Wrapping):
    """Any filter of information on own ranges, with one number more in its payload: by how much they are off.

        l_i = log max(|r_i - h(x_i)|/sigma_i, 3)              after the step, x_i: what the network agreed on
        m_i <- average of l_j + 0.9 (m_j - former l_j)        over the network, as far as rounds reach
        w_i = step(l_i - m_i; log 2, log 4)                   step(x; a, b): smooth, 0 up to a and 1 from b on
        p_i = (1 - w_i) max(b_i, 0.02) + w_i (1 + s_i)/(2 + n_i)

    An agent cannot tell at a corner whether its range is wrong or the target has turned: a motion that is agile enough
    allows for both, and one wrong range that it takes in moves the estimate by metres. But wrong ranges come in bursts.
    So p_i is how likely the next range is wrong, by a chain of two states (Gilbert, Bell System Technical Journal
    39(5), 1960) of which each agent learns the rates: b_i, the share of its ranges that are wrong after right ones,
    and s_i of n_i that are so after wrong ones, as far as those are remembered. Where every range is wrong by chance
    both rates are alike, and none is suspected for those before it.

    A range is wrong whose residual stands out among the agents'. Where the estimate is off all residuals grow, by its
    error, and none stands out. Their logarithms are averaged, so that a few large ones do not hide each other; for how
    m_i is averaged over steps, too, see `Distrusting`. When the next range comes, the network's average is that of the
    residuals before the last ones, so what rates are learned from is judged a step later, with the average of its own
    step.

    range_std: sigma (m), unless the measurement says otherwise.
    """

    space: Space
    range_std: float

    more = 1

    @classmethod
    def wanted(cls, settings: FilterSettings) -> bool:
        """Whether agents average what several motions say, and weigh ranges by errors that come in bursts."""
        averages = bool(settings.models) and not settings.tells_ranges
        return averages and isinstance(settings.weighed, Untold) and settings.weighed.bursts

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update with how likely the range is wrong, and the number."""
        inner = belief.parts[0] if belief.parts else belief
        none, usual = np.zeros(len(belief.state)), np.full(len(belief.state), _USUAL)
        size, before, network, *learned = belief.memory or (usual, usual, usual, none, none, none, none, none)
        _, _, rare, again, count = learned
        wrong = step(size - network, *_STANDS_OUT)
        share = (1.0 - wrong) * np.maximum(rare, _LEAST) + wrong * (1.0 + again) / (2.0 + count)
        update = self.filter.update(inner, replace(measurement, wrong=np.clip(share, _LEAST, _MOST)))
        number = size + KEPT * (network - before)
        payload = np.concatenate([update.payload, number[:, None]], axis=1)
        std = none + self.range_std if measurement.range_std is None else measurement.range_std
        seen = measurement.position, measurement.range, measurement.age, std
        return Update(payload, update.diagnostics, (size, network, *learned, *seen), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, and what the agent has learned."""
        inner = self.filter.conclude(np.ascontiguousarray(payload[:, :-1]), update.parts[0])
        size, network, fresh, was, rare, again, count, position, ranges, age, std = update.kept
        network = np.where(np.isfinite(payload[:, -1]), payload[:, -1], network)
        # What is judged is the range before this one.
        now = np.where(fresh > 0.0, step(size - network, *_STANDS_OUT), was)
        after, before = fresh * was, fresh * (1.0 - was)
        fades = _FADES**after
        learned = rare + before * (now - rare) / _RANGES, fades * again + after * now, fades * count + after
        distance, _ = own_range(self.space, inner.state, position, age)
        heard = np.isfinite(ranges)
        residual = np.where(heard, np.abs(ranges - distance), 0.0) / std
        latest = np.where(heard, np.maximum(np.log(np.maximum(residual, 1.0)), _USUAL), size)
        memory = latest, size, network, heard.astype(np.float64), now, *learned
        return replace(inner, memory=memory, parts=(inner,), chance=None)
