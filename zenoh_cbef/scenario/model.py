"""The typed description of a run. Every key has a default; None means "derive it"."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

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

    def mistakes(self) -> dict[str, bool]:
        """See Table. Raises ValueError for options that the motion does not take."""
        options_of(self.motion, self.options or {}, "target.options")
        return {
            "target.waypoints needs at least two points for target.motion = 'waypoints'": (
                self.motion == "waypoints" and len(self.waypoints) < 2
            ),
            "target.orders steer a target by hand: set target.motion = 'manual', or leave them out": (
                bool(self.orders) and self.motion != "manual"
            ),
            "target.path must name the dataset folder for target.motion = 'dataset'": (
                self.motion == RECORDED and self.path is None
            ),
        }


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

    def mistakes(self) -> dict[str, bool]:
        """See Table."""
        many, listed, ways = self.number, len(self.positions or ()), self.waypoints
        labels = many if self.labels is None else len(self.labels)
        return {
            f"agents.count = {self.count} is more than the {listed} agents.positions; add positions or lower the "
            "count": self.positions is not None and many > listed,
            "agents.positions is empty; list a position for each agent, or leave it out": self.positions == (),
            f"agents.labels lists {labels} for {many} agents; give one each": labels != many,
            f"agents.waypoints needs one list of points for each of the {many} agents; add it": (
                self.motion == "waypoints" and (len(ways) != many or not all(ways))
            ),
        }

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
    longer write the log. rings: agents and target leave what they say in memory that recorders on their host read;
    ring_bytes: how much each.
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

    def mistakes(self) -> dict[str, bool]:
        """See Table."""
        stage, chosen = self.consensus, self.filter
        judged = abilities_of(chosen.kind).information and chosen.motion != "imm" and chosen.bias != "estimate"
        recorded = self.target.motion == RECORDED
        return {
            f"consensus.lag = {stage.lag} fuses estimates that share their past, which only covariance intersection "
            "may; set filter.kind = 'ci' and filter.measurement = 'range', or leave lag out": (
                stage.lag > 0 and (chosen.kind != "ci" or chosen.measurement != "range")
            ),
            f"consensus.trim = {stage.trim} compares the information of one filter, and filter.motion = 'imm' has "
            "several; choose another motion, or leave trim out": stage.trim > 0 and chosen.motion == "imm",
            "consensus.isolate = true compares the information of one filter about position and velocity; set "
            "filter.kind = 'sicf', filter.bias = 'none' and another filter.motion than 'imm', or leave isolate out": (
                stage.isolate is True and not judged
            ),
            "agents.motion must be 'static' for target.motion = 'dataset': its anchors rest": (
                recorded and self.agents.motion != "static"
            ),
            # A dataset that is not read yet says how many agents there are.
            **({} if recorded and self.agents.positions is None else self._miscounted()),
        }

    def _miscounted(self) -> dict[str, bool]:
        """Keys that list a value for each agent, and not for as many as there are."""
        each = {
            "filter.initial_position": self.filter.initial_position,
            "filter.initial_velocity": self.filter.initial_velocity,
        }
        listed = {key: len(one) for key, one in each.items() if one is not None and isinstance((*one, ())[0], tuple)}
        listed |= {"sensor.bias": len(self.sensor.bias)} if isinstance(self.sensor.bias, tuple) else {}
        return {
            f"{key} lists {many} values for {self.count} agents; give one, or one per agent": many != self.count
            for key, many in listed.items()
        }
