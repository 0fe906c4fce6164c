"""Whether to rely on an estimated bias of the ranges: two filters side by side, weighed by their innovations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.evidence import MEMORY, Evidence
from zenoh_cbef.tracking.filters.base import Belief, Bias, Filter, Sharing, Update
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.linalg import outer
from zenoh_cbef.tracking.ranging import Measurement


@dataclass(frozen=True)
class AutoBias:
    """The filter without bias states and the one with them, on the same ranges, in one payload.

    Estimating biases costs accuracy where geometry hardly shows them, and the covariance does not reveal that, as real
    biases are not quite constant. The innovations do: a bias that geometry shows makes the innovations of the plain
    filter too large; the position absorbs one that geometry does not show, and the innovations stay right. So an agent
    relies on the biased filter as far as that predicted the network's last couple of thousand ranges better, see
    `Evidence`.

    The sums of the evidence run over the network: they are three or five numbers more in the payload. Each filter runs
    as if alone; only the two results are combined, as a mixture of two Gaussians, so the estimate does not jump.

    The filter with biases may be such a pair itself: of one without and one with a share by which all ranges are too
    long. Where biases explain ranges as well, that share only takes information from them.
    """

    plain: Filter
    biased: BiasedInformation | JointBiases | AutoBias
    evidence: Evidence = field(default_factory=Evidence)

    @property
    def network_size(self) -> int:
        """How many agents there are."""
        return self.biased.network_size

    @classmethod
    def sharing(cls, plain: Sharing, biased: Sharing, evidence: Evidence) -> Sharing:
        """What agents exchange that do both: the evidence after both filters' payloads."""
        return replace(plain.longer(biased.payload_size + evidence.numbers), blocks=plain.blocks + biased.blocks)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Both filters' updates; the innovation that is reported is that of the filter with more weight."""
        parts = belief.parts or (belief, belief)
        plain, biased = self.plain.update(parts[0], measurement), self.biased.update(parts[1], measurement)
        sums = belief.memory[0] if belief.memory else self.evidence.begun(len(belief.state))
        first, second = ((one.diagnostics.innovation, one.diagnostics.nis) for one in (plain, biased))
        counts = self.evidence.of(first, second, measurement.alike)
        chosen = self.evidence.weight(sums) > 0.5
        return Update(
            np.concatenate([plain.payload, biased.payload, counts], axis=1),
            plain.diagnostics.chosen(chosen, biased.diagnostics),
            (sums,),
            (plain, biased),
        )

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The mixture of both beliefs."""
        split, sums_at = update.parts[0].payload.shape[1], payload.shape[1] - self.evidence.numbers
        plain = self.plain.conclude(np.ascontiguousarray(payload[:, :split]), update.parts[0])
        biased = self.biased.conclude(np.ascontiguousarray(payload[:, split:sums_at]), update.parts[1])
        # Averages times n are the network's sums. Accelerated averaging may leave a count a little below zero.
        new = self.network_size * np.maximum(payload[:, sums_at:], self.evidence.least)
        sums = np.exp(-new[:, 2:3] / MEMORY) * update.kept[0] + new
        weight = self.evidence.claimed(sums, self.network_size)
        return Belief(
            *mixed(plain, biased, weight),
            _mixed_bias(plain, biased, weight),
            (sums,),
            (plain, biased),
        )


def mixed(plain: Belief, biased: Belief, weight: Floats) -> tuple[Floats, Floats]:
    """Mean (n, s) and covariance (n, s, s) of a mixture of two Gaussians; weight: (n,), of the second."""
    apart, second = biased.state - plain.state, weight[:, None, None]
    first = plain.known_covariance
    covariance = first + second * (biased.known_covariance - first) + second * (1.0 - second) * outer(apart, apart)
    return plain.state + weight[:, None] * apart, covariance


def _mixed_bias(plain: Belief, biased: Belief, weight: Floats) -> Bias:
    """What agents take for their biases, and how far the state relies on these, weight: (n,) of the second filter."""
    second, first = biased.bias, plain.bias
    if second is None:
        raise ValueError("a belief without a bias")
    if first is None:
        return replace(second, weight=weight)
    apart = second.value - first.value
    variance = (1.0 - weight) * first.std**2 + weight * second.std**2 + weight * (1.0 - weight) * apart**2
    share = first.share + weight * (second.share - first.share)
    return Bias(first.value + weight * apart, np.sqrt(variance), first.weight, share)
