"""Whether to rely on an estimated bias of the ranges: two filters side by side, weighed by their innovations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from zenoh_cbef.tracking.filters.around.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.base import Belief, Bias, Filter, Floats, Update
from zenoh_cbef.tracking.linalg import outer
from zenoh_cbef.tracking.ranging import Measurement

LARGEST = 4.0
"""Where a NIS is cut off, so that outliers, which neither filter explains, do not decide."""

MEMORY, BEGIN = 2000.0, 50.0
"""How many of the network's ranges the weighing remembers, and how many consistent ones it begins with."""

_INCONSISTENT = (0.8, 1.0)
"""Mean cut NIS of the plain filter from which on it is doubted, and at which it is fully; 0.92 for Gaussian noise."""

_EXPLAINED = (1.05, 1.25)
"""How many times the biased filter's NIS the plain filter's must be, likewise, for the bias to explain the excess."""


@dataclass(frozen=True)
class AutoBias:
    """The filter without bias states and the one with them, on the same ranges, in one payload.

    Estimating biases costs accuracy where geometry hardly shows them, and the covariance does not reveal that, as real
    biases are not quite constant. The innovations do: a bias that geometry shows makes the innovations of the plain
    filter too large; the position absorbs one that geometry does not show, and the innovations stay right. So an agent
    keeps the simpler filter as long as it is consistent, and relies on the other as far as that explains the excess:

        e_0, e_1: mean NIS of the plain and of the biased filter over the network's last couple of thousand ranges
        weight = step(e_0; 0.8, 1) step(e_0/e_1; 1.05, 1.25),  step(x; a, b): smooth, 0 up to a and 1 from b on

    The means run over the network: sums of NIS and of ranges are three numbers more in the payload. Each filter runs
    as if alone; only the two results are combined, as a mixture of two Gaussians, so the estimate does not jump.
    """

    plain: Filter
    biased: BiasedInformation

    more: ClassVar[int] = 3
    """Two NIS and how many ranges there were, after both filters' payloads."""

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Both filters' updates; the innovation that is reported is that of the filter with more weight."""
        parts = belief.parts or (belief, belief)
        plain, biased = self.plain.update(parts[0], measurement), self.biased.update(parts[1], measurement)
        sums = belief.memory[0] if belief.memory else np.full((len(belief.state), 3), BEGIN)
        measured = np.isfinite(measurement.range)
        counts = np.stack([_cut(plain), _cut(biased), measured.astype(np.float64)], axis=1)
        chosen = _weight(sums) > 0.5
        return Update(
            np.concatenate([plain.payload, biased.payload, counts], axis=1),
            plain.diagnostics.chosen(chosen, biased.diagnostics),
            (sums,),
            (plain, biased),
        )

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The mixture of both beliefs."""
        split = update.parts[0].payload.shape[1]
        plain = self.plain.conclude(np.ascontiguousarray(payload[:, :split]), update.parts[0])
        biased = self.biased.conclude(np.ascontiguousarray(payload[:, split:-3]), update.parts[1])
        # Averages times n are the network's sums. Accelerated averaging may leave a count a little below zero.
        new = self.biased.network_size * np.maximum(payload[:, -3:], 0.0)
        sums = np.exp(-new[:, 2:] / MEMORY) * update.kept[0] + new
        weight = _weight(sums)
        return Belief(
            *mixed(plain, biased, weight),
            Bias(_bias(biased).value, _bias(biased).std, weight),
            (sums,),
            (plain, biased),
        )


def mixed(plain: Belief, biased: Belief, weight: Floats) -> tuple[Floats, Floats]:
    """Mean (n, s) and covariance (n, s, s) of a mixture of two Gaussians; weight: (n,), of the second."""
    apart, second = biased.state - plain.state, weight[:, None, None]
    first = plain.known_covariance
    covariance = first + second * (biased.known_covariance - first) + second * (1.0 - second) * outer(apart, apart)
    return plain.state + weight[:, None] * apart, covariance


def weight_of(plain: Floats, biased: Floats) -> Floats:
    """Weight of the biased filter for mean NIS of both, arrays of one shape."""
    return _step(plain, *_INCONSISTENT) * _step(plain / biased, *_EXPLAINED)


def _step(value: Floats, low: float, high: float) -> Floats:
    """0 up to low, 1 from high on, a cubic between them."""
    way = np.clip((value - low) / (high - low), 0.0, 1.0)
    return np.asarray(way * way * (3.0 - 2.0 * way))


def _weight(sums: Floats) -> Floats:
    return weight_of(sums[:, 0] / sums[:, 2], sums[:, 1] / sums[:, 2])


def _cut(update: Update) -> Floats:
    return np.minimum(np.nan_to_num(update.diagnostics.nis), LARGEST)


def _bias(belief: Belief) -> Bias:
    if belief.bias is None:
        raise ValueError("a belief without a bias")
    return belief.bias
