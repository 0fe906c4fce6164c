"""Hypotheses that the target is elsewhere, which rise while ranges deny where it is, and may take over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.filters.models.branching import KEPT, Branches, Heard, conditioned
from zenoh_cbef.tracking.filters.models.mixtures import NEVER, Priors
from zenoh_cbef.tracking.filters.models.splitting import NEAR, STAY
from zenoh_cbef.tracking.filters.models.tying import tied
from zenoh_cbef.tracking.filters.rows import picked
from zenoh_cbef.tracking.linalg import leading_trace

_BEGUN = 0.2, 10.0
"""As if of ten ranges a fiftieth had been wrong before the first one."""

_MEMORY = 120.0
"""How many of the network's ranges are remembered, as by its status."""

_MOST = 0.5
"""The share of wrong ranges that is in doubt where the scenario tells of none, and the most that is believed."""

_FIRST = 10.0
"""How many ranges for each axis a network hears before it is sure of anything."""

_ELSEWHERE = float(np.log(1e-12))
"""How likely it is in a step that the target is where no hypothesis has it: a step of wrong ranges is likelier."""

_APART = 3.0
"""How many of its claimed errors an agent is off the mean of all where they do not agree."""

Contenders = tuple[Floats, Floats, Floats, Floats]
"""Priors, of which the first half hold and the others rise, and what was counted, (n, 2)."""


@dataclass(frozen=True)
class Contest:
    """Hypotheses that hold, and while the network is in doubt those that rise: born in any step, from anywhere.

    Both take in all ranges, but apart: variants of what holds would leave no room for others among the likeliest. The
    likelihoods of both are kept, so that a hypothesis which once fits better than what holds by the chance of its birth
    takes over. A network is in doubt before it has heard enough, and while more ranges are wrong than the scenario
    tells, or than half. Where it tells nothing, the share of wrong ranges is learned. An agent is in doubt, too, while
    it is off the mean of all (see `apart`): agents that were cut off from each other may come back with two places, and
    to each half those ranges are wrong that only the other place fits, of all never more than half.

    axes: of the position. outliers: see branching.py. splits: whether hypotheses follow the bend of ranges, so that
    more of them stay, and nearer to each other.
    """

    axes: int
    outliers: tuple[float, float] | None
    splits: bool = False

    @property
    def stay(self) -> int:
        """How many hypotheses stay from step to step, of those that hold and of those that rise."""
        return STAY if self.splits else KEPT

    def halves(self, priors: Priors) -> tuple[Priors, Priors]:
        """Of what the step begins with, that which holds and that which rises."""
        state, covariance, likelihood = priors
        holds, rises = slice(self.stay), slice(self.stay, None)
        return (
            (state[:, holds], covariance[:, holds], likelihood[:, holds]),
            (state[:, rises], covariance[:, rises], likelihood[:, rises]),
        )

    def after(
        self, holds: Branches, rises: Branches, elsewhere: Priors, heard: Heard, counts: Floats, *, off: Bools
    ) -> tuple[Branches, Contenders]:
        """All branches after the ranges, and what the next step begins with.

        elsewhere: where the target may be otherwise, one prior of each agent. counts: (n, 2), before. off: (n,), which
        agents are off the mean of all.
        """
        doubts = self._doubts(counts) | off
        whole = holds = tied(conditioned(holds, heard, self.outliers), heard)
        if doubts.any():
            known, place = (self.axes, holds.biases, holds.share), (*elsewhere[:2], elsewhere[2] + _ELSEWHERE)
            born = Branches.of(place, *known, ties=holds.slack is not None, exact=holds.exact)
            rises = tied(conditioned(rises.beside(born), heard, self.outliers), heard).unless(~doubts)
            whole = holds.beside(rises)
        most = np.maximum.reduce(whole.likelihood, axis=1)[:, None]
        near = NEAR if self.splits else None
        left, risen = (one.distinct(most, self.stay, near) for one in (holds, rises.unless(~doubts)))
        over = np.maximum.reduce(risen[2], axis=1) > np.maximum.reduce(left[2], axis=1)
        return whole, self._next(left, risen, over, self._counted(whole, heard, counts, over))

    def denied(self, counts: Floats) -> Bools:
        """Whether so many ranges are wrong that the target is not where it is thought to be, (n,)."""
        return self._beyond(counts, _MOST if self.outliers is None else 0.5 * (1.0 + self.outliers[0]))

    def _doubts(self, counts: Floats) -> Bools:
        few = counts[:, 1] - _BEGUN[1] < _FIRST * self.axes
        return few | self._beyond(counts, _MOST if self.outliers is None else self.outliers[0])

    @staticmethod
    def _beyond(counts: Floats, most: float) -> Bools:
        wrong, heard = counts.T - np.array(_BEGUN)[:, None]
        return np.asarray(wrong > most * heard)

    @staticmethod
    def _next(holds: Priors, rises: Priors, over: Bools, counts: Floats) -> Contenders:
        """What rises is what holds from now on, where it is likelier; what held may be forgotten then."""
        found = []
        for held, risen in zip(holds[:2], rises[:2], strict=True):
            found.append(np.concatenate([picked(held, risen, over), risen], axis=1))
        likelihood = np.where(over[:, None], rises[2], holds[2])
        later = np.where(over[:, None], NEVER, rises[2])
        return found[0], found[1], np.concatenate([likelihood, later], axis=1), counts

    @staticmethod
    def _counted(whole: Branches, heard: Heard, counts: Floats, over: Bools) -> Floats:
        there = np.add.reduce(np.isfinite(heard.range), axis=1)
        fades, begun = np.exp(-there / _MEMORY)[:, None], np.array(_BEGUN)
        after = begun + fades * (counts - begun) + np.stack([whole.wrong_ranges, there], axis=1)
        return np.asarray(np.where(over[:, None], begun, after))


def apart(away: Floats, covariance: Floats, axes: int) -> Bools:
    """Which agents (n,) are off the mean of all by more than they claim.

    away: from it, (n, s), of which the position counts, m. covariance: of each, (n, s, s).

    Agents that tell each other their ranges compute the same from them, so they agree but where some were cut off.
    """
    square = np.add.reduce(away[:, :axes] ** 2, axis=1)
    return np.asarray(square > _APART**2 * leading_trace(covariance, axes))


def uncounted(count: int) -> Floats:
    """What so many agents have counted before the first range, (n, 2)."""
    return np.tile(_BEGUN, (count, 1))


def share(counts: Floats) -> Floats:
    """What share of the ranges is taken to be wrong, (n, 1)."""
    return np.asarray(np.minimum(counts[:, :1] / counts[:, 1:], _MOST))
