"""What every filter is: it turns a measurement into a payload, and a mixed payload back into a belief."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.ranging import Measurement

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class Bias:
    """What an agent estimates of the constant error of its own ranges, arrays (n,).

    value, std: m. weight: how far the state relies on it, from 0 (the ranges are taken as they are) to 1.
    """

    value: Floats
    std: Floats
    weight: Floats


@dataclass(frozen=True)
class Belief:
    """State (n, s) with covariance (n, s, s); a filter without a covariance carries None.

    bias: of the agent's ranges, None for a filter that does not estimate it. memory: arrays (n, ...), and parts:
    beliefs, that a filter carries to the next step beyond its state; a belief without them is an initial one.
    """

    state: Floats
    covariance: Floats | None
    bias: Bias | None = None
    memory: tuple[Floats, ...] = ()
    parts: tuple[Belief, ...] = ()

    @property
    def known_covariance(self) -> Floats:
        """The covariance, for those who cannot do without."""
        if self.covariance is None:
            raise ValueError("a belief without a covariance")
        return self.covariance


@dataclass(frozen=True)
class Update:
    """A filter's local update.

    payload: (n, d), what the consensus stage mixes. innovation: (n,), size of the innovation (NaN where nothing
    was measured). weight: (n,), the saturation gain in (0, 1] that was applied (NaN likewise). kept: arrays (n, ...)
    that the filter needs to conclude and tells nobody. nis: (n,), the innovation squared in units of the covariance
    that the filter predicted for it, before saturation (NaN likewise), and nis_degrees: (n,), its degrees of freedom;
    None for a filter without covariance. distrust: (n,), how far the range was distrusted, from 0 to 1; None for a
    filter that always trusts. parts: the updates of the filters that a filter is made of.
    """

    payload: Floats
    innovation: Floats
    weight: Floats
    kept: tuple[Floats, ...] = ()
    nis: Floats | None = None
    nis_degrees: Ints | None = None
    distrust: Floats | None = None
    parts: tuple[Update, ...] = ()


class Filter(Protocol):
    """One estimation filter for a batch of agents. The consensus stage knows nothing of it."""

    @property
    def payload_size(self) -> int:
        """Length d of the payload vector."""

    @property
    def uses_neighbour_ranges(self) -> bool:
        """Whether agents need their neighbours' positions and ranges before the update."""

    @property
    def cooperates(self) -> bool:
        """Whether payloads are exchanged with neighbours at all."""

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Predict one step and take in the measurement."""

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """Turn the payload that consensus left back into a belief; update: what the step began with."""
