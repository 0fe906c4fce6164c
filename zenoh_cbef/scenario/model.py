"""The typed description of a run. Every key has a default; None means "derive it"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from zenoh_cbef.courses import RECORDED, kind_of, options_of
from zenoh_cbef.faults import AnyFault
from zenoh_cbef.quantities import (
    Acceleration,
    Agent,
    AgentCount,
    Chance,
    Count,
    Duration,
    Length,
    Metres,
    Milliseconds,
    Moment,
    Position,
    Probability,
    Seconds,
    Seed,
    SignalSpeed,
    Speed,
    Spread,
)
from zenoh_cbef.scenario.averaging import Consensus
from zenoh_cbef.scenario.estimation import Filter
from zenoh_cbef.scenario.table import Corner, Drift, Name, Options, Point, Table, one_of
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.filters import abilities_of


class Order(Table):
    """Where a target that is steered by hand goes while `from` <= time < `until` (s, run time)."""

    to: Point
    since: Seconds = Field(default=0.0, alias="from")
    until: Seconds | None = None


class Target(Table):
    """The moving target. `position` is where ncv and manual start, and the centre of circle and lemniscate.

    origin: the time of step 0 on a recording's own clock, s; the dataset says it.
    options: of a motion of another package, as its own model has them. plugin: that package, its version and a hash of
    its source; None: as they are on this host.
    """

    motion: str = "ncv"
    options: Options = None
    plugin: str | None = None
    position: Point = (0.0, 0.0, 0.0)
    velocity: Drift = (0.0, 0.0, 0.0)
    acceleration_std: Acceleration = 0.1
    waypoints: tuple[Position, ...] = ()
    speed: Speed = 1.0
    radius: Length = 5.0
    period: Duration = 30.0
    orders: Annotated[tuple[Order, ...], Field(description="a list of tables, each written [[target.orders]]")] = ()
    path: str | None = None
    origin: Moment | None = None

    @field_validator("motion")
    @classmethod
    def _known(cls, value: str) -> str:
        if value != RECORDED:
            kind_of(value)
        return value

    @model_validator(mode="after")
    def _takes_options(self) -> Target:
        options_of(self.motion, self.options or {})
        return self

    @model_validator(mode="after")
    def _complete(self) -> Target:
        if self.motion == "waypoints" and len(self.waypoints) < 2:
            raise ValueError("target.waypoints needs at least two points for target.motion = 'waypoints'")
        if self.orders and self.motion != "manual":
            raise ValueError("target.orders steer a target by hand: set target.motion = 'manual', or leave them out")
        if self.motion == "dataset" and self.path is None:
            raise ValueError("target.path must name the dataset folder for target.motion = 'dataset'")
        return self


class Agents(Table):
    """Where the agents are. `positions` overrides `placement`; a formation moves with `velocity`."""

    count: AgentCount | None = None
    placement: Literal["uniform"] = "uniform"
    low: Corner = -10.0
    high: Corner = 10.0
    positions: tuple[Position, ...] | None = None
    labels: tuple[str, ...] | None = None
    motion: Literal["static", "waypoints", "formation"] = "static"
    velocity: Drift = (0.0, 0.0, 0.0)
    waypoints: tuple[tuple[Position, ...], ...] = ()
    speed: Speed = 1.0

    @model_validator(mode="after")
    def _complete(self) -> Agents:
        if self.positions is not None and self.count is not None and self.count > len(self.positions):
            raise ValueError(
                f"agents.count = {self.count} is more than the {len(self.positions)} agents.positions; "
                "add positions or lower the count"
            )
        if self.positions is not None and not self.positions:
            raise ValueError("agents.positions is empty; list a position for each agent, or leave it out")
        if self.labels is not None and len(self.labels) != self.number:
            raise ValueError(f"agents.labels lists {len(self.labels)} for {self.number} agents; give one each")
        given = len(self.waypoints)
        if self.motion == "waypoints" and (given != self.number or not all(self.waypoints)):
            raise ValueError(f"agents.waypoints needs one list of points for each of the {self.number} agents; add it")
        return self

    @property
    def number(self) -> int:
        """How many agents there are."""
        if self.count is not None:
            return self.count
        return 6 if self.positions is None else len(self.positions)

    @property
    def names(self) -> tuple[str, ...]:
        """What a reader calls the agents: their labels, otherwise their numbers."""
        return self.labels or tuple(map(str, range(self.number)))


class Sensor(Table):
    """The receivers: ranges (m) with noise, bias, outliers (exponential, mean outlier_scale) and drop-outs.

    real: ranges are measured and not emulated, so the filter is to be wary of more than these keys say; a dataset's are
    in any case. reach: up to which distance (m) receivers hear the target; None: however far it is.
    """

    real: bool = False
    reach: Length | None = None
    range_std: Length = 0.1
    bias: Annotated[
        Metres | tuple[Metres, ...], Field(description="a number, or a list with a number for each agent")
    ] = 0.0
    bias_std: Spread = 0.0
    outlier_probability: Probability = 0.0
    outlier_scale: Length = 5.0
    dropout_probability: Probability = 0.0
    signal_speed: SignalSpeed = 299_792_458.0


class Network(Table):
    """The communication graph. `edges` overrides `graph`."""

    graph: str = "erdos-renyi"
    probability: Chance = 0.5
    radius: Length = 15.0
    edges: tuple[tuple[Agent, Agent], ...] | None = None

    @field_validator("graph")
    @classmethod
    def _known(cls, value: str) -> str:
        return one_of(value, (*graph.KINDS, "radio"))


class Timing(Table):
    """lockstep: a round ends when all messages that are due have come. realtime: a round ends at its deadline.

    patience: how long (s) an agent in lockstep waits for a neighbour that is there but silent.
    """

    mode: Literal["lockstep", "realtime"] = "lockstep"
    patience: Duration = 30.0
    round_deadline_ms: Annotated[Milliseconds, Field(gt=0.0)] | None = None
    start_delay: Seconds = 0.2


class Record(Table):
    """The log. flush_seconds bounds what a killed recorder loses; required: whether a run waits for `recorders`.

    rotate_bytes, rotate_seconds: when a new file begins, 0 for never. on_full: what `run` does when the recorder can no
    longer write the log. rings: agents leave what they say in memory that recorders on their host read; ring_bytes: how
    much an agent.
    """

    compression: Literal["zstd", "lz4", "none"] = "zstd"
    chunk_bytes: Annotated[int, Field(ge=1024, le=1 << 28)] = 1 << 20
    flush_seconds: Duration = 0.4
    required: bool = True
    recorders: Count = 1
    rotate_bytes: Annotated[int, Field(ge=0, le=10**15)] = 0
    rotate_seconds: Seconds = 0.0
    on_full: Literal["go-on", "stop"] = "go-on"
    rings: bool = False
    ring_bytes: Annotated[int, Field(ge=1 << 16, le=1 << 30)] = 1 << 21

    @property
    def awaited(self) -> int:
        """How many recorders must be there before a run starts."""
        return self.recorders if self.required else 0


class Zenoh(Table):
    """Endpoints and discovery. config: a Zenoh configuration file (JSON5) that the rest is laid over.

    tls: a folder of certificates; the process then refuses links without one.
    """

    connect: tuple[str, ...] = ()
    listen: tuple[str, ...] = ()
    mode: Literal["peer", "client"] = "peer"
    gossip: bool = True
    multicast: bool = False
    lease_ms: Annotated[int, Field(ge=100, le=600_000)] = 5000
    config: str | None = None
    tls: str | None = None


MOST_STEPS = 10_000_000


class Scenario(Table):
    """One run. steps None: 300, or as many as the dataset fills. dt: s."""

    name: Name = "tracking"
    seed: Seed = 1
    steps: Annotated[int, Field(ge=1, le=MOST_STEPS)] | None = None
    dt: Duration = 0.1
    target: Target = Target()
    agents: Agents = Agents()
    sensor: Sensor = Sensor()
    network: Network = Network()
    consensus: Consensus = Consensus()
    filter: Filter = Filter()
    timing: Timing = Timing()
    fault: Annotated[tuple[AnyFault, ...], Field(description="a list of tables, each written [[fault]]")] = ()
    record: Record = Record()
    zenoh: Zenoh = Zenoh()

    @property
    def count(self) -> int:
        """Number of agents."""
        return self.agents.number

    @property
    def length(self) -> int:
        """Number of steps."""
        return 300 if self.steps is None else self.steps

    @model_validator(mode="after")
    def _counted_once(self) -> Scenario:
        if self.consensus.lag and (self.filter.kind != "ci" or self.filter.measurement != "range"):
            raise ValueError(
                f"consensus.lag = {self.consensus.lag} fuses estimates that share their past, which only covariance "
                "intersection may; set filter.kind = 'ci' and filter.measurement = 'range', or leave lag out"
            )
        return self

    @model_validator(mode="after")
    def _comparable(self) -> Scenario:
        if self.consensus.trim and self.filter.motion == "imm":
            raise ValueError(
                f"consensus.trim = {self.consensus.trim} compares the information of one filter, and filter.motion = "
                "'imm' has several; choose another motion, or leave trim out"
            )
        return self

    @model_validator(mode="after")
    def _judged_by_a_state(self) -> Scenario:
        chosen = self.filter
        judged = abilities_of(chosen.kind).information and chosen.motion != "imm" and chosen.bias != "estimate"
        if self.consensus.isolate is True and not judged:
            raise ValueError(
                "consensus.isolate = true compares the information of one filter about position and velocity; set "
                "filter.kind = 'sicf', filter.bias = 'none' and another filter.motion than 'imm', or leave isolate out"
            )
        return self

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        if self.target.motion == "dataset":
            if self.agents.motion != "static":
                raise ValueError("agents.motion must be 'static' for target.motion = 'dataset': its anchors rest")
            if self.agents.positions is None:
                return self  # The dataset, which is not read yet, says how many agents there are.
        count = self.count
        for key, value in {
            "filter.initial_position": self.filter.initial_position,
            "filter.initial_velocity": self.filter.initial_velocity,
            "sensor.bias": self.sensor.bias,
        }.items():
            one_each = isinstance(value, tuple) and (key == "sensor.bias" or isinstance((*value, ())[0], tuple))
            if isinstance(value, tuple) and one_each and len(value) != count:
                raise ValueError(f"{key} lists {len(value)} values for {count} agents; give one, or one per agent")
        return self
