"""The effect of consensus rounds on payloads, found by sending unit payloads through the stage itself."""

from __future__ import annotations

from typing import Literal

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.build import batch_tracker, fates_of
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.weights import weight_matrix

Scheme = Literal["average", "chebyshev", "running-sums"]
SCHEMES: tuple[Scheme, ...] = ("average", "chebyshev", "running-sums")


def configured_scheme(plan: Plan) -> Scheme:
    """The way of averaging that a run of the scenario would use."""
    if plan.sums:
        return "running-sums"
    return "chebyshev" if plan.scenario.consensus.acceleration == "chebyshev" else "average"


def with_scheme(plan: Plan, scheme: Scheme, *, linear: bool = False, rounds: int | None = None) -> Plan:
    """The plan with another way of averaging, without trimming, which is not linear.

    linear: also without what reads or rounds messages. rounds: None: as many as the plan has.
    """
    settings = {
        "rounds": plan.rounds if rounds is None else rounds,
        "scheme": "running-sums" if scheme == "running-sums" else "average",
        "acceleration": "chebyshev" if scheme == "chebyshev" else "none",
        "trim": 0,
        "trigger": 0.0,
    }
    if linear:
        settings |= {"precision": "float64", "isolate": False, "lag": 0}
    return Plan(plan.scenario.changed(consensus=settings))


def mixing(plan: Plan, scheme: Scheme, most: int) -> Floats:
    """M after 1 to `most` rounds in every step, (most, K, n, n); K is 1 where no link has a fault.

    Every stage is linear in the payloads, so its effect on unit payloads determines M. With faults each step
    has its own M, from the fates that the scenario's seed gives its messages.
    """
    tracker, neighbours = batch_tracker([with_scheme(plan, scheme, linear=True)])
    stage, scenario, count = tracker.consensus, plan.scenario, plan.scenario.count
    present = neighbours.present
    destination, _ = present.nonzero()
    seeds = np.full(len(destination), scenario.seed, dtype=np.uint64)
    fates = fates_of(plan, seeds, neighbours.index[present], destination, realtime=plan.realtime)
    found = []
    for step in range(1, scenario.length + 1 if scenario.fault else 2):
        message = stage.start(np.eye(count))
        for round_ in range(1, most + 1):
            delivered = present
            if scenario.fault:
                delivered = present.copy()
                delivered[present] = fates.of(step, round_).due
            message = stage.mix(message[neighbours.index], delivered)
            found.append(stage.result().copy())
    return np.swapaxes(np.reshape(found, (-1, most, count, count)), 0, 1)


def contraction(plan: Plan, scheme: Scheme) -> float:
    """The factor by which disagreement shrinks in a round in the long run, without faults.

    The second largest modulus of W's eigenvalues; for Chebyshev of the best polynomial, that is rho/(1 + sqrt(1 -
    rho^2)) with rho the half-width of the spectrum over its middle's distance from 1 (Montijano, Montijano, Sagues,
    IEEE TSP 61(3), 2013); for running sums of (I + adjacency) D^-1.
    """
    lists = plan.neighbours
    if scheme == "running-sums":
        shares = weight_matrix(lists, np.where(lists.present, 1.0, 0.0))
        shares[np.diag_indices(plan.scenario.count)] = 1.0
        matrix = shares / (lists.degree + 1.0)
    else:
        matrix = weight_matrix(lists, plan.weights)
    # All are similar to symmetric matrices, so their eigenvalues are real.
    rest = np.sort(np.linalg.eigvals(matrix).real)[:-1]
    if not rest.size:
        return 0.0
    if scheme != "chebyshev":
        return float(np.abs(rest).max())
    ratio = 0.5 * (rest[-1] - rest[0]) / (1.0 - 0.5 * (rest[-1] + rest[0]))
    return float(ratio / (1.0 + np.sqrt(max(0.0, 1.0 - ratio**2))))
