"""What ranges say about the target: the agent's own range, and differences with neighbours' ranges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.tracking.copying import replace


@dataclass(frozen=True)
class Measurement:
    """What a batch of agents measured in one step; NaN where a range is missing.

    position: (n, 3), the agents, m. range: (n,), m. age: (n,), s, how long before the step's time the beacon was
    emitted (0 for a synchronous target). neighbour_position: (n, m, 3) and neighbour_range: (n, m), as delivered
    by the neighbours this step; filters that use only their own range get them empty (m = 0). range_std: (n,), m,
    the noise of the own range, where it differs from the filter's setting. step: its number, None where that is no
    matter. lasting: (n,), how many own ranges say as much as one whose error is independent; None: each does.
    followed: (n,), m^2, by how much an innovation's variance is smaller as the estimate follows such errors; None: not
    at all. alike: (n,), the correlation of an error with those before it, from 0 on; None: not known. agent: (n,), the
    agents' numbers, None where those are no matter. few: (n,), which agents hear so few others that their ranges do not
    tell where the target is; None: none. overcounted: (n,), how often n times an agent's average counts a range that
    the network has once; None: once. forgets: whether a first fix does without the ranges of earlier steps, too. wrong:
    (n,), how likely the own range is wrong, before it is heard; None: as the filter's settings say. distrust: (n,), how
    much agents distrust their own ranges, from 0 to 1; None: not at all.
    """

    position: Floats
    range: Floats
    age: Floats
    neighbour_position: Floats
    neighbour_range: Floats
    range_std: Floats | None = None
    step: int | None = None
    lasting: Floats | None = None
    followed: Floats | None = None
    alike: Floats | None = None
    agent: Ints | None = None
    few: Bools | None = None
    overcounted: Floats | None = None
    forgets: bool = False
    wrong: Floats | None = None
    distrust: Floats | None = None


def no_neighbours(agents: int) -> tuple[Floats, Floats]:
    """The neighbours' positions and ranges of agents that are told none."""
    return np.empty((agents, 0, 3)), np.empty((agents, 0))


def unheard(measurement: Measurement) -> Measurement:
    """The update of the same step as if nothing had been measured or heard."""
    return replace(
        measurement,
        range=np.full_like(measurement.range, np.nan),
        age=np.zeros_like(measurement.age),
        neighbour_position=np.zeros_like(measurement.neighbour_position),
        neighbour_range=np.full_like(measurement.neighbour_range, np.nan),
    )


@dataclass(frozen=True)
class Space:
    """The space the target moves in: three axes, or a horizontal plane at a known height (m)."""

    height: float | None = None

    @cached_property
    def axes(self) -> int:
        """Number of estimated axes."""
        return 3 if self.height is None else 2

    def position(self, state: Floats) -> Floats:
        """Positions (n, 3) of states (n, s) that begin with a position."""
        if self.height is None:
            return state[:, :3]
        return np.concatenate([state[:, :2], np.full((len(state), 1), self.height)], axis=1)

    def embed_state(self, state: Floats) -> Floats:
        """Position and velocity, with which states (n, s) begin, as (n, 6)."""
        if self.height is None:
            return state if state.shape[1] == 6 else np.ascontiguousarray(state[:, :6])
        full = np.zeros((len(state), 6))
        full[:, self.kept] = state[:, :4]
        full[:, 2] = self.height
        return full

    def embed_covariance(self, covariance: Floats) -> Floats:
        """That part of covariances (n, s, s) as (n, 6, 6), zero where the state is known."""
        if self.height is None:
            return covariance if covariance.shape[1] == 6 else np.ascontiguousarray(covariance[:, :6, :6])
        full = np.zeros((len(covariance), 6, 6))
        full[:, self.kept[:, None], self.kept] = covariance[:, :4, :4]
        return full

    def kept_states(self, full: Floats) -> Floats:
        """The estimated components of full states (..., 6)."""
        return full if self.height is None else full[..., self.kept]

    def kept_covariances(self, full: Floats) -> Floats:
        """Those of full covariances (..., 6, 6)."""
        return full if self.height is None else full[..., self.kept[:, None], self.kept]

    @property
    def kept(self) -> NDArray[np.intp]:
        """Indices of the estimated components within the full state of six."""
        return np.array([0, 1, 2, 3, 4, 5]) if self.height is None else np.array([0, 1, 3, 4])


def own_range(space: Space, state: Floats, position: Floats, age: Floats) -> tuple[Floats, Floats]:
    """Predicted range h(x) = |p - age v - p_i| and its gradient.

    state: (n, s). position: (n, 3), the agents. age: (n,), s. Returns (n,) in metres and rows (n, s). A target
    exactly at an agent has no direction; its gradient is zero there.
    """
    axes = space.axes
    offset = space.position(state) - position
    offset[:, :axes] -= age[:, None] * state[:, axes : 2 * axes]
    distance = np.sqrt(np.add.reduce(offset * offset, axis=1))
    apart = distance.copy()
    apart[~(distance > 0.0)] = 1.0
    rows = np.zeros(state.shape)
    direction = np.divide(offset[:, :axes], apart[:, None], out=rows[:, :axes])
    np.multiply(-age[:, None], direction, out=rows[:, axes : 2 * axes])
    return distance, rows


def filled(rows: Floats, size: int) -> Floats:
    """Gradients (..., 2 axes) by position and velocity as gradients by a state of the given size, (..., s)."""
    missing = size - rows.shape[-1]
    return rows if missing == 0 else np.pad(rows, ((0, 0),) * (rows.ndim - 1) + ((0, missing),))


def differenced_rows(space: Space, measurement: Measurement) -> tuple[Floats, Floats, Bools]:
    """Observation matrix and right-hand sides of the paper's linear form (eq. 5 there), one row per neighbour.

    (p_j - p_i)^T p = (r_i^2 - r_j^2 + |p_j|^2 - |p_i|^2) / 2, exact in the ranges. Returns H (n, m, axes) of the
    position components, y (n, m), and which rows exist (n, m): those whose two ranges were delivered. In a plane
    the known height moves to the right-hand side.
    """
    own = measurement.position[:, None, :]
    other = measurement.neighbour_position
    ranges = measurement.range[:, None]
    present = np.isfinite(ranges) & np.isfinite(measurement.neighbour_range)
    difference = other - own
    right = 0.5 * (
        ranges * ranges
        - measurement.neighbour_range * measurement.neighbour_range
        + np.sum(other * other, axis=2)
        - np.sum(own * own, axis=2)
    )
    if space.height is not None:
        right = right - space.height * difference[:, :, 2]
    rows = np.where(present[:, :, None], difference[:, :, : space.axes], 0.0)
    return rows, np.where(present, right, 0.0), present
