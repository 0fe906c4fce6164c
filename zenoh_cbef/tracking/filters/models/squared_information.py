"""The information-weighted consensus filter on squared ranges, which the network linearises after it has averaged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    pack,
    packed_size,
    predict,
    told,
    unless_alone,
    variance_of,
)
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.weighing import saturated_precision, saturation
from zenoh_cbef.tracking.linalg import inverse, matvec, outer, unpack_upper
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space


@dataclass(frozen=True)
class SquaredInformation:
    """sicf or icf on squared ranges, linear in the position u and in e = |u|^2, both counted from one point for all.

    A range is not linear in the position, so in sicf each agent linearises its own at its own prior. Where priors are
    wide that fails in two ways: agents linearise at different points, and what all ranges bend alike is counted by
    each of them as its own. Here nothing is linearised before it is averaged. For an agent at b and a beacon t old,

        r_i^2 = |u - t v - b|^2 + noise = e - 2 b^T u + |b|^2 - 2 t v^T (u - b) + t^2 |v|^2 + noise

    is linear in (x, e) but for the terms in t, which are small and linearised at the prior. So the payload is sicf's, V
    and O, of a state that is longer by e, of which no prior says anything. What averaging leaves is the likelihood of
    all ranges. Agents linearise that, each at its prior N(x, P), and these are nearly the same:

        e = c + G x + d,   c + G x = |u|^2 + tr P_u about the prior,   G = 2 u^T,   d ~ N(0, 2 tr P_u^2)

    the statistical linear regression of e on x (Garcia-Fernandez et al., IEEE TSP 63(20), 2015), here in closed form. d
    is one number for the whole network; it is eliminated, and x has the information

        n (O_xx + O_xe G + G^T O_ex + a G^T G) - h h^T/(1/var d + n a),   a = O_ee,  h = n (O_xe + a G^T)

    The noise of r_i^2 has the variance (4 l^2 + 2 sigma^2) sigma^2 and the mean sigma^2, at the distance l that prior
    and range together say, with gain K. As l has K of the range's noise, the mean is (1 - 4 K) sigma^2 to second order.
    The innovation that is saturated is the square's, r_i^2 - E r_i^2 over the root of 4 l^2 + 2 sigma^2.

    range_std: sigma (m). network_size: n. middle: the point from which u is counted, m, near all agents. xi, power,
    widens: as in sicf. least: ranges below it, m, are none.
    """

    motion: Motion
    space: Space
    range_std: float
    network_size: int
    middle: tuple[float, ...]
    xi: float = np.inf
    power: int = 1
    widens: float = 0.0
    least: float = -np.inf
    ties: bool = False

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Information vector and the upper triangle of the information matrix of (x, e)."""
        size = settings.motion.size + 1
        return Sharing(packed_size(size), cooperates=settings.network_size > 1, blocks=(size,))

    @classmethod
    def of(cls, settings: FilterSettings, xi: float) -> Self:
        """The filter of these settings. xi: saturation level in standard deviations."""
        return cls(
            settings.motion,
            settings.space,
            settings.range_std,
            settings.network_size,
            settings.middle,
            xi,
            settings.power,
            settings.widens,
            settings.least,
            settings.ties,
        )

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the network's information on (x, e)."""
        size = self.motion.size
        state, covariance = predict(self.motion, belief)
        ranged = self._ranged(state, covariance, measurement)
        prior = inverse(covariance) / self.network_size
        matrix = ranged.precision[:, None, None] * outer(ranged.row, ranged.row)
        vector = (ranged.precision * ranged.value)[:, None] * ranged.row
        matrix[:, :size, :size] += prior
        vector[:, :size] += matvec(prior, self._centred(state))
        return Update(pack(vector, matrix), ranged.told, (state, covariance))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State and covariance from the averaged information, linearised about the prior."""
        state, covariance = update.kept
        belief = self._believed(payload, update, Belief(state, covariance))
        if self.ties:
            # About a wide prior e is as good as free; again about what was found, where e is linear over that.
            axes, size = self.space.axes, self.motion.size
            again = self._believed(payload, update, belief)
            _, bend = _moments(belief.known_covariance[:, :axes, :axes])
            known = self.network_size * unpack_upper(payload[:, size + 1 :], size + 1)[:, size, size]
            straight = bend * np.maximum(known, 0.0) < 1.0
            belief = chosen(belief, again, straight)
        return unless_alone(belief, payload, update) if self.network_size > 1 else belief

    def _believed(self, payload: Floats, update: Update, about: Belief) -> Belief:
        """What the average says, linearised about a belief."""
        own = self._linearised(update.payload, about)
        belief = belief_of(self._linearised(payload, about), own, self.motion.size)
        return Belief(self._centred(belief.state, -1.0), belief.covariance)

    def _centred(self, state: Floats, sign: float = 1.0) -> Floats:
        """States (n, s) with the position counted from the middle, or with sign -1 back."""
        centred = state.copy()
        centred[:, : self.space.axes] -= sign * np.array(self.middle)
        return centred

    def _ranged(self, state: Floats, covariance: Floats, measurement: Measurement) -> _Ranged:
        """The agent's own range, squared, at a prior."""
        axes, size = self.space.axes, self.motion.size
        measured = np.isfinite(measurement.range) & (measurement.range >= self.least)
        ranges = np.where(measured, measurement.range, 0.0)
        age, variance = measurement.age[:, None], variance_of(measurement, self.range_std)
        place, velocity = self._centred(state)[:, :axes], state[:, axes : 2 * axes]
        agent = measurement.position[:, :axes] - np.array(self.middle)
        away = place - age * velocity - agent
        height = np.zeros(len(state))
        if self.space.height is not None:
            height = (self.space.height - measurement.position[:, 2]) ** 2
        row = np.zeros((len(state), size + 1))
        row[:, :axes] = -2.0 * (agent + age * velocity)
        row[:, axes : 2 * axes] = -2.0 * age * away
        row[:, size] = 1.0
        late = 2.0 * age * place * velocity - (age * velocity) ** 2
        value = ranges**2 - height - np.add.reduce(late + agent * agent, axis=1)
        slope = np.zeros((len(state), size))
        slope[:, :axes], slope[:, axes : 2 * axes] = away, -age * away
        spread, bend = _moments(covariance[:, :axes, :axes])
        square = np.add.reduce(away * away, axis=1) + height + spread
        uncertain = np.add.reduce(slope * matvec(covariance, slope), axis=1) + 0.25 * bend
        distance, uncertain = np.sqrt(square), uncertain / square
        innovation, deviation = np.where(measured, ranges - distance, 0.0), np.sqrt(uncertain + variance)
        gain = uncertain / (uncertain + variance)
        value += (4.0 * gain - 1.0) * variance
        unit = np.sqrt(4.0 * (distance + gain * innovation) ** 2 + 2.0 * variance)
        pull = np.where(measured, (ranges**2 - square) / unit, 0.0)
        weight = saturation(pull, self.xi * deviation, self.power)
        weighed = np.where(measured, weight, 0.0)
        precision = saturated_precision(weighed, unit**2 * variance, unit * deviation, widens=self.widens)
        return _Ranged(row, value, precision, told(measured, innovation, weight, deviation))

    def _linearised(self, payload: Floats, prior: Belief) -> Floats:
        """The network's information on x, packed, from an average of that on (x, e)."""
        axes, size = self.space.axes, self.motion.size
        total = self.network_size * payload
        vector, matrix = total[:, : size + 1], unpack_upper(total[:, size + 1 :], size + 1)
        place = self._centred(prior.state)[:, :axes]
        spread, bend = _moments(prior.known_covariance[:, :axes, :axes])
        slope = np.zeros((len(payload), size))
        slope[:, :axes] = 2.0 * place
        level = spread - np.add.reduce(place * place, axis=1)
        # Accelerated averaging weighs some agents negatively.
        known, cross = np.maximum(matrix[:, size, size], 0.0), matrix[:, :size, size]
        tilt, offset = cross + known[:, None] * slope, known * level - vector[:, size]
        damping = bend / (1.0 + known * bend)
        mixed = outer(cross, slope)
        information = matrix[:, :size, :size] + mixed + mixed.swapaxes(1, 2)
        information += known[:, None, None] * outer(slope, slope) - damping[:, None, None] * outer(tilt, tilt)
        right = vector[:, :size] - level[:, None] * cross - offset[:, None] * slope
        return pack(right + (damping * offset)[:, None] * tilt, information)


@dataclass(frozen=True)
class _Ranged:
    """A range as a row (n, s + 1) of a linear equation, its value and precision (n,), and what is said of it."""

    row: Floats
    value: Floats
    precision: Floats
    told: Diagnostics


def _moments(covariance: Floats) -> tuple[Floats, Floats]:
    """Mean and variance (n,) of |w|^2 of deviations w with covariances (n, axes, axes)."""
    axes = range(covariance.shape[1])
    flat = covariance.reshape(len(covariance), -1)
    return np.add.reduce(covariance[:, axes, axes], axis=1), 2.0 * np.add.reduce(flat * flat, axis=1)
