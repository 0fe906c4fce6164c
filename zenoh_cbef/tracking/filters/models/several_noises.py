"""One motion of which the noise is in doubt: a filter for each of several noises, on what one of them exchanges."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Filter, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import unchanged
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Predicted
from zenoh_cbef.tracking.ranging import Measurement, unheard
from zenoh_cbef.tracking.switching import Gaussian, Switching, moments


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

    filter: of one motion, which takes its belief for a prediction.
    """

    filter: Filter
    switching: Switching

    @classmethod
    def sharing(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Sharing]) -> Sharing:
        """What a filter of one noise exchanges, and a state; no matrix of it is positive definite."""
        one = of_one(settings)
        return replace(one.longer(settings.motion.size), blocks=())

    @classmethod
    def of(cls, settings: FilterSettings, of_one: Callable[[FilterSettings], Filter]) -> Self:
        """The filter of these settings; of_one: makes the filter of one motion."""
        motion = settings.motion
        predicted = Predicted(motion.dt, motion.acceleration_std, motion.axes)
        return cls(of_one(replace(settings, motion=predicted)), Switching(settings.noises, settings.leaving))

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """What the own range tells about the mixture of all predictions, and that mixture's mean."""
        ahead, priors = self._predicted(belief)
        prior = Belief(*self._mixture(ahead, priors))
        told, silent = (self.filter.update(prior, one) for one in (measurement, unheard(measurement)))
        payload = np.concatenate([told.payload - silent.payload, prior.state], axis=1)
        kept = ahead, prior.state, prior.known_covariance, *(part for each in priors for part in each)
        return Update(payload, told.diagnostics, kept, (silent,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """All models' beliefs, weighed anew; of an agent that heard no neighbour, their predictions."""
        (ahead, state, covariance, *flat), (silent,) = update.kept, update.parts
        size, alone = state.shape[1], unchanged(payload, update.payload)[:, None]
        found = self.filter.conclude(silent.payload + np.where(alone, 0.0, payload[:, :-size]), silent)
        off = np.where(alone, 0.0, payload[:, -size:] - state)
        after = inverse(found.known_covariance)
        gained, told = after - inverse(covariance), matvec(after, found.state - state)
        beliefs, misfits = [], []
        for mean, spread in zip(flat[::2], flat[1::2], strict=True):
            known, away = inverse(spread), mean + off - state
            posterior = inverse(known + gained)
            vector = matvec(known, away) + told
            moved = matvec(posterior, vector)
            cost = np.add.reduce(away * matvec(known, away) - moved * vector, axis=1)
            misfits.append(cost + np.linalg.slogdet(spread)[1] - np.linalg.slogdet(posterior)[1])
            beliefs.append((state + moved, posterior))
        chance = self.switching.weighed(ahead, np.stack(misfits, axis=1))
        mixture = self._mixture(chance, beliefs)
        return Belief(*mixture, chance=chance, parts=tuple(Belief(*one) for one in beliefs))

    def moved(self, belief: Belief, place: Belief) -> Belief:
        """A belief of this filter at another place; all noises are as likely as at first."""
        state, covariance = place.state, place.known_covariance
        chance, beliefs = self.switching.begun(state, covariance)
        parts = tuple(Belief(*one) for one in beliefs)
        return replace(belief, state=state, covariance=covariance, chance=chance, parts=parts)

    def _predicted(self, belief: Belief) -> tuple[Floats, list[Gaussian]]:
        """How likely the models are, and what each predicts."""
        carried = self.moved(belief, belief) if belief.chance is None else belief
        beliefs = [(one.state, one.known_covariance) for one in carried.parts]
        ahead, mixed = self.switching.mixed(carried.known_chance, beliefs)
        return ahead, [
            (motion.predict_state(state), motion.predict_covariance(covariance, state))
            for motion, (state, covariance) in zip(self.switching.motions, mixed, strict=True)
        ]

    def _mixture(self, chance: Floats, beliefs: Sequence[Gaussian]) -> Gaussian:
        likely = self.switching.of_models(chance)
        return moments([likely[:, j] for j in range(len(beliefs))], list(beliefs))
