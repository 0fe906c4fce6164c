"""What the agents of a network know together before the first step."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import start
from zenoh_cbef.scenario.plan import Plan


def known_together(plan: Plan) -> Floats:
    """Covariance of the mean of all agents' initial estimates, (s, s).

    Guesses of n agents that are independent of one another have a mean whose covariance is that of one over n. A
    position or a velocity that the scenario gives to all of them is no more certain than it says.
    """
    if plan.scenario.target.motion == "dataset":
        return plan.initial_covariance
    std = start.initial_std(plan.scenario) / np.sqrt(np.repeat(start.guesses(plan.scenario), 3))
    return np.asarray(np.diag((std**2)[plan.space.kept]))
