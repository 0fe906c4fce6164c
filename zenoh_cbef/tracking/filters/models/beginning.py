"""Where hypotheses about a target begin: at a guess, or anywhere else where it may be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.models.mixtures import Priors
from zenoh_cbef.tracking.mirroring import Plane, mirrored
from zenoh_cbef.tracking.motion import Motion, begun
from zenoh_cbef.tracking.switching import Gaussian

_DOUBT = 0.01
"""How likely it is beforehand that the guesses are wrong, and the target may be anywhere."""

_IMAGE = 0.1
"""How likely the mirror image of a guess is beside it: enough for what is claimed to hold both, until ranges tell."""


@dataclass(frozen=True)
class Beginning:
    """What is known before any range.

    motions: see `ToldRanges`. biases: how many stand beside the state of a single motion, own_std: of each, m.
    anywhere: where the target may be if the guesses are wrong, state (1, s) and covariance (1, s, s). plane: near which
    agents are; None: none.
    """

    motions: tuple[Motion, ...]
    biases: int
    own_std: float
    anywhere: tuple[Floats, Floats] | None
    plane: Plane | None = None

    def of(self, state: Floats, covariance: Floats) -> Gaussian:
        """A place with what else the single motion has, and biases of which nothing is known yet."""
        if state.shape[1] < self.motions[0].size:
            state, covariance = begun(self.motions[0], state, covariance)
        more, size = self.biases, state.shape[1]
        state = np.pad(state, ((0, 0), (0, more)))
        covariance = np.pad(covariance, ((0, 0), (0, more), (0, more)))
        covariance[:, range(size, size + more), range(size, size + more)] = self.own_std**2
        return state, covariance

    def elsewhere_too(self, motion: Motion, priors: Priors) -> Priors:
        """What is known of one motion, first, with where the target may be if the guesses are wrong, second.

        And third, where agents are near a plane, with the mirror image of the guess: both fit ranges for long, so a
        guess on the wrong side would be believed.
        """
        state, covariance, likelihood = (each.copy() for each in priors)
        if self.anywhere is not None:
            begins = begun(motion, *self._place) if len(self.motions) > 1 else self.of(*self._place)
            state[:, 1], covariance[:, 1], likelihood[:, 1] = *begins, np.log(_DOUBT)
        if self.plane is not None:
            image = mirrored(state[:, 0], covariance[:, 0], self.plane)
            state[:, 2], covariance[:, 2], likelihood[:, 2] = *image, likelihood[:, 0] + np.log(_IMAGE)
        return state, covariance, likelihood

    def elsewhere(self, count: int) -> Priors:
        """Where the target is, if it is where no hypothesis has it: one prior of each of so many agents."""
        state, covariance = (np.repeat(one, count, axis=0) for one in self.of(*self._place))
        return state[:, None], covariance[:, None], np.zeros((count, 1))

    @property
    def _place(self) -> Gaussian:
        if self.anywhere is None:
            raise ValueError("agents that seek have to know where the target may be")
        size = 2 * self.motions[0].axes
        return self.anywhere[0][:, :size], self.anywhere[1][:, :size, :size]
