"""A distributed interacting multiple model: one filter for each of several motions, weighed by the network's ranges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Filter, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import unchanged, variance_of
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.weighing import saturated_precision
from zenoh_cbef.tracking.linalg import matvec, unpack_upper
from zenoh_cbef.tracking.motion import turned
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range
from zenoh_cbef.tracking.switching import Gaussian, Switching


@dataclass(frozen=True)
class InteractingModels:
    """The interacting multiple model filter of Blom and Bar-Shalom (IEEE TAC 33(8), 1988), agreed upon by a network.

    Each step every model's filter begins with a mixture of all models' estimates, and shares its own information, V and
    O, as if alone. One number more for each model is the constant of the same quadratic form:

        c_i = x_i^T P_i^-1 x_i/n + w_i (z_i + H_i x_i)^2/sigma^2 - log w_i + (log det P_i - 2 log m_i)/n
        after averaging:  -2 log m = min_x n (c - 2 x^T V + x^T O x) - log det P, but for a constant

    with m_i the model's probability before the step and m after it. The minimum is the least cost of all agents' priors
    and ranges together, so this has their joint likelihood, correlations and all, as a centralised filter has it (see
    `misfit`). All parts are averaged with the same weights, so few rounds weigh the agents unequally but never add what
    does not belong together; and agents agree on the probabilities before the step, too. That keeps a network of few
    rounds close to a centralised filter. The estimate is the mean of the mixture, with its covariance.

    filters: one for each motion, alike but for it; their payloads are V and O, their updates keep prior state and
    covariance. range_std: sigma (m). network_size: n. middle: a point (m) near all agents and the same for all, from
    which x is counted in c: far off, c would lose its digits. widens: how far the filters do (`saturated_precision`),
    and w_i is what makes w_i/sigma^2 that precision. outliers: the filters weigh ranges by these, and c_i has what they
    say of the range in place of its terms.
    """

    filters: tuple[Filter, ...]
    switching: Switching
    range_std: float
    network_size: int
    middle: tuple[float, ...]
    space: Space
    widens: float = 0.0
    outliers: Errors | None = None

    @classmethod
    def sharing(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Sharing]) -> Sharing:
        """All models' payloads, and a number for each; of_one: what the filter of one motion exchanges.

        No matrix of them may be rounded: from x^T O x, far larger than the least cost, c would lose its digits.
        """
        each = [of_one(replace(settings, motion=motion)) for motion in settings.models]
        return replace(each[0], payload_size=sum(one.payload_size + 1 for one in each), blocks=())

    @classmethod
    def of(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Filter]) -> Self:
        """The filter of these settings; of_one: makes the filter of one motion."""
        filters = tuple(of_one(replace(settings, motion=motion)) for motion in settings.models)
        around = settings.middle, settings.space, settings.widens, settings.weighed
        return cls(filters, settings.switching, settings.range_std, settings.network_size, *around)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """All models' updates; what is said of the innovation is the likeliest model's."""
        chance, beliefs = self._carried(belief)
        ahead, mixtures = self.switching.mixed(chance, beliefs)
        parts = [one.update(Belief(*mixture), measurement) for one, mixture in zip(self.filters, mixtures, strict=True)]
        told, costs, likely = parts[0].diagnostics, [], self.switching.of_models(ahead)
        for j, part in enumerate(parts):
            costs.append(self._own_cost(part, likely[:, j], measurement))
            told = told.chosen(likely[:, j] >= np.maximum.reduce(likely, axis=1), part.diagnostics)
        payload = np.concatenate([*(part.payload for part in parts), np.stack(costs, axis=1)], axis=1)
        return Update(payload, replace(told, maneuver=likely[:, -1].copy()), (ahead,), tuple(parts))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The mixture of all models' beliefs, weighed anew."""
        (ahead,) = update.kept
        place, beliefs, misfits = 0, [], []
        numbers = payload.shape[1] - len(self.filters)
        for j, (one, part) in enumerate(zip(self.filters, update.parts, strict=True)):
            mine = np.ascontiguousarray(payload[:, place : place + part.payload.shape[1]])
            belief = one.conclude(mine, part)
            # Averages times n are the network's sums.
            cost = self.network_size * (payload[:, numbers + j] - self._explained(mine, belief.state))
            misfits.append(cost - np.linalg.slogdet(belief.known_covariance)[1])
            beliefs.append(self._turned(j, part, belief))
            place += mine.shape[1]
        measured = np.stack(misfits, axis=1)
        usable = np.asarray(np.isfinite(measured).all(axis=1))
        if self.network_size > 1:
            usable &= ~unchanged(payload, update.payload)
        # The misfits have the network's probabilities of the motions, each agent its own of how often these change.
        among = ahead / np.tile(self.switching.of_models(ahead), len(self.switching.leaving))
        heard = self.switching.weighed(among, np.where(usable[:, None], measured, 0.0))
        chance = np.where(usable[:, None], heard, ahead)
        return Belief(*self.mixture(chance, beliefs), chance=chance, parts=tuple(beliefs))

    def mixture(self, chance: Floats, beliefs: Sequence[Belief]) -> Gaussian:
        """The mean of all models' beliefs and its covariance; chance: (n, R M)."""
        return self.switching.claimed(chance, [_gaussian(one) for one in beliefs])

    def _own_cost(self, part: Update, ahead: Floats, measurement: Measurement) -> Floats:
        """c_i, (n,), of one model's update. ahead: (n,), its probability before the step."""
        state, covariance = part.kept
        often = measurement.overcounted
        own = np.nan_to_num(self._misfit(part, measurement))
        own = own if often is None else own / often
        before = np.linalg.slogdet(covariance)[1] - 2.0 * np.log(ahead)
        return np.asarray(own + self._explained(part.payload, state) + before / self.network_size)

    def _misfit(self, part: Update, measurement: Measurement) -> Floats:
        """-2 log of the own range's likelihood at the prior, (n,), but for what is the same for all models."""
        told, variance = part.diagnostics, variance_of(measurement, self.range_std)
        if self.outliers is not None:
            state, covariance = part.kept
            distance, row = own_range(self.space, state, measurement.position, measurement.age)
            spread = np.sqrt(np.add.reduce(row * matvec(covariance, row), axis=1) + variance)
            errors = self.outliers.among(measurement.wrong)
            return errors.informed(measurement.range - distance, spread, variance).cost
        weight, square = told.weight, told.innovation**2
        if self.widens:
            spread = np.sqrt(square / np.where(told.nis > 0.0, told.nis, 1.0))
            weight = variance * saturated_precision(weight, variance, spread, widens=self.widens)
        return weight * square / variance - np.log(weight)

    def _explained(self, payload: Floats, state: Floats) -> Floats:
        """2 x^T V - x^T O x for states (n, s), with the origin in the middle."""
        size = state.shape[1]
        away, matrix = state.copy(), unpack_upper(payload[:, size:], size)
        middle = np.zeros_like(state)
        middle[:, : len(self.middle)] = self.middle
        away -= middle
        vector = payload[:, :size] - matvec(matrix, middle)
        return np.asarray(np.add.reduce(away * (2.0 * vector - matvec(matrix, away)), axis=1))

    def _turned(self, j: int, part: Update, belief: Belief) -> Belief:
        """The belief of one model, of which its filter's update kept what was believed before the ranges."""
        before, after = (part.kept[0], part.kept[1]), _gaussian(belief)
        return Belief(*turned(self.switching.motions[j], before, after))

    def _carried(self, belief: Belief) -> tuple[Floats, list[Gaussian]]:
        if belief.chance is None:
            return self.switching.begun(belief.state, belief.known_covariance)
        return belief.chance, [_gaussian(one) for one in belief.parts]


def _gaussian(belief: Belief) -> Gaussian:
    return belief.state, belief.known_covariance
