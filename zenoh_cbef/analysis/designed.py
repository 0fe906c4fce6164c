"""What a design tells, as types, which are written as the JSON of `design --json`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

from zenoh_cbef.analysis.demand import Demand
from zenoh_cbef.analysis.mixing import Scheme
from zenoh_cbef.analysis.recommended import Recommended
from zenoh_cbef.analysis.results import Number
from zenoh_cbef.plain import Json
from zenoh_cbef.tracking.compact import Precision


@dataclass(frozen=True)
class Seen:
    """What ranges show of the target: rank and condition of the Gramian, None where singular, and the bound, m."""

    rank: int
    condition: Number
    bound: float


@dataclass(frozen=True)
class Observability:
    """What the network and each agent alone see, over so many steps; dimension: of the state."""

    steps: int
    dimension: int
    network: Seen
    agents: Sequence[Seen]

    def as_json(self) -> dict[str, Json]:
        """The same with the agents' numbers."""
        agents = [{"agent": agent, **vars(one)} for agent, one in enumerate(self.agents)]
        return {**asdict(self), "agents": agents}


@dataclass(frozen=True)
class Expected:
    """Expected errors over the scored window, m and m/s, and the average NEES, None where no covariance is right."""

    position_rmse: float
    velocity_rmse: float
    nees: Number


@dataclass(frozen=True)
class Compared(Expected):
    """The same beside the centralised filter's position RMSE."""

    ratio_to_centralized: float


@dataclass(frozen=True)
class Tried(Compared):
    """What a scheme reaches, and what it costs: bytes of each agent in a step."""

    bytes_per_step: float


@dataclass(frozen=True)
class Configured:
    """The scenario's own scheme and rounds; expected: None where errors cannot be predicted."""

    scheme: Scheme
    rounds: int
    bytes_per_step: float
    expected: Compared | None

    def as_json(self) -> dict[str, Json]:
        """The same with the errors beside the rest."""
        told = asdict(self)
        expected = told.pop("expected") or {}
        return told | expected


@dataclass(frozen=True)
class TriedRounds:
    """What the schemes reach with a number of rounds."""

    rounds: int
    schemes: Mapping[Scheme, Tried]


@dataclass(frozen=True)
class Bytes:
    """Bytes of one consensus message under each scheme, and of all else that an agent publishes in a step."""

    round: Mapping[Scheme, int]
    other: float

    def per_step(self, scheme: Scheme, rounds: int) -> float:
        """What an agent publishes in a step."""
        return float(self.other + rounds * self.round[scheme])


@dataclass(frozen=True)
class Design:
    """What a scenario can be expected to reach.

    skip: steps before the scored window. within: wanted excess of the position RMSE over the centralised filter's.
    spectral_gap: by scheme. cannot: what is left out of account, in sentences. centralized: None, and rounds empty,
    where errors cannot be predicted. smallest: sufficient number of rounds; None where none is found.
    demand: what the configured run asks of its processes. precision: in which numbers payloads travel.
    recommended: settings for a link of so many kbit/s, where the caller asks for them.
    """

    name: str
    filter: str
    precision: Precision
    agents: int
    steps: int
    skip: int
    edges: int
    within: float
    observability: Observability
    spectral_gap: Mapping[Scheme, float]
    bytes: Bytes
    cannot: Sequence[str]
    configured: Configured
    centralized: Expected | None
    rounds: Sequence[TriedRounds]
    smallest: Mapping[Scheme, int | None]
    demand: Demand
    recommended: Recommended | None = None

    def as_json(self) -> dict[str, Json]:
        """The design as `design --json` prints it."""
        told = asdict(self)
        told |= {"observability": self.observability.as_json(), "configured": self.configured.as_json()}
        return told | {"rounds": [{"rounds": one["rounds"], **one["schemes"]} for one in told["rounds"]]}
