"""The measurement update by sigma points, iterated: batched over runs and hypotheses, written apart from the filters.

The iterated posterior linearisation filter of Garcia-Fernandez, Svensson, Morelande and Sarkka, IEEE TSP 63(20), 2015:
ranges are linearised statistically, first over the prior and then over the posterior that this gave, so neither a wide
prior nor a start that is off spoils the direction. The points are those of the cubature filter (Arasaratnam, Haykin,
IEEE TAC 54(6), 2009), and heavy tails are weights of Student's t.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats

_LEAST = 1e-150
_IMPOSSIBLE = -1e9
_CLIPPED = 9.0
"""The most that one range counts in how surprising a step was: three standard deviations, squared."""


@dataclass(frozen=True)
class Heard:
    """One step of r runs and n agents.

    anchor: (r, n, a), the agents along the estimated axes, m. off: (r, n), m^2, squared height of the agents above a
    known plane, else 0. range: (r, n), m, NaN where there is none. age: (r, n), s. variance: of the noise, m^2. heavy:
    degrees of freedom of Student's t, infinite for Gaussian noise. biased: whether states hold the agents' biases.
    """

    anchor: Floats
    off: Floats
    range: Floats
    age: Floats
    variance: float
    heavy: float
    biased: bool = False


@dataclass(frozen=True)
class Updated:
    """Posteriors of b hypotheses of each run.

    mean: (r, b, d). covariance: (r, b, d, d). evidence: (r, b), log likelihood of the ranges. surprise: (r, b), sum
    over ranges of the squared innovation in its own standard deviations, each clipped.
    """

    mean: Floats
    covariance: Floats
    evidence: Floats
    surprise: Floats


def square_root(matrices: Floats) -> Floats:
    """Lower Cholesky factors of (..., e, e); a matrix that is not positive definite gets the nearest small pivots."""
    size = matrices.shape[-1]
    root = np.zeros_like(matrices)
    for column in range(size):
        done = root[..., column, :column]
        pivot = matrices[..., column, column] - _dot(done, done)
        root[..., column, column] = np.sqrt(
            np.maximum(pivot, np.maximum(1e-14 * matrices[..., column, column], _LEAST))
        )
        below = matrices[..., column + 1 :, column] - _dot(root[..., column + 1 :, :column], done[..., None, :])
        root[..., column + 1 :, column] = below / root[..., column, column, None]
    return root


def _dot(one: Floats, other: Floats) -> Floats:
    """Sums of products over the last axis; einsum is fast where that is short."""
    return np.asarray(np.einsum("...i,...i->...", one, other))


def solved_below(root: Floats, right: Floats) -> Floats:
    """Solutions y of R y = b for lower triangles R (..., e, e) and right-hand sides b (..., e, k)."""
    found = np.empty((*root.shape[:-1], right.shape[-1]))
    for row in range(root.shape[-1]):
        done = np.einsum("...j,...jk->...k", root[..., row, :row], found[..., :row, :])
        found[..., row, :] = (right[..., row, :] - done) / root[..., row, row, None]
    return found


def update(mean: Floats, covariance: Floats, heard: Heard, passes: int) -> Updated:
    """Take in the ranges of a step. mean: (r, b, d), position, velocity, the n biases if any, and what moves it.

    In information form: no matrix has a row and a column for each range, so a thousand agents are not beyond reach.
    """
    gaussian = bool(np.isinf(heard.heavy))
    found, spread, surprise = mean, covariance, np.zeros(mean.shape[:2])
    prior, size = square_root(covariance), mean.shape[2]
    odd: Floats | None = None
    for _ in range(passes):
        step = _Linear.of(found, spread, heard)
        innovation = np.where(step.known, heard.range[:, None] - step.at(mean, found), 0.0)
        seen = np.concatenate([step.rows @ prior, step.rest], axis=3)
        if odd is None:
            odd = innovation**2 / (_dot(seen, seen) + heard.variance)
            surprise = np.minimum(odd, _CLIPPED).sum(axis=2)
        noise = heard.variance if gaussian else heard.variance * (heard.heavy + odd) / (heard.heavy + 1.0)
        noise = np.where(step.known, noise, 1.0)
        weighed = np.swapaxes(seen / noise[..., None], 2, 3)
        # Precision of what is unknown, in its own prior standard deviations: the state, and what is not linear.
        root = square_root(weighed @ seen + np.eye(seen.shape[3]))
        fit = solved_below(root, weighed @ innovation[..., None])
        gain = prior @ np.swapaxes(solved_below(root, np.eye(seen.shape[3])[:, :size]), 2, 3)
        found = mean + (gain @ fit)[..., 0]
        spread = gain @ np.swapaxes(gain, 2, 3)
        if not gaussian:
            odd = _oddness(found, spread, heard)
    pivots = np.diagonal(root, axis1=2, axis2=3)
    cost = np.sum(innovation**2 / noise + np.log(noise), axis=2)
    cost += np.sum(2.0 * np.log(pivots) - fit[..., 0] ** 2, axis=2)
    evidence = -0.5 * (cost + step.known.sum(axis=2) * np.log(2.0 * np.pi))
    sound = np.isfinite(evidence) & np.isfinite(found).all(axis=2) & np.isfinite(spread).all(axis=(2, 3))
    return Updated(
        np.where(sound[..., None], found, np.nan_to_num(mean)),
        np.where(sound[..., None, None], spread, covariance),
        np.where(sound, evidence, _IMPOSSIBLE),
        surprise,
    )


def _oddness(mean: Floats, covariance: Floats, heard: Heard) -> Floats:
    """Expected squared errors of the ranges under posteriors, in units of their noise, (r, b, n)."""
    step = _Linear.of(mean, covariance, heard)
    left = _dot(step.rows @ covariance, step.rows) + _dot(step.rest, step.rest)
    return np.asarray(np.where(step.known, (heard.range[:, None] - step.centre) ** 2 + left, 0.0) / heard.variance)


@dataclass(frozen=True)
class _Linear:
    """Ranges by statistical linear regression over b hypotheses of each run; rows and rest are zero where none is.

    known: (r, 1, n). centre: (r, b, n), expected ranges. rows: (r, b, n, d). rest: (r, b, n, a), a root of the
    covariance of what is not linear: its product with its own transpose.
    """

    known: Bools
    centre: Floats
    rows: Floats
    rest: Floats

    def at(self, mean: Floats, found: Floats) -> Floats:
        """Ranges that are expected at means (r, b, d), where the regression is about `found`."""
        return np.asarray(self.centre + _dot(self.rows, (mean - found)[:, :, None]))

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, heard: Heard) -> _Linear:
        """About means (r, b, d) with covariances (r, b, d, d)."""
        axes, (runs, many, size) = heard.anchor.shape[2], mean.shape
        root = square_root(covariance[..., :axes, :axes])
        away = np.sqrt(axes) * np.swapaxes(root, 2, 3)
        points = np.concatenate([away, -away], axis=2)
        place = mean[:, :, None, :axes] - heard.age[:, None, :, None] * mean[:, :, None, axes : 2 * axes]
        offset = points[:, :, :, None] + (place - heard.anchor[:, None])[:, :, None]
        distance = np.sqrt(_dot(offset, offset) + heard.off[:, None, None])
        slope = (distance[:, :, :axes] - distance[:, :, axes:]) / (2.0 * np.sqrt(axes))
        centre = distance.mean(axis=2)
        # Opposite points leave what is linear in their difference, and all the rest in their mean.
        apart = 0.5 * (distance[:, :, :axes] + distance[:, :, axes:]) - centre[:, :, None]
        rest = np.swapaxes(apart, 2, 3) / np.sqrt(axes)
        agents, known = heard.range.shape[1], np.isfinite(heard.range)[:, None]
        rows = np.zeros((runs, many, agents, size))
        rows[..., :axes] = np.swapaxes(slope, 2, 3) @ solved_below(root, np.broadcast_to(np.eye(axes), root.shape))
        rows[..., axes : 2 * axes] = -heard.age[:, None, :, None] * rows[..., :axes]
        if heard.biased:
            rows[..., 2 * axes : 2 * axes + agents] = np.eye(agents)
            centre = centre + mean[..., 2 * axes : 2 * axes + agents]
        return cls(known, centre, *(np.where(known[..., None], each, 0.0) for each in (rows, rest)))
