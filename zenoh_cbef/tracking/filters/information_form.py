"""What the information filters share: the information in ranges, its packing, and the way back to a belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.weighing import saturation, weigh
from zenoh_cbef.tracking.linalg import (
    BY_LIBRARY,
    LEAST,
    Inversion,
    inverse,
    matvec,
    neighbour_sum,
    outer,
    pack_upper,
    sound_rows,
    unpack_upper,
)
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Measurement, Space, differenced_rows, filled, own_range

_CLEARLY = 0.01
"""Factor by which a condition number must lie below the limit so that rounding cannot matter."""

_ROUNDING = 1e-9
"""How much averaging a value with itself may change it by rounding, relative to the largest component."""


@dataclass(frozen=True)
class RangeInformation:
    """The information of ranges, for a prior x.

    vector: u, (n, s), see the functions that make it. matrix: U = sum w H^T H / sigma^2, (n, s, s). diagnostics: of
    the own range's innovation, (n,).
    """

    vector: Floats
    matrix: Floats
    diagnostics: Diagnostics


def told(measured: Bools, innovation: Floats, weight: Floats, spread: Floats) -> Diagnostics:
    """Diagnostics of one range's innovation (n,), m, of predicted standard deviation `spread` (n,), m.

    measured: (n,), whether there is a range. weight: (n,), the innovation's saturation gain.
    """
    size, square = np.abs(innovation), (innovation / spread) ** 2
    return Diagnostics.where(
        measured, innovation=size, weight=weight, nis=square, nis_degrees=measured.astype(np.int64)
    )


def predict(motion: Motion, belief: Belief) -> tuple[Floats, Floats]:
    """Prior state (n, s) and covariance (n, s, s) of a step."""
    return motion.predict_state(belief.state), motion.predict_covariance(belief.known_covariance, belief.state)


def own_information(
    space: Space,
    state: Floats,
    covariance: Floats,
    measurement: Measurement,
    *,
    range_std: float,
    xi: float,
    power: int = 1,
    widens: float = 0.0,
    outliers: Errors | None = None,
) -> RangeInformation:
    """Information of the agent's own range, linearised at the prior and saturated.

        s = sqrt(H P H^T + sigma^2),  z = r - h(x),  w = min(1, xi s/|z|)^power
        u = w H^T (z + H x)/sigma^2,  U = w H^T H / sigma^2

    state: (n, s), covariance: (n, s, s), the prior. range_std: sigma, m, unless the measurement
    says otherwise. xi: saturation level in standard deviations. power: see `saturation`. widens: see
    `saturated_precision`. outliers: of which the scenario tells, where they decide in place of the saturation.
    """
    predicted, row = own_range(space, state, measurement.position, measurement.age)
    measured = np.isfinite(measurement.range)
    missing = ~measured
    innovation = measurement.range - predicted
    innovation[missing] = 0.0
    variance = variance_of(measurement, range_std)
    spread = _spread(row, covariance, variance)
    informs = informing(measurement, variance)
    errors = None if outliers is None else outliers.among(measurement.wrong)
    weighed = weigh(innovation, spread, variance, measured, informs, xi=xi, power=power, widens=widens, outliers=errors)
    return RangeInformation(
        weighed.along(innovation + np.add.reduce(row * state, axis=1))[:, None] * row,
        weighed.precision[:, None, None] * (row[:, :, None] * row[:, None]),
        told(measured, innovation, weighed.weight, spread),
    )


def variance_of(measurement: Measurement, range_std: float) -> Floats:
    """Variance of the own range's noise, (n,), m^2: the measurement's where it has one, otherwise the filter's."""
    known = measurement.range_std
    return np.array([range_std**2]).repeat(len(measurement.range)) if known is None else known**2


def informing(measurement: Measurement, variance: Floats) -> Floats:
    """The variance (n,), m^2, with which the own range informs: its noise's, times how often the range is counted."""
    for often in (measurement.lasting, measurement.overcounted):
        variance = variance if often is None else variance * often
    return variance


def _spread(row: Floats, covariance: Floats, variance: float | Floats) -> Floats:
    """Predicted standard deviation of the own range's innovation, (n,), m."""
    return np.asarray(np.sqrt(np.add.reduce(row * (covariance @ row[:, :, None])[:, :, 0], axis=1) + variance))


def neighbourhood_information(
    space: Space, state: Floats, covariance: Floats, measurement: Measurement, *, range_std: float
) -> RangeInformation:
    """Information of the agent's own and its neighbours' ranges, all linearised at the agent's own prior.

        u = sum_j H_j^T (r_j - h_j(x))/sigma^2,  U = sum_j H_j^T H_j / sigma^2,  j = i and the neighbours delivered

    The vector is of innovations, y - U x in the usual notation. One beacon is heard by all at once, so neighbours'
    ranges are as old as the agent's own.
    """
    count, size = state.shape
    positions = np.concatenate([measurement.position[:, None], measurement.neighbour_position], axis=1)
    ranges = np.concatenate([measurement.range[:, None], measurement.neighbour_range], axis=1)
    width = ranges.shape[1]
    predicted, rows = own_range(
        space, np.repeat(state, width, axis=0), positions.reshape(-1, 3), np.repeat(measurement.age, width)
    )
    measured = np.isfinite(ranges)
    innovation = np.where(measured, ranges - predicted.reshape(count, width), 0.0)
    precision = np.where(measured, 1.0 / range_std**2, 0.0)
    spread = _spread(rows.reshape(count, width, size)[:, 0], covariance, range_std**2)
    vectors = (precision * innovation)[:, :, None] * rows.reshape(count, width, size)
    matrices = precision[:, :, None] * outer(rows, rows).reshape(count, width, size * size)
    return RangeInformation(
        neighbour_sum(vectors),
        neighbour_sum(matrices).reshape(count, size, size),
        told(measured[:, 0], innovation[:, 0], np.ones(count), spread),
    )


def differenced_information(
    space: Space,
    state: Floats,
    covariance: Floats,
    measurement: Measurement,
    *,
    range_std: float,
    xi: float,
    power: int = 1,
) -> RangeInformation:
    """Information of the paper's differenced rows with their exact covariance, saturated as a whole.

        row j:  H_j = [h_j, -age h_j],  h_j = (p_j - p_i)^T;   z_j = y_j - H_j x
        R = sigma^2 (r_i^2 11^T + diag r_j^2) + sigma^4/2 (11^T + I)
        u = w H^T R^-1 (z + H x),  U = w H^T R^-1 H,  w = min(1, xi/sqrt(z^T (H P H^T + R)^-1 z / m))^power

    R is a diagonal D and a rank one term a 11^T, so R^-1 = D^-1 - a D^-1 11^T D^-1/(1 + a 1^T D^-1 1), and only sums
    over neighbours are needed. The measured ranges stand for the true ones in R. Rows of different agents share
    noise, and row j at agent i is minus row i at agent j: their information must not be added up over agents.
    innovation: root mean square of z whitened, which has no unit. m: rows there are this step.
    """
    rows, right, present = differenced_rows(space, measurement)
    count, variance = present.sum(axis=1), range_std**2
    rows = filled(np.concatenate([rows, -measurement.age[:, None, None] * rows], axis=2), state.shape[1])
    innovation = np.where(present, right - np.sum(rows * state[:, None, :], axis=2), 0.0)
    ranges = measurement.range, measurement.neighbour_range
    common, spread = (variance * np.nan_to_num(each) ** 2 + 0.5 * variance**2 for each in ranges)
    precision = np.where(present, 1.0 / spread, 0.0)
    damping = common / (1.0 + common * neighbour_sum(precision))
    width, size = rows.shape[1:]
    squares = outer(rows.reshape(-1, size), rows.reshape(-1, size)).reshape(-1, width, size * size)
    mean_row, mean = neighbour_sum(precision[:, :, None] * rows), neighbour_sum(precision * innovation)
    matrix = neighbour_sum(precision[:, :, None] * squares).reshape(-1, size, size)
    matrix -= damping[:, None, None] * outer(mean_row, mean_row)
    vector = neighbour_sum((precision * innovation)[:, :, None] * rows) - (damping * mean)[:, None] * mean_row
    # The matrix inversion lemma brings the innovation's covariance down to the state's size.
    remaining = inverse(inverse(covariance) + matrix)
    nis = neighbour_sum(precision * innovation * innovation) - damping * mean * mean
    nis = np.maximum(nis - np.sum(vector * matvec(remaining, vector), axis=1), 0.0)
    deviation = np.sqrt(nis / np.maximum(count, 1))
    weight = saturation(deviation, np.full_like(deviation, xi), power)
    return RangeInformation(
        weight[:, None] * (vector + matvec(matrix, state)),
        weight[:, None, None] * matrix,
        Diagnostics.where(count > 0, innovation=deviation, weight=weight, nis=nis, nis_degrees=count.astype(np.int64)),
    )


def packed_size(size: int) -> int:
    """Numbers in an information vector and the upper triangle of its matrix."""
    return size + size * (size + 1) // 2


def pack(vector: Floats, matrix: Floats) -> Floats:
    """Information vectors (n, s) and matrices (n, s, s) as payloads (n, s + s(s+1)/2)."""
    count, size = vector.shape
    packed = np.empty((count, size + size * (size + 1) // 2))
    packed[:, :size], packed[:, size:] = vector, pack_upper(matrix)
    return packed


def belief_of(payload: Floats, own: Floats, size: int, share: int = 1, inversion: Inversion = BY_LIBRARY) -> Belief:
    """State O^-1 V and covariance O^-1/m of packed information, of which the whole has `share` times as much, m.

    Accelerated averaging weighs some agents negatively, the more so where messages are lost, so now and then
    the result is no information matrix. The agent then keeps to its own, as if all messages had been lost.
    """
    matrices = unpack_upper(payload[:, size:], size)
    covariance = _surely_sound(matrices, inversion)
    if covariance is not None:
        return Belief(matvec(covariance, payload[:, :size]), covariance / share)
    payload = np.where(sound_rows(matrices)[:, None], payload, own)
    covariance = inversion.inverse(unpack_upper(payload[:, size:], size))
    return Belief(matvec(covariance, payload[:, :size]), covariance / share)


def _surely_sound(matrices: Floats, inversion: Inversion) -> Floats | None:
    """The inverses of matrices (n, s, s); None unless all are clearly positive definite and well conditioned.

    The product of a matrix's Frobenius norm and its inverse's is no less than its condition number. With whether it can
    be factored that takes a fifth of the time of eigenvalues, and decides the same.
    """
    inverted = inversion.if_definite(matrices)
    if inverted is None:
        return None
    flat, back = matrices.reshape(len(matrices), -1), inverted.reshape(len(inverted), -1)
    sizes = np.vecdot(flat, flat) * np.vecdot(back, back)
    return inverted if np.logical_and.reduce(sizes < (_CLEARLY / LEAST) ** 2) else None


def unless_alone(belief: Belief, payload: Floats, update: Update) -> Belief:
    """The belief; for agents whose payload no neighbour changed in the whole step, the prior that the update kept.

    An agent that heard no neighbour would count its own range n times. Even if it counted the range once, one range a
    step would make it too sure of itself, as its linearisation moves with the estimate. So it goes on by prediction,
    whose covariance is right, until it hears a neighbour again.
    """
    if not update.kept:
        return belief
    alone, (state, covariance) = unchanged(payload, update.payload), update.kept
    if not alone.nonzero()[0].size:
        return belief
    return Belief(
        np.where(alone[:, None], state, belief.state),
        np.where(alone[:, None, None], 0.5 * (covariance + covariance.swapaxes(1, 2)), belief.known_covariance),
    )


def unchanged(payload: Floats, own: Floats) -> Bools:
    """Which agents' payloads (n, d) no neighbour changed in the whole step: (n,)."""
    if len(own) == 1:
        # Of one agent two sums of squares nearly always tell that some number is surely far off.
        gaps, numbers = (payload - own).ravel(), own.ravel()
        if gaps.dot(gaps) > 4.0 * _ROUNDING**2 * gaps.size * numbers.dot(numbers):
            return np.zeros(1, dtype=bool)
    first = np.abs(payload[:, 0] - own[:, 0]) <= _ROUNDING * np.fmax.reduce(np.abs(own), axis=None)
    if not first.nonzero()[0].size:  # In most batches the first numbers tell.
        return np.asarray(first)
    near = np.abs(payload - own) <= _ROUNDING * np.maximum.reduce(np.abs(own), axis=1)[:, None]
    return np.asarray(np.logical_and.reduce(near, axis=1))
