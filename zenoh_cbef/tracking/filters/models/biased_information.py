"""The information-weighted consensus filter that estimates the constant bias of every agent's ranges."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Bias, Sharing, Tied, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    informing,
    pack,
    packed_size,
    told,
    unless_alone,
    variance_of,
)
from zenoh_cbef.tracking.filters.models.mixtures import wider
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.weighing import saturated_precision, saturation
from zenoh_cbef.tracking.linalg import inverse, matvec, outer
from zenoh_cbef.tracking.mirroring import Plane, mirrored, turned
from zenoh_cbef.tracking.motion import LinearMotion, beside_constants, linear
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

FORGETTING = 0.004
"""By how much, relatively, one more range widens the variance of an own bias: it follows the last few hundred."""


def forgetting(settings: FilterSettings) -> float:
    """The same by these settings: nothing where the scenario tells that biases are constant, and how large."""
    return 0.0 if settings.told_biases else FORGETTING


_LEAST = 1e-9
"""Least variance of a bias given the state, over the range noise's."""


@dataclass(frozen=True)
class BiasedInformation:
    """sicf or icf with ranges r_i = |p - p_i| + c + d_i + v_i: a bias c common to the network, an own part d_i.

    The network shares x = (p, v, c). An agent keeps its d_i to itself, with its variance and its covariance with x,
    so messages do not grow with the network. Given x, other agents' ranges say nothing of d_i. So agent i describes
    d_i by its distribution given x, and removes it from its own range exactly:

        d_i | x ~ N(a + b^T x, s)              b = P^-1 cov(x, d_i),  s = var(d_i) - b^T cov(x, d_i)
        F = H + b,  z = r - h(x) - c - d_i     innovation of variance S = F P F^T + s + sigma^2
        w = min(1, xi sqrt(S)/|z|)^power           a saturated range has the noise sigma^2/w
        V_i = P^-1 x/n + F^T (z + F x)/(s + sigma^2/w),   O_i = P^-1/n + F^T F/(s + sigma^2/w)
        g = s/(s + sigma^2/w);   a <- a + g (z + F x),  b <- b - g F,  s <- (1 - g) s
        after averaging V and O as in icf:  d_i = a + b^T x,  cov(x, d_i) = P b,  var(d_i) = s + b^T P b

    This is the joint Kalman filter of (x, d_i) at each agent. What it leaves out is that d_i and d_j, both learned
    against the same x, are correlated given x; that is small where the target moves. Because of it the variance of
    d_i is widened a little with every range, up to the prior's.

    range_std: sigma (m). network_size: n. common_std, own_std: priors of c and d_i, m. xi: saturation level in standard
    deviations. power: 1 bounds the pull of an outlier, 2 lets it fall (redescending). widens: see
    `saturated_precision`. forgetting: see FORGETTING. apart, most: see `JointBiases`.
    """

    motion: LinearMotion
    space: Space
    range_std: float
    network_size: int
    common_std: float
    own_std: float
    xi: float = np.inf
    power: int = 1
    widens: float = 0.0
    forgetting: float = FORGETTING
    apart: bool = False
    most: float = np.inf

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Information vector and the upper triangle of the information matrix of (p, v, c)."""
        size = settings.motion.size + 1
        return Sharing(packed_size(size), cooperates=settings.network_size > 1, blocks=(size,))

    @classmethod
    def of(cls, settings: FilterSettings, xi: float) -> Self:
        """The filter of these settings. xi: saturation level in standard deviations."""
        return cls(
            motion=linear(settings.motion),
            space=settings.space,
            range_std=settings.range_std,
            network_size=settings.network_size,
            common_std=settings.common_bias_std,
            own_std=settings.own_bias_std,
            xi=xi,
            power=settings.power,
            widens=settings.widens,
            forgetting=forgetting(settings),
            apart=settings.whole_biases,
            most=settings.most_bias,
        )

    @cached_property
    def _dynamics(self) -> tuple[Floats, Floats]:
        return beside_constants(self.motion, 1)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the network's information on (p, v, c); kept: its own bias given that, (a, b, s)."""
        state, covariance, own, own_variance, cross = self._predicted(belief)
        measured = np.isfinite(measurement.range)
        variance = variance_of(measurement, self.range_std)
        widened = np.minimum((1.0 + self.forgetting) * own_variance, np.maximum(own_variance, self.own_std**2))
        own_variance = np.where(measured, widened, own_variance)
        information = inverse(covariance)
        slope = matvec(information, cross)
        given = np.maximum(own_variance - np.sum(slope * cross, axis=1), _LEAST * variance)
        predicted, row = own_range(self.space, state[:, :-1], measurement.position, measurement.age)
        row = np.concatenate([row, np.ones_like(row[:, :1])], axis=1) + slope
        innovation = np.where(measured, measurement.range - predicted - state[:, -1] - own, 0.0)
        spread = np.sqrt(np.sum(row * matvec(covariance, row), axis=1) + given + variance)
        weight = saturation(innovation, self.xi * spread, self.power)
        informs = informing(measurement, variance)
        noise = given + informs / weight
        if self.widens:
            noise = given + 1.0 / saturated_precision(weight, informs, spread, widens=self.widens)
        precision = np.where(measured, 1.0 / noise, 0.0)
        equivalent = innovation + np.sum(row * state, axis=1)
        share = information / self.network_size
        payload = pack(
            matvec(share, state) + (precision * equivalent)[:, None] * row,
            share + precision[:, None, None] * outer(row, row),
        )
        gain = precision * given
        offset = own - np.sum(slope * state, axis=1) + gain * equivalent
        return Update(
            payload,
            told(measured, innovation, weight, spread),
            (offset, slope - gain[:, None] * row, (1.0 - gain) * given, state, covariance),
        )

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State and covariance from the averaged information, and the own bias that goes with them."""
        offset, slope, given, *prior = update.kept
        averaged = belief_of(payload, update.payload, self.motion.size + 1)
        averaged = Belief(averaged.state, averaged.known_covariance / self.network_size)
        if self.network_size > 1:
            averaged = unless_alone(averaged, payload, replace(update, kept=tuple(prior)))
        state, covariance = averaged.state, averaged.known_covariance
        cross = matvec(covariance, slope)
        own = offset + np.sum(slope * state, axis=1)
        own_variance = given + np.sum(slope * cross, axis=1)
        total = np.maximum(covariance[:, -1, -1] + 2.0 * cross[:, -1] + own_variance, 0.0)
        return Belief(
            np.ascontiguousarray(state[:, :-1]),
            np.ascontiguousarray(covariance[:, :-1, :-1]),
            Bias.constant(state[:, -1] + own, np.sqrt(total)),
            (state, covariance, own, own_variance, cross),
        )

    def moved(self, memory: tuple[Floats, ...], place: Belief) -> tuple[Floats, ...]:
        """What a belief carries on, at another place; biases stay as they are, unless they are beyond belief."""
        state, covariance, own, own_variance, cross = (np.array(each) for each in memory)
        wrong = np.abs(state[:, -1] + own) > self.most
        state[wrong, -1], covariance[wrong, -1, -1] = 0.0, self.common_std**2
        own[wrong], own_variance[wrong], cross[wrong] = 0.0, self.own_std**2, 0.0
        state[:, :-1], cross[:, :-1] = place.state, 0.0
        covariance[:, :-1] = covariance[:, :, :-1] = 0.0
        covariance[:, :-1, :-1] = place.known_covariance
        return state, covariance, own, own_variance, cross

    def mirrored(self, memory: tuple[Floats, ...], plane: Plane) -> tuple[Floats, ...]:
        """The mirror image of what a belief carries on; biases stay as they are."""
        state, covariance, own, own_variance, cross = memory
        image, spread = mirrored(state, covariance, plane)
        return image, spread, own, own_variance, turned(cross, plane)

    def widened(self, memory: tuple[Floats, ...], factor: Floats) -> tuple[Floats, ...]:
        """The same with the covariance of all but biases multiplied by factors (n,)."""
        state, covariance, own, own_variance, cross = memory
        if self.apart:
            return state, wider(covariance, factor, self.motion.size), own, own_variance, cross
        scale = np.repeat(np.sqrt(factor)[:, None], state.shape[1], axis=1)
        scale[:, -1] = 1.0  # The common bias.
        covariance = covariance * (scale[:, :, None] * scale[:, None, :])
        return state, covariance, own, own_variance, cross * scale

    def _predicted(self, belief: Belief) -> tuple[Floats, ...]:
        """State (n, s + 1) and covariance of (p, v, c), mean and variance (n,) of d_i, their covariance (n, s + 1)."""
        state, covariance, own, own_variance, cross = belief.memory or self._prior(belief)
        transition, noise = self._dynamics
        covariance = transition @ covariance @ transition.T + noise
        return matvec(transition, state), covariance, own, own_variance, matvec(transition, cross)

    def _prior(self, belief: Belief) -> tuple[Floats, ...]:
        count, size = belief.state.shape
        covariance = np.zeros((count, size + 1, size + 1))
        covariance[:, :size, :size] = belief.known_covariance
        covariance[:, size, size] = self.common_std**2
        state, none = np.pad(belief.state, ((0, 0), (0, 1))), np.zeros((count, size + 1))
        if not isinstance(tied := belief.tied, Tied):
            return state, covariance, np.zeros(count), np.full(count, self.own_std**2), none
        cross = matvec(belief.known_covariance, tied.slope)
        own = tied.offset + np.sum(tied.slope * belief.state, axis=1)
        return state, covariance, own, tied.given + np.sum(tied.slope * cross, axis=1), np.pad(cross, ((0, 0), (0, 1)))
