"""Branches whose square is that of the position that they have found, and not only of what was expected of it."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard
from zenoh_cbef.tracking.linalg import matvec, outer


def tied(branches: Branches, heard: Heard) -> Branches:
    """Branches after the ranges of a step, with e tied to the position u ~ N(m, C) that these tell.

    Before the ranges e is tied to u by its regression about the prior. Where that is wide, e is as good as free, and
    one unknown more costs a third of the accuracy that six ranges have. So what the regression about the posterior says
    more than that about the prior is one more measurement:

        |m|^2 + tr C = e - 2 m^T (u - m),  of variance 1/a,   a = 1/(2 tr C^2) - 1/slack

    Likelihoods become those of branches that were tied so from the start. Where 2 tr C^2, what C leaves open of e, is
    more than what the ranges do, the posterior is no Gaussian, and a branch stays as it is.
    """
    if branches.slack is None:
        return branches
    axes, mean, size = branches.axes, branches.mean, branches.mean.shape[2] - 1
    place, known = mean[:, :, :axes], np.ascontiguousarray(branches.covariance[:, :, :axes, :axes])
    flat = known.reshape(*known.shape[:2], -1)
    excess = np.add.reduce(place * place, axis=2) - mean[:, :, size]
    for axis in range(axes):
        excess = excess + known[:, :, axis, axis]
    row = np.zeros_like(mean)
    row[:, :, :axes], row[:, :, size] = -2.0 * place, 1.0
    left = np.maximum(2.0 * np.add.reduce(flat * flat, axis=2), np.finfo(np.float64).tiny)
    straight = left * _precision(branches, heard) < 1.0
    more = np.where(straight, np.maximum(1.0 / left - 1.0 / branches.slack, 0.0), 0.0)
    cross = matvec(branches.covariance, row)
    spread = 1.0 + more * np.maximum(np.add.reduce(row * cross, axis=2), 0.0)
    gain = (more / spread)[:, :, None] * cross
    gained = np.log(np.where(more > 0.0, branches.slack / left, 1.0) / spread) - more * excess**2 / spread
    return replace(
        branches,
        mean=mean + gain * excess[:, :, None],
        covariance=branches.covariance - outer(gain, cross),
        likelihood=branches.likelihood + 0.5 * gained,
    )


def _precision(branches: Branches, heard: Heard) -> Floats:
    """Of e, (n, k), 1/m^4, as squared ranges tell it from a place that is known."""
    found = np.zeros_like(branches.likelihood)
    for agent in range(heard.range.shape[1]):
        away = branches.mean[:, :, : branches.axes] - heard.place[:, None, agent]
        square = np.add.reduce(away * away, axis=2) + heard.height[:, agent, None]
        variance = heard.variance[:, agent, None]
        there = np.isfinite(heard.range[:, agent, None])
        found += np.where(there, 1.0 / ((4.0 * square + 2.0 * variance) * variance), 0.0)
    return found
