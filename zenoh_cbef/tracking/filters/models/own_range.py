"""What an agent says of its own range before those of the others come, and of its receiver after them."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Bias
from zenoh_cbef.tracking.filters.information_form import told
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard
from zenoh_cbef.tracking.filters.models.expecting import likelihoods
from zenoh_cbef.tracking.filters.rows import Rows


def said_of(prior: Branches, heard: Heard, own: Rows, outliers: tuple[float, float] | None) -> Diagnostics:
    """Innovation and its spread, and as weight whether the range is right.

    prior: one branch of each agent. heard: its range alone. own: the agents' numbers, (n,). outliers: see branching.py.
    """
    expected = prior.expected(heard, 0, own)
    right, wrong = (one[:, 0] for one in likelihoods(expected, heard.variance, outliers, prior.share))
    spread = np.sqrt(expected.total[:, 0]) / expected.unit[:, 0]
    innovation = expected.excess[:, 0] / expected.unit[:, 0]
    weight = 1.0 / (1.0 + np.exp(np.minimum(wrong - right, 500.0)))
    return told(np.isfinite(heard.range[:, 0]), innovation, weight, spread)


def about_target(state: Floats, covariance: Floats, size: int, own: Rows | None) -> Belief:
    """States (n, s) and covariances (n, s, s), the first components of which are about the target, as a belief.

    own: which bias after these is the agent's own, (n,); None: there are none.
    """
    bias = None
    if own is not None:
        rows, place = np.arange(len(state)), size + own
        bias = Bias.constant(state[rows, place], np.sqrt(np.maximum(covariance[rows, place, place], 0.0)))
    return Belief(np.ascontiguousarray(state[:, :size]), np.ascontiguousarray(covariance[:, :size, :size]), bias)
