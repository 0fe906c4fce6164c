"""The metrics of a run as types: field by field, name by name and in this order the JSON of `analyze --json`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass

from zenoh_cbef.numbers import number
from zenoh_cbef.plain import Json
from zenoh_cbef.tracking.compact import Precision
from zenoh_cbef.words import counted

Number = float | None
"""None where the run has nothing to compute it from."""

Stretches = list[list[int]]
"""First and last step of each."""


@dataclass(frozen=True)
class Msee:
    """The paper's running mean at the end, m^2 + m^2/s^2: of each agent, and of those that count."""

    agents: list[Number]
    average: Number


@dataclass(frozen=True)
class Scored:
    """Of which agents and steps the errors in the window are, and of which steps those of the centralised filter."""

    agents: list[int]
    steps: Stretches
    centralized_steps: Stretches


@dataclass(frozen=True)
class Yardstick:
    """What a centralised filter or the bound reaches, m and m/s."""

    position_rmse: Number
    velocity_rmse: Number
    msee: Number


@dataclass(frozen=True)
class OverTime:
    """A statistic in stretches of equal length: their ends, s; each one's means of the agents, and share inside."""

    until: list[float]
    agents: list[list[Number]]
    inside: list[Number]


@dataclass(frozen=True)
class Honesty:
    """A statistic of the covariance, NEES or NIS, in the scored window.

    average: over the agents that count. agents: of each. dimension: its usual degrees of freedom. band: where it lies
    with 95 % probability if the covariance is right. inside: the share of values in the band of their own degrees.
    """

    average: Number
    agents: list[Number]
    dimension: float
    band: list[float]
    inside: Number
    over_time: OverTime


@dataclass(frozen=True)
class Nis(Honesty):
    """NIS; agents_band: where each agent's mean lies with 95 % probability, as innovations are white."""

    agents_band: list[list[float] | None]


@dataclass(frozen=True)
class Smoothing:
    """The smoothed estimates in the scored window, m and m/s, and the centralised smoother with the same lag.

    lag: steps that each estimate waited for later ones, at most; as many as the run has: the whole of it is smoothed.
    """

    lag: int
    position_rmse: Number
    velocity_rmse: Number
    centralized_position_rmse: Number
    ratio_to_centralized: Number
    nees: Honesty | None


@dataclass(frozen=True)
class Bias:
    """The constant error of each agent's ranges as it estimates it at the end, its standard deviation, and weight."""

    agents: list[Number]
    std: list[Number]
    weight: list[Number]


@dataclass(frozen=True)
class Distrust:
    """Share of the steps in which each agent distrusted its range, and the first and last such moment, s."""

    agents: list[Number]
    first: list[Number]
    last: list[Number]


@dataclass(frozen=True)
class Standing:
    """While estimates had one status: in which share of all, position RMSE, m, and mean NEES."""

    share: float
    position_rmse: Number
    nees: Number


@dataclass(frozen=True)
class Slowness:
    """Which share of its rounds each agent, and of its steps the target, came to too late; too_slow: who is named."""

    agents: list[Number]
    target: Number
    too_slow: list[str]


@dataclass(frozen=True)
class Messages:
    """Messages of the whole run: sent, recorded, missing from the log, and rejected by a receiver."""

    sent: int
    recorded: int
    missing: int
    rejected: int


@dataclass(frozen=True)
class LinkMetrics:
    """One directed link; the counts are those of `Links`, latency in s."""

    source: int
    destination: int
    sent: int
    delivered: int
    lost: int
    late: int
    injected_lost: int
    injected_late: int
    real_lost: int
    deadline_missed: int
    corrupted: int
    duplicated: int
    latency: Number


@dataclass(frozen=True)
class LinkTotals:
    """How many directed links there are, and the sums of their counts."""

    links: int
    sent: int
    delivered: int
    lost: int
    late: int
    injected_lost: int
    injected_late: int
    real_lost: int
    deadline_missed: int
    corrupted: int
    duplicated: int


@dataclass(frozen=True, repr=False)
class Metrics:
    """What a run achieved. RMSE, NEES, NIS and disagreement are of the scored window, which `skip` steps precede.

    left_out: agents that averages are not over. lacks: what the log does not hold, in sentences. position_rmse, m,
    and velocity_rmse, m/s: of the network. claimed_position_error, m: what its covariances say that error is.
    strong: of a centralised filter that holds where the network's kind is lost; where that one is near the bound,
    its own figures. lost, twin_lost: whether the network, and the centralised filter, lost the target: more than
    three times as far off as the strong one. status: of the whole run, by the name of what agents said their
    estimates were. smoothed, nees, nis, status, bias, distrust, slow: None where the run has none. misfit: a
    sentence where recorded ranges do not fit the positions, else empty. gaps: by key, the stretches of numbers that
    are missing. bytes_per_step: of each agent. link_bytes_per_step: from one neighbour to another, one way.
    precision: in which numbers payloads travel. silent: in which share of the rounds agents kept silent, None where
    they never do.
    """

    run: str
    filter: str
    agents: int
    left_out: list[int]
    steps: int
    seed: int
    timing: str
    complete: bool
    stopped: bool
    skip: int
    planar: bool
    msee: Msee
    scored: Scored
    lacks: list[str]
    unobservable_steps: Stretches
    position_rmse: Number
    velocity_rmse: Number
    claimed_position_error: Number
    centralized: Yardstick
    ratio_to_centralized: Number
    strong: Yardstick
    ratio_to_strong: Number
    lost: bool
    twin_lost: bool
    bound: Yardstick
    smoothed: Smoothing | None
    ratio_to_bound: Number
    nees: Honesty | None
    nis: Nis | None
    status: dict[str, Standing] | None
    misfit: str
    bias: Bias | None
    distrust: Distrust | None
    slow: Slowness | None
    disagreement: Number
    bytes_per_step: Number
    link_bytes_per_step: Number
    precision: Precision
    silent: Number
    messages: Messages
    gaps: Mapping[str, list[tuple[int, int]]]
    links: list[LinkMetrics]
    links_total: LinkTotals

    def __repr__(self) -> str:
        """What matters most, in a line: all of it is several screens."""
        nees = number(None if self.nees is None else self.nees.average)
        return (
            f"<Metrics of {self.run}: {self.filter}, {counted(self.agents, 'agent')}, {counted(self.steps, 'step')}, "
            f"position RMSE {number(self.position_rmse, 'm')}, ratio to centralised "
            f"{number(self.ratio_to_centralized)}, NEES {nees}; as_json() has all>"
        )

    def as_json(self) -> dict[str, Json]:
        """The metrics as `analyze --json` prints them."""
        return asdict(self)
