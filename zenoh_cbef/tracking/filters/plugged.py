"""A filter of another package: what it does wrong becomes one sentence that names its line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.plugins import blaming
from zenoh_cbef.tracking.filters.base import Belief, Filter, Kind, Sharing, Update
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.ranging import Measurement

_CHECK = "check_filter"


@dataclass(frozen=True)
class Shapes:
    """What a kind's updates and beliefs must be. size: s of a state. shared: d of a payload. covariance: it has one."""

    size: int
    shared: int
    covariance: bool

    @classmethod
    def of(cls, kind: type[Kind], settings: FilterSettings) -> Self:
        """As the kind itself says."""
        return cls(settings.motion.size, kind.sharing(settings).payload_size, kind.abilities.covariance)

    def flaw_of_update(self, update: object, count: int) -> str:
        """Why this is no update of so many agents, and the remedy; "" for one that is."""
        if not isinstance(update, Update):
            return f"update() gives {_told(update)}; return an Update of zenoh_cbef.extending"
        if _is_array(update.payload, expected := (count, self.shared)):
            return ""
        told = _told(update.payload)
        return f"the payload is {told}, but sharing() says float64 {expected}; let both say the same"

    def flaw_of_belief(self, belief: object, count: int) -> str:
        """Why this is no belief of so many agents, and the remedy; "" for one that is."""
        if not isinstance(belief, Belief):
            return f"conclude() gives {_told(belief)}; return a Belief of zenoh_cbef.extending"
        if (belief.covariance is not None) != self.covariance:
            return f"abilities.covariance is {self.covariance}, but conclude() says otherwise; let both say the same"
        if not _is_array(belief.state, expected := (count, self.size)):
            return f"the state is {_told(belief.state)}, not float64 {expected}; correct conclude()"
        square = count, self.size, self.size
        if belief.covariance is not None and not _is_array(belief.covariance, square):
            return f"the covariance is {_told(belief.covariance)}, not float64 {square}; correct conclude()"
        return ""


def _is_array(value: object, shape: tuple[int, ...]) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == np.float64 and value.shape == shape


def _told(value: object) -> str:
    return f"{value.dtype} {value.shape}" if isinstance(value, np.ndarray) else f"a {type(value).__name__}"


@dataclass(frozen=True)
class PluggedFilter:
    """A filter of another package, whose results are looked at.

    Every method raises UserError where the filter raises anything, or returns what is no result.
    """

    kind: type[Kind]
    filter: Filter
    shapes: Shapes

    @staticmethod
    def sharing(kind: type[Kind], settings: FilterSettings) -> Sharing:
        """What agents with the filter of these settings exchange."""
        with blaming(kind, "sharing", _CHECK):
            return kind.sharing(settings)

    @classmethod
    def of(cls, kind: type[Kind], settings: FilterSettings) -> Self:
        """The filter of these settings."""
        with blaming(kind, "of", _CHECK):
            return cls(kind, kind.of(settings), Shapes.of(kind, settings))

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's own."""
        with blaming(self.kind, "update", _CHECK):
            update = self.filter.update(belief, measurement)
            if words := self.shapes.flaw_of_update(update, len(measurement.range)):
                raise TypeError(words)
        return update

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's own."""
        with blaming(self.kind, "conclude", _CHECK):
            belief = self.filter.conclude(payload, update)
            if words := self.shapes.flaw_of_belief(belief, len(payload)):
                raise TypeError(words)
        return belief
