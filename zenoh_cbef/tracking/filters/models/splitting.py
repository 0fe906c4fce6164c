"""Hypotheses that are too wide for a range to be straight across them are split, and so follow its bend."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.models.abreast import abreast
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard
from zenoh_cbef.tracking.filters.models.mixtures import NEVER, Priors, distinct, total
from zenoh_cbef.tracking.linalg import leading_trace, matvec, outer
from zenoh_cbef.tracking.switching import Switching

STAY = 6
"""How many hypotheses of a motion stay from step to step."""

MANY = 32
"""How many of their branches stay after each range: each may be split into three, and any range may be wrong."""

ROUGHLY, CLOSELY = 1, 2
"""How hypotheses are split: where a range bends over them by more than its noise, or by less, too (see `split`)."""

_PART = 0.5
"""By what part of what a hypothesis leaves open of a range that may bend over it."""

_TILT = 1e-6
"""By what share of all that is open an axis counts for less known than the next one: more than rounding leaves."""

NEAR = 1.0
"""The square of how many standard deviations apart two hypotheses are one: those of a split are farther apart."""


def begun_with(switching: Switching, belief: Belief) -> tuple[Floats, list[Priors]]:
    """Probabilities of the next step, and the hypotheses with which each motion begins it: of all motions before."""
    kept = [(one.memory[0], one.memory[1], one.memory[2]) for one in belief.parts]
    ahead, apart = switching.apart(belief.known_chance, kept)
    found = abreast(switching.motions, apart, lambda _, rows: distinct((rows[0], rows[1], rows[2]), STAY, NEAR))
    return ahead, [(one[0], one[1], one[2]) for one in found]


def staying(branches: Branches) -> Priors:
    """The hypotheses of a motion that stay, with logarithms of weights that sum up to one."""
    states, covariances, likelihood = distinct(branches.priors, STAY, NEAR)
    likelihood = likelihood - np.maximum.reduce(likelihood, axis=1)[:, None]
    weights = likelihood - np.log(total(np.exp(likelihood)))[:, None]
    return states, covariances, np.maximum(weights, NEVER)


def split(priors: Priors, heard: Heard, splits: int = CLOSELY, *, settled: bool = True) -> Priors:
    """Each hypothesis, or three in its place where one of the ranges bends too much over it.

        N(x, P)  ->  N(x, P - d d^T/2)/2 + N(x + d, P - d d^T/2)/4 + N(x - d, P - d d^T/2)/4,    d = P u/sqrt(u^T P u)

    with mean and covariance as before. u is the direction in which the position is the least known, by the standard
    deviation s. A range at a distance l bends by s^2 sin^2/(2 l) along it. One Gaussian that has taken in such a range
    fills the sphere of which the range tells, and gets no smaller by the next ones, each of which bends over it. As
    Gaussians of many hypotheses follow the sphere, later ranges choose between them (Alspach and Sorenson, IEEE TAC
    17(4), 1972). Splitting goes on from step to step, as long as it has to.

    splits: CLOSELY also where a range bends by less than its noise, but by more than half of what the hypothesis leaves
    open of it. What one range does not show many do: how far a target is from few receivers is soon known far better
    than by a single range, and their spheres leave a straight line by more than that. 0: none is split.

    settled: whether, of several directions in which as little is known, the one nearest to the first axes is taken. By
    rules before the 23rd the last digits decide, which differ between processors.
    """
    if not splits:
        return priors
    state, covariance, likelihood = priors
    axes = heard.place.shape[2]
    known = np.ascontiguousarray(covariance[:, :, :axes, :axes])
    sizes, along = _widest(known, settled=settled)
    wide = np.maximum(sizes, np.finfo(np.float64).tiny)
    closely = splits == CLOSELY
    most = _PART if closely else 1.0
    bends = _bend(state[:, :, :axes], known if closely else None, wide, along, heard) > most
    bends &= likelihood > 0.5 * NEVER
    if not bends.any():
        return priors
    longer = np.zeros_like(state)
    longer[:, :, :axes] = along
    away = np.where(bends, 1.0 / np.sqrt(wide), 0.0)[:, :, None] * matvec(covariance, longer)
    narrower = covariance - 0.5 * outer(away, away)
    middle = likelihood - np.where(bends, np.log(2.0), 0.0)
    beside = np.where(bends, likelihood - np.log(4.0), NEVER)
    return (
        np.concatenate([state, state + away, state - away], axis=1),
        np.concatenate([narrower, narrower, narrower], axis=1),
        np.concatenate([middle, beside, beside], axis=1),
    )


def _widest(known: Floats, *, settled: bool) -> tuple[Floats, Floats]:
    """The largest variance (n, k), m^2, of covariances (n, k, axes, axes), and its direction (n, k, axes)."""
    if not settled:
        sizes, directions = np.linalg.eigh(known)
        return sizes[:, :, -1], directions[:, :, :, -1]
    axes = known.shape[-1]
    tilt = leading_trace(known, axes)[:, :, None, None] * np.diag(_TILT * np.arange(axes, 0.0, -1.0))
    along = np.linalg.eigh(known + tilt)[1][:, :, :, -1]
    # The library gives a direction or its opposite, and which of two branches comes first decides between equals.
    largest = np.abs(along).argmax(axis=2)[:, :, None]
    along = along * np.sign(np.take_along_axis(along, largest, axis=2))
    return np.add.reduce(along * matvec(known, along), axis=2), along


def _bend(place: Floats, known: Floats | None, wide: Floats, along: Floats, heard: Heard) -> Floats:
    """The most that any range bends over hypotheses, (n, k), in units of its noise, or of what is known of it if less.

    place: (n, k, axes). known: (n, k, axes, axes), m^2; None: noise alone counts. wide: (n, k), m^2, the variance along
    a direction, (n, k, axes).
    """
    most = np.zeros_like(wide)
    for agent in range(heard.range.shape[1]):
        away = place - heard.place[:, None, agent]
        square = np.add.reduce(away * away, axis=2) + heard.height[:, agent, None]
        noise = heard.variance[:, agent, None]
        square = np.maximum(square, noise)
        across = 1.0 - np.add.reduce(away * along, axis=2) ** 2 / square
        unit = noise if known is None else np.minimum(noise, np.add.reduce(away * matvec(known, away), axis=2) / square)
        bend = 0.5 * wide * across / np.sqrt(square * np.maximum(unit, np.finfo(np.float64).tiny))
        most = np.maximum(most, np.where(np.isfinite(heard.range[:, agent, None]), bend, 0.0))
    return most
