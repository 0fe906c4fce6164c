"""The centralised interacting multiple model filter, offline: the yardstick of a network with several motions."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.information_form import predict, saturation
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Space, own_range
from zenoh_cbef.tracking.switching import Gaussian, Switching, misfit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Ranges:
    """One step of r runs: positions (r, n, 3), ranges, ages and their noise (r, n); NaN ranges are missing."""

    position: Floats
    range: Floats
    age: Floats
    std: Floats


@dataclass(frozen=True)
class Taken:
    """All agents' ranges taken in by the filter of one motion, for r runs.

    prior: covariance. posterior: state and covariance. cost: see `misfit`, (r,). innovation: sizes (m), and nis: their
    squares in units of the variance that was predicted, (r, n), NaN where nothing was measured.
    """

    prior: Floats
    posterior: Gaussian
    cost: Floats
    innovation: Floats
    nis: Floats


@dataclass(frozen=True)
class CentralModels:
    """One filter that sees every range at once, for each of several motions, and what weighs them.

    xi: saturation level in standard deviations, infinite for none. power: of the saturation.
    """

    switching: Switching
    space: Space
    xi: float
    power: int = 1

    def step(self, belief: Belief, seen: Ranges) -> tuple[Belief, Taken]:
        """The belief after one step's ranges, and what the likeliest motion says of them.

        belief: the initial one, (r, s), or what the last step returned.
        """
        if belief.parts:
            chance, beliefs = belief.memory[0], [(one.state, one.known_covariance) for one in belief.parts]
        else:
            chance, beliefs = self.switching.begun(belief.state, belief.known_covariance)
        ahead, mixtures = self.switching.mixed(chance, beliefs)
        taken = [
            self._taken(motion, Belief(*mixture), seen)
            for motion, mixture in zip(self.switching.motions, mixtures, strict=True)
        ]
        misfits = [misfit(one.cost, one.prior, one.posterior[1]) for one in taken]
        chance = self.switching.weighed(ahead, np.stack(misfits, axis=1))
        parts = [one.posterior for one in taken]
        mixture = self.switching.combined(chance, parts)
        joined = Belief(*mixture, memory=(chance,), parts=tuple(Belief(*one) for one in parts))
        return joined, _likeliest(taken, ahead)

    def _taken(self, motion: Motion, belief: Belief, seen: Ranges) -> Taken:
        runs, agents = seen.range.shape
        state, covariance = predict(motion, belief)
        predicted, rows = own_range(
            self.space, np.repeat(state, agents, axis=0), seen.position.reshape(-1, 3), seen.age.ravel()
        )
        rows, measured = rows.reshape(runs, agents, -1), np.isfinite(seen.range)
        innovation = np.where(measured, seen.range - predicted.reshape(runs, agents), 0.0)
        spread = np.sqrt(np.sum(rows * (rows @ covariance), axis=2) + seen.std**2)
        weight = np.where(measured, saturation(innovation, self.xi * spread, self.power), 1.0)
        precision = np.where(measured, weight, 0.0) / seen.std**2
        weighted = precision[:, :, None] * rows
        updated = inverse(inverse(covariance) + np.swapaxes(weighted, 1, 2) @ rows)
        pull = np.sum(weighted * innovation[:, :, None], axis=1)
        moved = state + matvec(updated, pull)
        cost = np.sum(precision * innovation**2 - np.log(weight), axis=1)
        cost -= np.sum((moved - state) * pull, axis=1)
        nis = np.where(measured, (innovation / spread) ** 2, np.nan)
        return Taken(covariance, (moved, updated), cost, np.abs(innovation), nis)


def _likeliest(taken: list[Taken], ahead: Floats) -> Taken:
    """What is said of the innovations by the motion that is likeliest before the step; of equal ones by the last."""
    first, last = taken[0], len(taken) - 1
    chosen, runs = last - ahead[:, ::-1].argmax(axis=1), np.arange(len(ahead))
    innovation, nis = (np.stack([getattr(one, part) for one in taken])[chosen, runs] for part in ("innovation", "nis"))
    return Taken(first.prior, first.posterior, first.cost, innovation, nis)


def centralized_models(
    initial: Belief,
    models: CentralModels,
    *,
    positions: Floats,
    ranges: Floats,
    age: Floats,
    range_std: float,
) -> Iterator[Belief]:
    """The filter's beliefs of K steps, for r runs.

    initial: (r, s), (r, s, s). positions: (r, n, K, 3). ranges, age: (r, n, K).
    """
    belief = initial
    for k in range(ranges.shape[2]):
        heard = np.nan_to_num(age[:, :, k])
        seen = Ranges(positions[:, :, k], ranges[:, :, k], heard, np.full_like(heard, range_std))
        belief, _ = models.step(belief, seen)
        yield belief
