"""What the agents of a network know together before the first step."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import start
from zenoh_cbef.scenario.plan import Plan


def known_together(plan: Plan) -> Floats:
    """Covariance of the mean of all agents' initial estimates, (s, s).

    Guesses of n agents that are independent of one another have a mean whose covariance is that of one over n. A
    position or a velocity that the scenario gives to all of them is no more certain than it says.
    """
    if plan.recorded:
        return plan.initial_covariance
    chosen, std = plan.scenario.filter, start.initial_std(plan.scenario)
    number = np.repeat([_guesses(plan, chosen.initial_position), _guesses(plan, chosen.initial_velocity)], 3)
    return np.asarray(np.diag((std**2 / number)[plan.space.kept]))


def _guesses(plan: Plan, given: Sequence[float] | Sequence[Sequence[float]] | None) -> int:
    """How many independent guesses there are."""
    shared = given is not None and not isinstance(given[0], Sequence)
    return 1 if shared else plan.scenario.count
