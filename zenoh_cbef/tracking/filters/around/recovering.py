"""A network that has lost its target finds it again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.auto_bias import AutoBias
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping, resumed
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.imm import InteractingModels
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.ranging import Measurement

_IMPLAUSIBLE = 9.0
"""Innovations of more than three of their own standard deviations are, by the chi-squared law, 1 in 370."""

_INFLATION = 4.0
"""By how much the covariance grows in a step: standard deviations double."""


@dataclass(frozen=True)
class Recovering(Wrapping):
    """Any filter that saturates, with one number more in its payload: whether its own innovation is implausible.

        y_i = [NIS_i > 9] - share where a range was measured, otherwise 0
        P_i <- 4 P_i where the average of y is positive

    Saturation cannot tell an outlier from a wrong prior by one range. The network can: outliers hit some agents, a
    wrong prior gives most agents implausible innovations. A larger covariance allows larger innovations, so the
    widening ends once they fit. Agents decide from the same average, except for the disagreement that consensus left;
    an agent that decides differently has a covariance that is too large, which does no harm. Biases do not jump with
    the target: their variances stay, and their covariances with the state (see `JointBiases`).

    share: outliers hit some agents; where more than this share has an implausible innovation, the prior is wrong.
    """

    share: float

    more = 1

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, and the number."""
        update = self.filter.update(belief, measurement)
        nis = update.diagnostics.nis
        number = np.where(np.isfinite(nis), (np.nan_to_num(nis) > _IMPLAUSIBLE) - self.share, 0.0)
        return replace(update, payload=np.concatenate([update.payload, number[:, None]], axis=1))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, with a larger covariance where most innovations were implausible."""
        belief = self.filter.conclude(payload[:, :-1], replace(update, payload=update.payload[:, :-1]))
        return widened(self.filter, belief, np.where(payload[:, -1] > 0.0, _INFLATION, 1.0))

    def resumed(self, belief: Belief) -> Belief:
        """The belief that the inner filter carries from step to step; recovery adds nothing to it."""
        return resumed(self.filter, belief)


def widened(chosen: Filter, belief: Belief, factor: Floats) -> Belief:
    """A filter's belief with the covariance of all but biases multiplied by factors (n,), in all that it carries on."""
    wide = replace(belief, covariance=belief.known_covariance * factor[:, None, None])
    if isinstance(chosen, AutoBias):
        plain, biased = belief.parts
        return replace(wide, parts=(widened(chosen.plain, plain, factor), widened(chosen.biased, biased, factor)))
    if isinstance(chosen, BiasedInformation | JointBiases):
        return replace(wide, memory=chosen.widened(belief.memory, factor))
    if isinstance(chosen, InteractingModels) and belief.chance is not None:
        parts = tuple(widened(*each, factor) for each in zip(chosen.filters, belief.parts, strict=True))
        return Belief(*chosen.mixture(belief.chance, parts), chance=belief.chance, parts=parts)
    return wide
