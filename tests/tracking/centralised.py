"""Agents so far from a target that their ranges are linear in it, and the Kalman filter that hears all of them."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.filters import Belief, FilterSettings
from zenoh_cbef.tracking.motion import NearlyConstantVelocity, begun
from zenoh_cbef.tracking.motion.acceleration import NearlyConstantAcceleration
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

COUNT, STD, DT, AGE, HEIGHT = 4, 0.1, 0.5, 0.05, 2.0
NEVER_WRONG = 1e-30, 1.0
PLACES = 1e4 * np.array([[-9.0, -7, 3], [8, -6, -5], [7, 8, 2], [-6, 9, -7]])
WIDE = np.diag([0.5, 0.6, 0.7, 1.0, 0.8, 0.9]) ** 2
MOTION = NearlyConstantVelocity(DT, 0.5, 3)
ACCELERATION = NearlyConstantAcceleration(DT, 0.5, 3)


def settings_of(motion=MOTION, bias=0.0, count=COUNT, **more):
    space = Space() if motion.axes == 3 else Space(HEIGHT)
    keys = {"outliers": NEVER_WRONG, "middle": (1.0, -2.0, 0.5)[: motion.axes], **more}
    own = {"tells_ranges": True, "own_bias_std": bias, "joint_biases": bias > 0.0}
    return FilterSettings(motion, space, STD, np.inf, count, **own, **keys)


def switching(*models, leaving=0.1):
    """Settings of a target that switches between motions."""
    return {"models": models, "leaving": (leaving,)}


def where(state, axes):
    """Where a target was when its beacon was emitted."""
    return np.append(state[:axes] - AGE * state[axes : 2 * axes], () if axes == 3 else HEIGHT)


def heard(state, random, missing=(), *, axes=3, std=None, bias=0.0):
    """Ranges of all agents, of a target in this state when they arrive."""
    ranges = np.linalg.norm(where(state, axes) - PLACES, axis=1) + bias + STD * random.normal(size=COUNT)
    ranges[list(missing)] = np.nan
    return Measurement(
        PLACES, ranges, np.full(COUNT, AGE), *no_neighbours(COUNT), range_std=std, agent=np.arange(COUNT)
    )


def expected(prior, new, agent, size=6):
    """Innovation, row and variance of an agent's range; after the motion's components there may be biases."""
    (mean, covariance), axes = prior, 3 if size % 3 == 0 else 2
    offset = where(mean, axes) - PLACES[agent]
    distance, row, bias = np.linalg.norm(offset), np.zeros(len(mean)), 0.0
    row[:axes], row[axes : 2 * axes] = offset[:axes] / distance, -AGE * offset[:axes] / distance
    if len(mean) > size:
        row[size + agent], bias = 1.0, mean[size + agent]
    noise = STD if new.range_std is None else new.range_std[agent]
    return new.range[agent] - distance - bias, row, row @ covariance @ row + noise**2


def kalman(prior, new, size=6):
    """Mean, covariance and log likelihood with all ranges that came."""
    (mean, covariance), likelihood = prior, 0.0
    for agent in np.flatnonzero(np.isfinite(new.range)):
        off, row, variance = expected((mean, covariance), new, agent, size)
        gain = covariance @ row / variance
        mean, covariance = mean + gain * off, covariance - np.outer(gain, row @ covariance)
        likelihood -= 0.5 * (off**2 / variance + np.log(2.0 * np.pi * variance))
    return mean, covariance, likelihood


def ahead(motion, mean, covariance):
    """A step later; biases stay."""
    step, noise = np.eye(len(mean)), np.zeros_like(covariance)
    step[: motion.size, : motion.size], noise[: motion.size, : motion.size] = motion.transition, motion.process_noise
    return step @ mean, step @ covariance @ step.T + noise


def whole(motion, mean, covariance, bias=0.0):
    """What a motion has beside position and velocity, and biases of all agents, if there are any."""
    (mean,), (covariance,) = begun(motion, mean[None], covariance[None])
    size, more = len(mean), COUNT * (bias > 0.0)
    covariance = np.pad(covariance, ((0, more), (0, more)))
    covariance[range(size, size + more), range(size, size + more)] = bias**2
    return np.pad(mean, (0, more)), covariance


def guesses_of(random, mean, covariance, off=0.2):
    """All agents' first beliefs."""
    states = mean + off * random.normal(size=(COUNT, len(mean)))
    return Belief(states, np.repeat(covariance[None], COUNT, axis=0))


def step_of(filter_, belief, new, weights=None):
    """What agents believe after a step in which payloads are averaged, with these weights (n, n) or all the same."""
    update = filter_.update(belief, new)
    mixed = (np.full((COUNT, COUNT), 1.0 / COUNT) if weights is None else weights) @ update.payload
    return filter_.conclude(mixed, update)


def weights_of(random):
    """Rows of weights that add up to one, as rounds that were cut short leave them."""
    weights = random.uniform(0.05, 1.0, size=(COUNT, COUNT))
    return weights / weights.sum(axis=1, keepdims=True)


def same(found, mean, covariance, *, agents=slice(None)):
    """All agents, or some, believe this."""
    size = found.state.shape[1]
    for each, one in ((found.state, mean[:size]), (found.covariance, covariance[:size, :size])):
        np.testing.assert_allclose(each[agents], np.broadcast_to(one, each[agents].shape), atol=2e-4)


def mixture(share, parts):
    """Mean and covariance of position and velocity, of several Gaussians."""
    mean = sum(one * part[0][:6] for one, part in zip(share, parts, strict=True))
    spread = sum(
        one * (part[1][:6, :6] + np.outer(part[0][:6] - mean, part[0][:6] - mean))
        for one, part in zip(share, parts, strict=True)
    )
    return mean, spread
