"""Runs without processes, and the scenarios that they are of."""

from __future__ import annotations

import warnings

import numpy as np

from zenoh_cbef.analysis.divergence import refuse_divergence
from zenoh_cbef.api.run import Run
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.calling import What, described
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate as _simulate


def scenario(what: What = "tracking", /, **values: object) -> Scenario:
    """A scenario: built in, of a TOML file, or another one, with other values.

    values: by their keys, as in seed=7 or **{"consensus.rounds": 5}. Raises UserError with the remedy.
    """
    return described(what, values).scenario


def simulate(what: What = "tracking", /, **values: object) -> Run:
    """Simulate a scenario without processes: in lockstep the same bits as `run`.

    what, values: as of `scenario`. Warns of what is likely a mistake. Raises UserError with the remedy, also where the
    filter diverges.
    """
    plan = described(what, values).plan
    warn_of(plan)
    with np.errstate(all="ignore"):  # what diverges is told in a sentence
        trace = _simulate([plan.scenario])[0]
    refuse_divergence(trace)
    return Run(trace)


def warn_of(plan: Plan) -> None:
    """Warn of what is likely a mistake."""
    for sentence in check(plan):
        warnings.warn(sentence, stacklevel=3)
