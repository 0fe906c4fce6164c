"""What an agent says of its own range, before those of the others come."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.information_form import told
from zenoh_cbef.tracking.filters.models.branching import Branches, Heard, likelihoods
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
