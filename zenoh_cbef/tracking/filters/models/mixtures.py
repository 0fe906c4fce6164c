"""Mixtures of Gaussians, k of each of n agents: their moments, and which of them are one."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.filters.rows import Rows
from zenoh_cbef.tracking.linalg import matvec, outer, raw_inverse
from zenoh_cbef.tracking.motion import Motion, beside_constants, linear

Priors = tuple[Floats, Floats, Floats]
"""k states (n, k, s) and covariances (n, k, s, s), and logarithms of how likely they are, (n, k)."""

NEVER = -1e9
"""Logarithm of a likelihood that counts for nothing."""


def predicted(motion: Motion, whole: Priors, beside: int) -> Priors:
    """The same a step later. beside: how many constants stand beside the motion's state, which then is linear."""
    state, covariance, likelihood = whole
    states, covariances = state.reshape(-1, state.shape[2]), covariance.reshape(-1, *covariance.shape[2:])
    if beside:
        transition, noise = beside_constants(linear(motion), beside)
        ahead, spread = matvec(transition, states), transition @ covariances @ transition.T + noise
    else:
        ahead, spread = motion.predict_state(states), motion.predict_covariance(covariances, states)
    return ahead.reshape(state.shape), spread.reshape(covariance.shape), likelihood


def distinct(whole: Priors, count: int, near: float | None = None) -> Priors:
    """The likeliest of many, each merged with what is near it; the last one with all that are left.

    Where fewer are found, the others repeat the first one and are never right. near: the square of how many standard
    deviations of the likelier one are near; None: as many as there are states.
    """
    states, covariances, left = whole
    rows, found = np.arange(len(states)), np.full(left.shape, count)
    for turn in range(count):
        best = np.argmax(left, axis=1)
        away = states - states[rows, best][:, None]
        known = raw_inverse(covariances[rows, best])[:, None]
        close = np.add.reduce(away * matvec(known, away), axis=2) < (states.shape[2] if near is None else near)
        member = (close | (turn == count - 1)) & (left > NEVER)
        found[member] = turn
        left = np.where(member, NEVER, left)
    found[(found == count).all(axis=1), 0] = 0
    return _merged(whole, found, count)


def _merged(whole: Priors, group: Rows, count: int) -> Priors:
    """Mixtures of the Gaussians of each group, which are far fewer than all: group (n, k) from 0 on, `count`: none."""
    states, covariances, likelihood = whole
    size, of = states.shape[2], np.nonzero(group < count)
    where, shape = of[0] * count + group[of], (len(states), count)
    most = np.full(len(states) * count, -np.inf)
    np.maximum.at(most, where, likelihood[of])
    weight = np.exp(likelihood[of] - most[where])
    sum_ = _gathered(weight, where, len(most))
    weight /= sum_[where]
    state = _gathered(weight[:, None] * states[of], where, len(most))
    apart = states[of] - state[where]
    spread = outer(apart, apart)
    spread += covariances[of]
    spread *= weight[:, None, None]
    covariance = _gathered(spread, where, len(most))
    found = state.reshape(*shape, size), 0.5 * (covariance + covariance.swapaxes(1, 2)).reshape(*shape, size, size)
    none = np.isneginf(most).reshape(shape)
    for one in found:
        one[none] = one[:, :1].repeat(count, axis=1)[none]
    with np.errstate(divide="ignore"):
        return *found, np.where(none, NEVER, (most + np.log(sum_)).reshape(shape))


def _gathered(terms: Floats, where: Rows, count: int) -> Floats:
    """Sums of terms (m, ...) at their places, (count, ...), one after the other, so that they are those of `total`."""
    each = terms.reshape(len(terms), -1)
    places = where[:, None] * each.shape[1] + np.arange(each.shape[1])
    found = np.bincount(places.ravel(), each.ravel(), count * each.shape[1])
    return np.asarray(found, dtype=np.float64).reshape(count, *terms.shape[1:])


def mixture(states: Floats, covariances: Floats, likelihood: Floats) -> tuple[Floats, Floats, Floats]:
    """Mean (n, s) and covariance (n, s, s) of k Gaussians, and the logarithm of the likelihood of all, (n,)."""
    most = np.maximum.reduce(likelihood, axis=1)
    weight = np.exp(likelihood - most[:, None])
    sum_ = total(weight)
    weight /= sum_[:, None]
    state = total(weight[:, :, None] * states)
    apart = states - state[:, None]
    spread = outer(apart, apart)
    spread += covariances
    spread *= weight[:, :, None, None]
    covariance = total(spread)
    return state, 0.5 * (covariance + covariance.swapaxes(1, 2)), most + np.log(sum_)


def total(terms: Floats) -> Floats:
    """Over branches, one after the other, so that a row comes out the same in every batch.

    NumPy adds in pairs along the last axis alone.
    """
    if terms.ndim > 2:
        return np.asarray(np.add.reduce(terms, axis=1))
    found = terms[:, 0].copy()
    for branch in range(1, terms.shape[1]):
        found += terms[:, branch]
    return np.asarray(found)


def alike(state: Floats, covariance: Floats, count: int) -> Priors:
    """One prior, (n, s) and (n, s, s), and as many beside it as there is room for, that are never right."""
    likelihood = np.full((len(state), count), NEVER)
    likelihood[:, 0] = 0.0
    return np.repeat(state[:, None], count, axis=1), np.repeat(covariance[:, None], count, axis=1), likelihood


def elsewhere(known: tuple[Floats, Floats], place: Belief) -> tuple[Floats, Floats]:
    """Another place in the first components of what is known, (n, s) and (n, s, s); the others stay as they are."""
    state, covariance = (one.copy() for one in known)
    size = place.state.shape[1]
    state[:, :size] = place.state
    covariance[:, :size] = covariance[:, :, :size] = 0.0
    covariance[:, :size, :size] = place.known_covariance
    return state, covariance


def wider(covariance: Floats, factor: Floats, size: int) -> Floats:
    """Covariances (n, s, s) with that of the first components, so many, multiplied by factors (n,), m^2.

    What is added has nothing to do with the others. Were their correlations to stay, of a bias and a place whose sum
    is known, the next range would tell the bias from the place, of which it says nothing.
    """
    wide = covariance.copy()
    wide[:, :size, :size] *= factor[:, None, None]
    return wide
