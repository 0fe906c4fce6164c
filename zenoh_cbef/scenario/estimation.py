"""The scenario's [filter] table."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, field_validator

from zenoh_cbef.quantities import Acceleration, Chance, Duration, Factor, Length, Metres, Rate, Seconds, Speed, Spread
from zenoh_cbef.scenario.table import EachPosition, EachVelocity, Options, Table, one_of
from zenoh_cbef.tracking.filters import KINDS, Abilities, abilities_of, kind_of, options_of
from zenoh_cbef.tracking.motion import MOTIONS, is_linear


def _motion(value: str) -> str:
    return one_of(value, tuple(MOTIONS))


class Model(Table):
    """One of several motions between which the target switches. None: as for a filter of this motion alone."""

    motion: Annotated[str, AfterValidator(_motion)]
    acceleration_std: Acceleration | None = None
    velocity_time: Duration | None = None
    turn_rate_std: Rate | None = None
    turn_rate_change: Factor | None = None


NEWEST = 29
"""The rules that a scenario is of which names none."""


class Filter(Table):
    """The estimation filter and its settings. None: the value follows from target and sensor."""

    kind: str = "sicf"
    defaults: Annotated[int, Field(ge=1, le=NEWEST)] = NEWEST
    """The rules by which `auto` and None decide, 1 those of version 0.2.0 and before it.

    Logs hold `auto` as such, so a change of what it means is a new number, and old logs keep theirs (see legacy.py).
    """
    options: Options = None
    """Of a kind of another package, as its own model has them."""
    plugin: str | None = None
    """That package, its version and a hash of its source; None: as they are on this host."""
    xi: Annotated[Factor | Literal["auto"], Field(description="a number from 1e-06 to 1e+12, or 'auto'")] = "auto"
    """`cbef` saturates at this size of the whole innovation (m^2), `cbef-scaled` likewise (m), the others at this many
    standard deviations; auto: 2 where saturation redescends, otherwise 1.5."""
    saturation: Literal["auto", "bounded", "redescending"] = "auto"
    """auto: redescending where ranges are real, the scenario's sensor has outliers, or a first fix finds a target whose
    motion is ncv, or one of several that the filter assumes."""
    recovery: Annotated[bool | Literal["auto"], Field(description="true, false or 'auto'")] = "auto"
    """auto: on where ranges are real, which a target that suddenly moves otherwise makes look wrong."""
    distrust: Annotated[bool | Literal["auto"], Field(description="true, false or 'auto'")] = "auto"
    """auto: on where ranges are real or receivers have faults."""
    membership: Annotated[bool | Literal["auto"], Field(description="true, false or 'auto'")] = "auto"
    """Whether agents tell each other who is there, and a group that is cut off counts its ranges once; auto: where
    faults cut links, agents hear each other by radio, or they isolate liars, and there are at most twelve."""
    omega: Factor | None = None
    """`hcmci` multiplies averaged measurements by it; None: the number of agents."""
    measurement: Literal["range", "difference"] = "range"
    """The agent's own range, or differences with its neighbours', as `cbef` and `cbef-scaled` always have."""

    motion: str = "auto"
    """A model of tracking/motion; auto: it follows from the target."""
    acceleration_std: Acceleration | None = None
    acceleration_interval: Duration | None = None
    """How long a random acceleration lasts, s; None: one step, or for recorded ranges their own interval."""
    velocity_time: Duration = 10.0
    """Time constant of `decay`, s."""
    turn_rate_std: Rate = 1.0
    """Of a turn's rate at first, rad/s."""
    turn_rate_change: Annotated[
        Factor | Literal["auto"] | None, Field(description="a number from 1e-06 to 1e+12, or 'auto'")
    ] = "auto"
    """The share of it by which the rate changes in a step; None: by turn_rate_std in a second. auto: a hundredth, or in
    steps longer than 0.1 s as much as turns the velocity by the same angle."""
    models: tuple[Model, ...] = ()
    """Those of `imm`, the most agile one last; none: straight on, a turn, and two that are agile."""
    agile: Literal["jump", "ncv"] = "jump"
    """The last of these."""
    switching: Annotated[Chance | Literal["auto"], Field(description="a number from 0 to 1, or 'auto'")] = "auto"
    """The probability that the target leaves its model in a step."""

    range_std: Annotated[Length | Literal["auto"] | None, Field(description="a number from 1e-9 to 1e7, or 'auto'")] = (
        None
    )
    bias: Literal["none", "estimate", "auto"] = "auto"
    bias_common_std: Length | None = None
    """Prior of the network's part of the bias, m; None: 1.5 of range_std."""
    bias_own_std: Spread | None = None
    """Prior of the agents' own parts, m; None: 0.15 of range_std, and at least sensor.bias_std."""

    start: Literal["auto", "given"] = "auto"
    """auto: with a first fix, for filters that can; given: at the initial estimate."""
    status: bool = True
    """Whether agents of filters that average information say if they acquire, track, coast, or have lost the target."""
    status_rules: Literal[1, 2] = 2
    """1: lost where most ranges do not fit. 2: where agents whose ranges fit are too few to prove the place, and only
    agents that hear ranges vote for another fix."""
    linearise: Literal["auto", "before", "after"] = "auto"
    """Ranges before they are averaged, each agent its own at its own prior, or their average, of squares, after that;
    auto: after, for filters that can, where priors may be wide."""
    reacquire: bool = True
    """Whether a network that was silent for long, or has lost its target, looks for it by another fix."""
    planar_height: Metres | None = None
    lag_seconds: Seconds = 0.0
    """Agents also publish smoothed estimates of so long ago; 0: they do not."""
    initial_position: EachPosition = None
    initial_velocity: EachVelocity = None
    initial_position_std: Length | None = None
    initial_velocity_std: Speed | None = None

    @property
    def plugged(self) -> str:
        """The kind, where it is of another package; else empty."""
        return "" if self.kind in KINDS else self.kind

    @property
    def _abilities(self) -> Abilities:
        return abilities_of(self.kind)

    @field_validator("kind")
    @classmethod
    def _known(cls, value: str) -> str:
        kind_of(value)
        return value

    @field_validator("motion")
    @classmethod
    def _known_motion(cls, value: str) -> str:
        return one_of(value, ("auto", *MOTIONS, "imm"))

    def mistakes(self) -> dict[str, bool]:
        """See Table. Raises ValueError for options that the kind does not take."""
        options_of(self.kind, self.options or {}, "filter.options")
        return self._of_motions() | self._of_kind()

    def _of_motions(self) -> dict[str, bool]:
        able, kind = self._abilities, self.kind
        return {
            f"filter.motion = {self.motion!r} is not for {kind!r}, which has no covariance; set filter.motion = "
            "'ncv', or filter.kind = 'sicf'": self.motion not in ("auto", "ncv") and not able.covariance,
            f"filter.bias = 'estimate' needs one linear motion, which {self.motion!r} is not; choose another "
            "filter.motion, or set filter.bias = 'auto', which leaves biases alone then": (
                self.bias == "estimate" and not (self.motion == "auto" or is_linear(self.motion))
            ),
            f"filter.motion = 'imm' is not for {kind!r}; set filter.kind = 'sicf' or 'icf', or another motion": (
                self.motion == "imm" and not able.models
            ),
            "filter.models lists the motions of filter.motion = 'imm', two or more; set that motion and list two, or "
            "leave filter.models out": len(self.models) == 1 or (bool(self.models) and self.motion != "imm"),
        }

    def _of_kind(self) -> dict[str, bool]:
        able, kind, differences = self._abilities, self.kind, self.measurement == "difference"
        return {
            f"filter.linearise = 'after' is not for {kind!r}; set filter.kind = 'sicf' or 'icf', or filter.linearise = "
            "'auto', which leaves other filters alone": self.linearise == "after" and not able.biases,
            f"filter.recovery is for filters that average information, not for {kind!r}; set filter.kind = 'sicf', or "
            "leave filter.recovery out": self.recovery is True and not able.information,
            f"filter.lag_seconds needs to know how sure each estimate is, and {kind!r} has no covariance; set "
            "filter.kind = 'sicf', or leave filter.lag_seconds out": self.lag_seconds > 0.0 and not able.covariance,
            f"filter.distrust compares what neighbours say of their own ranges, so it is not for {kind!r} on "
            f"{self.measurement}s; set filter.kind = 'sicf', or leave filter.distrust out": (
                self.distrust is True and (not able.information or differences)
            ),
            f"filter.membership is for filters that take averages for the whole network's, not for {kind!r}; set "
            "filter.kind = 'sicf' or 'icf', or leave filter.membership out": (
                self.membership is True and not able.biases
            ),
            f"filter.measurement = 'difference' would count ranges more than once in {kind!r}, as agents' differences "
            "share them; set filter.kind = 'ci', or filter.measurement = 'range'": differences and not able.differences,
            f"filter.bias = 'estimate' is not for {kind!r}; set filter.kind = 'sicf' or 'icf', or filter.bias = "
            "'auto', which leaves biases alone in other filters": self.bias == "estimate" and not able.biases,
            f"filter.range_std = 'auto' is not for {kind!r} on {self.measurement}s; give a number, or set "
            "filter.kind = 'sicf'": self.range_std == "auto" and (not able.noise or differences),
        }
