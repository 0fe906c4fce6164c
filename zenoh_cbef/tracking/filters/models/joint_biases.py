"""The information-weighted consensus filter of a few agents that estimate all biases together, in the shared state."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Bias, Shared, Sharing, Tied, Update
from zenoh_cbef.tracking.filters.information_form import (
    belief_of,
    informing,
    pack,
    packed_size,
    told,
    unless_alone,
    variance_of,
)
from zenoh_cbef.tracking.filters.models.mixtures import elsewhere, wider
from zenoh_cbef.tracking.filters.rows import Rows
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.filters.weighing import weigh
from zenoh_cbef.tracking.linalg import inverse, matvec, outer
from zenoh_cbef.tracking.mirroring import Plane, mirrored
from zenoh_cbef.tracking.motion import LinearMotion, beside_constants, linear
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Measurement, Space, own_range

MOST = 12
"""The most agents of which all biases travel in each message: its length grows with the square of their number."""

LEAST = 1e-9
"""Least variance of a bias, and of one given the state, over the range noise's."""


@dataclass(frozen=True)
class JointBiases:
    """sicf or icf with ranges r_i = |p - p_i| + d_i + v_i and constant biases d_i, all in the state.

    A priori d_i ~ N(0, beta^2), and where biases have a common part, cov(d) = beta^2 I + gamma^2 1 1^T.

    The network shares y = (p, v, d_1 ... d_n), so nothing is left out of a centralised Kalman filter: biases that were
    learned against the same p are correlated, and where steps are long, so that p is little known beforehand, that
    matters most. A filter whose agents keep their biases to themselves takes them for independent, and becomes too sure
    of all of them at a wrong place.

        V_i = P^-1 y/n + w F^T (z + F y)/sigma^2,   O_i = P^-1/n + w F^T F/sigma^2,   F = (H, e_i)

    averaged and concluded as in sicf. An agent begins with what it alone knows: the fix N(x, P), which is the
    network's, and d_i | x ~ N(a + b^T x, s) of its own ranges, (0, 0, beta^2) without them. So in the first step

        V_i = (P^-1 x/n, 0) + a T^T/s + ...,   O_i = (P^-1/n, 0) + T^T T/s + ...,   T = (-b, e_i)

    Where biases have a common part, it is in all that a fix says of the target. So an agent begins with its part of
    what all ranges of the fix say of (x, d), and the n-th part of the prior of d. By earlier rules it was as if no
    bias had been in the fix, and all began with the same state and prior.

    Ranges may also all be too long by the same share, where the speed of the wave, a clock or the map's unit is a
    little off. Then y ends with that share s ~ N(0, scale_std^2):

        r_i = (1 + s) |p - p_i| + d_i + v_i,   F = ((1 + s) H, e_i, |p - p_i|)

    The bias that an agent tells is what it takes off its range: d_i + s |p - p_i|.

    range_std: sigma (m). network_size: n. own_std, common_std: beta and gamma, m. xi: saturation level in standard
    deviations. power, widens, outliers: as in sicf. scale_std: 0 where ranges have no share in common. apart: whether
    a target that may be elsewhere says nothing of biases; by earlier rules their correlations with it stayed. most:
    from what size on a bias is beyond belief, m, so that another fix forgets all.
    """

    motion: LinearMotion
    space: Space
    range_std: float
    network_size: int
    own_std: float
    xi: float = np.inf
    power: int = 1
    widens: float = 0.0
    outliers: Errors | None = None
    common_std: float = 0.0
    scale_std: float = 0.0
    apart: bool = False
    most: float = np.inf

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """Information vector and the upper triangle of the information matrix of (p, v) and all biases."""
        size = settings.motion.size + settings.network_size + (settings.scale_std > 0.0)
        return Sharing(packed_size(size), cooperates=settings.network_size > 1, blocks=(size,))

    @classmethod
    def of(cls, settings: FilterSettings, xi: float) -> Self:
        """The filter of these settings. xi: saturation level in standard deviations."""
        return cls(
            motion=linear(settings.motion),
            space=settings.space,
            range_std=settings.range_std,
            network_size=settings.network_size,
            own_std=settings.own_bias_std,
            xi=xi,
            power=settings.power,
            widens=settings.widens,
            outliers=settings.weighed,
            common_std=settings.common_bias_std,
            scale_std=settings.scale_std,
            apart=settings.whole_biases,
            most=settings.most_bias,
        )

    @property
    def _constants(self) -> int:
        return self.network_size + (self.scale_std > 0.0)

    @cached_property
    def _dynamics(self) -> tuple[Floats, Floats]:
        return beside_constants(self.motion, self._constants)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The agent's share of the network's information on (p, v, d)."""
        own = self._own(measurement)
        state, covariance, begins = belief.memory or self._begun(belief, own)
        transition, noise = self._dynamics
        state = matvec(transition, state)
        covariance = transition @ covariance @ transition.T + noise
        if isinstance(belief.tied, Shared):
            vector, matrix = self._told(belief.tied, own)
        else:
            vector, matrix = self._share(state, covariance, begins > 0.0, own)
        size = self.motion.size
        measured = np.isfinite(measurement.range)
        variance = variance_of(measurement, self.range_std)
        distance, gradient = own_range(self.space, state[:, :size], measurement.position, measurement.age)
        bias_row = np.zeros_like(state)
        bias_row[np.arange(len(state)), size + own] = 1.0
        row = bias_row.copy()
        row[:, :size] = gradient
        if self.scale_std:
            row[:, :size] *= 1.0 + state[:, -1:]
            bias_row[:, -1] = row[:, -1] = distance
        bias = np.add.reduce(bias_row * state, axis=1)
        innovation = np.where(measured, measurement.range - distance - bias, 0.0)
        spread = np.sqrt(np.add.reduce(row * matvec(covariance, row), axis=1) + variance)
        weighed = weigh(
            *(innovation, spread, variance, measured, informing(measurement, variance)),
            xi=self.xi,
            power=self.power,
            widens=self.widens,
            outliers=self.outliers,
        )
        along = weighed.along(innovation + np.add.reduce(row * state, axis=1))
        payload = pack(vector + along[:, None] * row, matrix + weighed.precision[:, None, None] * outer(row, row))
        kept = state, covariance, bias_row, begins
        return Update(payload, told(measured, innovation, weighed.weight, spread), kept)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """State, covariance and biases from the averaged information, of which the network has n times as much."""
        *prior, bias_row, begins = update.kept
        own = update.payload
        if np.count_nonzero(begins):
            # An agent that begins knows of no other's bias but the prior: it has that where it hears not of all.
            own = np.where(begins[:, None] > 0.0, pack(*self._known(prior[0], prior[1])), own)
        averaged = belief_of(payload, own, self.motion.size + self._constants)
        averaged = Belief(averaged.state, averaged.known_covariance / self.network_size)
        if self.network_size > 1:
            averaged = unless_alone(averaged, payload, replace(update, kept=tuple(prior)))
        state, covariance = averaged.state, averaged.known_covariance
        if self.common_std and np.count_nonzero(begins):
            covariance = covariance + begins[:, None, None] * self._dynamics[1]
        size = self.motion.size
        variance = np.add.reduce(bias_row * matvec(covariance, bias_row), axis=1)
        bias, std = np.add.reduce(bias_row * state, axis=1), np.sqrt(np.maximum(variance, 0.0))
        share = state[:, -1].copy() if self.scale_std else np.zeros(len(state))
        return Belief(
            np.ascontiguousarray(state[:, :size]),
            np.ascontiguousarray(covariance[:, :size, :size]),
            Bias(bias, std, np.ones(len(state)), share),
            (state, covariance, np.zeros_like(begins)),
        )

    def _begun(self, belief: Belief, own: Rows) -> tuple[Floats, Floats, Floats]:
        """What an agent knows that has an estimate of the target, and perhaps a tied bias: state, covariance, 1."""
        size, count = self.motion.size, np.arange(len(belief.state))
        state = np.pad(belief.state, ((0, 0), (0, self._constants)))
        covariance = np.zeros((len(state), state.shape[1], state.shape[1]))
        covariance[:, size:, size:] = self._prior
        covariance[:, :size, :size] = belief.known_covariance
        if isinstance(tied := belief.tied, Tied):
            cross, place = matvec(belief.known_covariance, tied.slope), size + own
            state[count, place] = tied.offset + np.add.reduce(tied.slope * belief.state, axis=1)
            covariance[count, place, :size] = covariance[count, :size, place] = cross
            covariance[count, place, place] = tied.given + np.add.reduce(tied.slope * cross, axis=1)
        # A prior of what all biases have in common is known to all, and no agent's own.
        alone = isinstance(tied, Shared) or not self.common_std
        return state, covariance, np.full(len(state), float(alone))

    @cached_property
    def _prior(self) -> Floats:
        """Covariance of what does not change, before the first range."""
        prior = np.diag(np.full(self._constants, self.scale_std**2))
        biases = slice(0, self.network_size)
        own = max(self.own_std**2, LEAST * self.range_std**2)
        prior[biases, biases] = self.common_std**2 + own * np.eye(self.network_size)
        return prior

    def moved(self, memory: tuple[Floats, ...], place: Belief) -> tuple[Floats, ...]:
        """What a belief carries on, at another place; biases stay as they are, unless one is beyond belief."""
        state, covariance = elsewhere((memory[0], memory[1]), place)
        size, count = self.motion.size, self.network_size
        wrong = (np.abs(state[:, size : size + count]) > self.most).any(axis=1)
        state[wrong, size:], covariance[wrong, size:, size:] = 0.0, self._prior
        return state, covariance, np.array(memory[2])

    def mirrored(self, memory: tuple[Floats, ...], plane: Plane) -> tuple[Floats, ...]:
        """The mirror image of what a belief carries on; biases stay as they are."""
        return *mirrored(memory[0], memory[1], plane), memory[2]

    def widened(self, memory: tuple[Floats, ...], factor: Floats) -> tuple[Floats, ...]:
        """The same with the covariance of the target multiplied by factors (n,)."""
        state, covariance, begins = memory
        if self.apart:
            return state, wider(covariance, factor, self.motion.size), begins
        scale = np.ones_like(state)
        scale[:, : self.motion.size] = np.sqrt(factor)[:, None]
        return state, covariance * (scale[:, :, None] * scale[:, None, :]), begins

    def _share(self, state: Floats, covariance: Floats, begins: Bools, own: Rows) -> tuple[Floats, Floats]:
        """The agent's share of what the network knew before its ranges: vector and matrix."""
        vector, matrix = self._known(state, covariance)
        if not np.count_nonzero(begins):
            return vector, matrix
        size, count, place = self.motion.size, np.arange(len(state)), self.motion.size + own
        known = inverse(covariance[:, :size, :size])
        cross = covariance[count, place, :size]
        slope = matvec(known, cross)
        given = covariance[count, place, place] - np.add.reduce(slope * cross, axis=1)
        precision = 1.0 / np.maximum(given, LEAST * self.range_std**2)
        row = np.zeros_like(state)
        row[:, :size], row[count, place] = -slope, 1.0
        first = precision[:, None, None] * outer(row, row)
        first[:, :size, :size] += known / self.network_size
        alone = (precision * np.add.reduce(row * state, axis=1))[:, None] * row
        alone[:, :size] += matvec(known, state[:, :size]) / self.network_size
        return np.where(begins[:, None], alone, vector), np.where(begins[:, None, None], first, matrix)

    def _told(self, shared: Shared, own: Rows) -> tuple[Floats, Floats]:
        """The same where a first fix tells of biases that have a common part, with the n-th part of their prior.

        Of the fix's step; parts of information cannot allow for the motion since, which is added to what they make.
        """
        size, count = self.motion.size, len(own)
        total, kept = size + self._constants, size + 1 + (self.scale_std > 0.0)
        places = np.tile(np.arange(kept), (count, 1))
        places[:, size] += own
        places[:, size + 1 :] = total - 1
        back, rows = np.eye(kept), np.arange(count)[:, None]
        back[:size, :size] = np.linalg.inv(self.motion.transition)
        vector, matrix = np.zeros((count, total)), np.zeros((count, total, total))
        vector[rows, places] = shared.vector[:, :kept] @ back
        matrix[rows[:, :, None], places[:, :, None], places[:, None]] = back.T @ shared.matrix[:, :kept, :kept] @ back
        matrix[:, size:, size:] += inverse(self._prior[None]) / self.network_size
        return vector, matrix

    def _known(self, state: Floats, covariance: Floats) -> tuple[Floats, Floats]:
        """The n-th part of what a belief tells: vector and matrix."""
        matrix = inverse(covariance) / self.network_size
        return matvec(matrix, state), matrix

    def _own(self, measurement: Measurement) -> Rows:
        """The agents' places among the biases, (n,)."""
        if measurement.agent is None:
            raise ValueError("agents that estimate all biases together have to know their numbers")
        return measurement.agent.astype(np.intp) % self.network_size
