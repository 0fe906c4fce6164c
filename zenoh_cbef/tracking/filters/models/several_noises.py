"""One motion of which the noise is in doubt: a filter for each of several noises, on what one of them exchanges."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Filter, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import unchanged
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec, outer
from zenoh_cbef.tracking.motion import LinearMotion, Predicted, linear
from zenoh_cbef.tracking.ranging import Measurement, unheard
from zenoh_cbef.tracking.switching import to_noises


@dataclass(frozen=True)
class SeveralNoises:
    """An interacting multiple model filter whose models differ in their noise alone; messages are hardly longer.

    Agents exchange what their ranges tell, about the mixture N(x, P) of all models' predictions, and x. What a single
    filter makes of that, N(x+, P+), tells each agent the likelihood of all the network's ranges:

        L(x + d) ~ exp(v^T d - d^T U d/2),   U = P+^-1 - P^-1,   v = P+^-1 (x+ - x)

    Each model j takes that in, with its own prediction N(x + d_j, P_j), and tells how likely the ranges are:

        P_j+ = (P_j^-1 + U)^-1,   d_j+ = P_j+ (P_j^-1 d_j + v)
        -2 log m_j = d_j^T P_j^-1 d_j - d_j+^T P_j+^-1 d_j+ + log det P_j - log det P_j+ + what all have in common

    That is what each model's own filter has, where ranges are as good as straight over what predictions leave open. In
    sicf a message has all of an agent's prior, and so agents agree on it. Of several priors it would make what they
    disagree about a measurement, which a model of much noise follows too far. So here agents agree on x alone, and move
    all models by what theirs is off.

    Models mix at each step as in Blom and Bar-Shalom (IEEE TAC 33(8), 1988). Where the target takes to all other noises
    alike, model j begins with two parts: the mixture of all models, and its own.

    filter: of one motion, which takes its belief for a prediction. motions: linear ones, alike but for their noise.
    leaving: the probability that the target takes to another noise, in a step; nearer: rather to a near one (see
    `to_noises`).
    """

    filter: Filter
    motions: tuple[LinearMotion, ...]
    leaving: float
    nearer: bool = False

    @classmethod
    def sharing(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Sharing]) -> Sharing:
        """What a filter of one noise exchanges, and a state; no matrix of it is positive definite."""
        return replace(of_one(settings).longer(settings.motion.size), blocks=())

    @classmethod
    def of(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Filter]) -> Self:
        """The filter of these settings; of_one: makes the filter of one motion."""
        motion = settings.motion
        predicted = Predicted(motion.dt, motion.acceleration_std, motion.axes)
        motions = tuple(linear(one) for one in settings.noises)
        return cls(of_one(replace(settings, motion=predicted)), motions, settings.leaving[0], settings.nearer)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """What the own range tells about the mixture of all predictions, and that mixture's mean."""
        ahead, means, spreads = self._predicted(belief)
        state, covariance = _mixture(ahead, means, spreads)
        prior = Belief(state, covariance)
        told, silent = (self.filter.update(prior, one) for one in (measurement, unheard(measurement)))
        payload = np.concatenate([told.payload - silent.payload, state], axis=1)
        return Update(payload, told.diagnostics, (ahead, means, spreads, state, covariance), (silent,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """All models' beliefs, weighed anew; of an agent that heard no neighbour, their predictions."""
        (ahead, means, spreads, state, covariance), (silent,) = update.kept, update.parts
        size, alone = state.shape[1], unchanged(payload, update.payload)[:, None]
        found = self.filter.conclude(silent.payload + np.where(alone, 0.0, payload[:, :-size]), silent)
        off = np.where(alone, 0.0, payload[:, -size:] - state)
        after = inverse(found.known_covariance)
        gained, told = after - inverse(covariance), matvec(after, found.state - state)
        known, away = inverse(spreads), means + (off - state)[:, None]
        posterior = inverse(known + gained[:, None])
        vector = matvec(known, away) + told[:, None]
        moved = matvec(posterior, vector)
        cost = np.add.reduce(away * matvec(known, away) - moved * vector, axis=2)
        misfit = cost + np.linalg.slogdet(spreads)[1] - np.linalg.slogdet(posterior)[1]
        chance = ahead * np.exp(-0.5 * (misfit - np.minimum.reduce(misfit, axis=1)[:, None]))
        chance /= np.add.reduce(chance, axis=1)[:, None]
        return self._believed(chance, state[:, None] + moved, posterior)

    def moved(self, belief: Belief, place: Belief) -> Belief:
        """A belief of this filter at another place; all noises are as likely as at first."""
        count = len(self.motions)
        means, spreads = (np.repeat(one[:, None], count, axis=1) for one in (place.state, place.known_covariance))
        begun = self._believed(np.full(means.shape[:2], 1.0 / count), means, spreads)
        return replace(belief, state=place.state, covariance=place.covariance, chance=begun.chance, parts=begun.parts)

    def _believed(self, chance: Floats, means: Floats, spreads: Floats) -> Belief:
        models = range(len(self.motions))
        parts = (Belief(np.ascontiguousarray(means[:, j]), np.ascontiguousarray(spreads[:, j])) for j in models)
        return Belief(*_mixture(chance, means, spreads), chance=chance, parts=tuple(parts))

    def _predicted(self, belief: Belief) -> tuple[Floats, Floats, Floats]:
        """How likely the models are, (n, M), and what each predicts, (n, M, s) and (n, M, s, s)."""
        carried = self.moved(belief, belief) if belief.chance is None else belief
        means = np.stack([one.state for one in carried.parts], axis=1)
        spreads = np.stack([one.known_covariance for one in carried.parts], axis=1)
        begun = self._near if self.nearer else self._alike
        ahead, begin, whole = begun(carried.known_chance, means, spreads)
        transition = self.motions[0].transition
        noise = np.stack([one.process_noise for one in self.motions])
        return ahead, matvec(transition, begin), transition @ whole @ transition.T + noise

    def _near(self, chance: Floats, means: Floats, spreads: Floats) -> tuple[Floats, Floats, Floats]:
        """How likely the models are a step later, and what each begins it with: a mixture of all, its own."""
        moves = chance[:, :, None] * to_noises(self.motions, self.leaving)
        ahead = np.add.reduce(moves, axis=1)
        begin, whole = np.empty_like(means), np.empty_like(spreads)
        for j in range(len(self.motions)):
            begin[:, j], whole[:, j] = _mixture(moves[:, :, j] / ahead[:, j, None], means, spreads)
        return ahead, begin, whole

    def _alike(self, chance: Floats, means: Floats, spreads: Floats) -> tuple[Floats, Floats, Floats]:
        """The same where the target takes to all other noises alike."""
        mean, spread = _mixture(chance, means, spreads)
        other = self.leaving / (len(self.motions) - 1)
        stays = (1.0 - self.leaving - other) * chance
        ahead = stays + other
        own = (stays / ahead)[:, :, None]
        begin = own * means + (1.0 - own) * mean[:, None]
        apart, away = (outer(one, one) for one in (means - begin, mean[:, None] - begin))
        own = own[..., None]
        return ahead, begin, own * (spreads + apart) + (1.0 - own) * (spread[:, None] + away)


def _mixture(chance: Floats, means: Floats, spreads: Floats) -> tuple[Floats, Floats]:
    """Mean (n, s) and covariance (n, s, s) of M Gaussians, (n, M, s) and (n, M, s, s), with weights (n, M)."""
    mean = np.add.reduce(chance[:, :, None] * means, axis=1)
    apart = means - mean[:, None]
    return mean, np.add.reduce(chance[:, :, None, None] * (spreads + outer(apart, apart)), axis=1)
