"""What every filter is: it turns a measurement into a payload, and a mixed payload back into a belief."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, cast

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import Status


@dataclass(frozen=True)
class Bias:
    """What an agent estimates of the lasting error of its own ranges, where its estimate is; arrays (n,).

    value, std: m. weight: how far the state relies on it, from 0 (the ranges are taken as they are) to 1. share: what
    part of the distance is in it, as all ranges are too long by that.
    """

    value: Floats
    std: Floats
    weight: Floats
    share: Floats

    @classmethod
    def constant(cls, value: Floats, std: Floats) -> Self:
        """One that is the same at any distance, and relied on."""
        return cls(value, std, np.ones(len(value)), np.zeros(len(value)))

    def taken_off(self, ranges: Floats, distance: Floats, most: float = np.inf) -> Floats:
        """Ranges (n,), m, wherever they were measured, without it; distance: of the target where it was estimated.

        most: from what size on it is beyond belief, m, so that ranges are left as they are.
        """
        constant = self.value - self.share * distance
        without = (ranges - self.weight * constant) / (1.0 + self.weight * self.share)
        return np.where(np.abs(constant) > most, ranges, without)


@dataclass(frozen=True)
class Tie:
    """What an agent's ranges of a first fix say of its bias, in one of two ways."""


@dataclass(frozen=True)
class Tied(Tie):
    """The distribution of its bias d given the state x, N(a + b^T x, s).

    offset: a, (n,), m. slope: b, (n, s). given: s, (n,), m^2.
    """

    offset: Floats
    slope: Floats
    given: Floats


@dataclass(frozen=True)
class Shared(Tie):
    """The agent's part of the network's information on (x, d, s): the state, its bias, m, and a share of all ranges.

    vector: (n, s + 2). matrix: (n, s + 2, s + 2). The prior of d and s is not in it.
    """

    vector: Floats
    matrix: Floats


@dataclass(frozen=True)
class Belief:
    """State (n, s) with covariance (n, s, s); a filter without a covariance carries None.

    bias: of the agent's ranges, None for a filter that does not estimate it. memory: arrays (n, ...), and parts:
    beliefs, that a filter carries to the next step beyond its state; a belief without them is an initial one. status:
    None where agents do not say what their estimate is. chance: (n, M), where the parts are of M motions, how likely
    each is. excess: (n,), by what share the covariance is larger than that which the filter goes on with; None: not at
    all. tied: of a first fix, what the agent's own ranges say of its bias.
    """

    state: Floats
    covariance: Floats | None
    bias: Bias | None = None
    memory: tuple[Floats, ...] = ()
    parts: tuple[Belief, ...] = ()
    status: Status | None = None
    chance: Floats | None = None
    excess: Floats | None = None
    tied: Tie | None = None

    @property
    def known_covariance(self) -> Floats:
        """The covariance (n, s, s). Raises ValueError where the belief has none."""
        if self.covariance is None:
            raise ValueError("a belief without a covariance")
        return self.covariance

    @property
    def known_chance(self) -> Floats:
        """How likely each motion is, (n, M). Raises ValueError where the belief is not of several."""
        if self.chance is None:
            raise ValueError("a belief without several motions")
        return self.chance


@dataclass(frozen=True)
class Update:
    """A filter's local update.

    payload: (n, d), what the consensus stage mixes. diagnostics: (n,) each, what the agent says of the update, nothing
    where it measured nothing. kept: arrays (n, ...) that the filter needs to conclude and keeps to itself. parts: the
    updates of the filters that a filter is made of.
    """

    payload: Floats
    diagnostics: Diagnostics
    kept: tuple[Floats, ...] = ()
    parts: tuple[Update, ...] = ()


@dataclass(frozen=True)
class Abilities:
    """What a kind of filter can do, declared on its class.

    information: its payload is information, of which any convex combination is meaningful. saturates: it saturates
    ranges at xi of their standard deviations. differences: it may take in differences of ranges; other kinds would
    count shared noise more than once. covariance: it knows how far its estimate may be off. biases: it estimates
    biases of ranges, begins with a first fix, and may linearise after averaging. noise: the range noise can be learned
    online around it. models: one for each of several motions may stand side by side, as an update keeps prior state and
    covariance. outliers: it weighs ranges by how outliers are spread of which the scenario tells.
    """

    information: bool = False
    saturates: bool = False
    differences: bool = False
    covariance: bool = True
    biases: bool = False
    noise: bool = False
    models: bool = False
    outliers: bool = False


@dataclass(frozen=True)
class Sharing:
    """What the agents of a filter exchange. Its class tells it, so it is known before any filter is made.

    payload_size: length d of the payload vector. cooperates: whether payloads are exchanged with neighbours at all.
    uses_neighbour_ranges: whether agents need their neighbours' positions and ranges before the update. blocks: sizes s
    of the states of which a payload begins with information, vector and upper triangle of a matrix that is as a rule
    positive definite, block after block; they may travel as integers.
    """

    payload_size: int
    cooperates: bool = True
    uses_neighbour_ranges: bool = False
    blocks: tuple[int, ...] = ()

    def longer(self, numbers: int) -> Sharing:
        """The same with more numbers at the end of a payload."""
        return replace(self, payload_size=self.payload_size + numbers)


class Filter(Protocol):
    """One estimation filter for a batch of agents. The consensus stage knows nothing of it."""

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """Predict one step and take in the measurement."""

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """Turn the payload that consensus left back into a belief; update: what the step began with."""


class Kind(Filter, Protocol):
    """A filter that `filter.kind` names."""

    abilities: ClassVar[Abilities]

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """What agents with the filter of these settings exchange."""

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""


def filter_of(found: type, name: str) -> type[Kind]:
    """A class of another package as a kind of filter. Raises ValueError, to stand after its key, if it is none."""
    members = ("of", "sharing", "update", "conclude")
    lacking = ", ".join(f"{one}()" for one in members if not callable(getattr(found, one, None)))
    if not lacking and not isinstance(getattr(found, "abilities", None), Abilities):
        lacking = "abilities, an Abilities of zenoh_cbef.extending"
    if lacking:
        raise ValueError(f"names {name!r}, which is no filter: it lacks {lacking}; add it, see docs/plugins.md")
    return cast("type[Kind]", found)
