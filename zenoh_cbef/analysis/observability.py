"""Whether ranges determine the target's position: those of each agent alone, and those of the network."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.designed import Observability, Seen
from zenoh_cbef.analysis.prediction import Sight
from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.scenario.sight import unobservable_steps
from zenoh_cbef.trace import Trace
from zenoh_cbef.tracking.linalg import inverse
from zenoh_cbef.tracking.motion import LinearMotion

_LEAST = 1e-9


def observability(initial: Floats, motion: LinearMotion, sight: Sight, first: int) -> Observability:
    """Rank and condition of the observability Gramian, and the error bound, of the network and of each agent alone.

    The Gramian is sum_t A^t^T H^T H A^t over a stretch in the middle of the run, at most a tenth of it and at least
    twenty steps, with velocities in units of metres per stretch. Rank counts eigenvalues above 1e-9 of the largest;
    condition is the root of their ratio, so the largest of two errors over the least. bound: root mean square of the
    posterior Cramer-Rao bound's position errors over the window that begins at index `first`, m: a full rank
    alone does not promise a track. initial: (s, s).
    """
    steps, agents, size = sight.rows.shape
    stretch = min(steps, max(20, steps // 10))
    start = (steps - stretch) // 2
    scale = np.repeat([1.0, 1.0 / max(1.0, stretch * motion.dt)], size // 2)
    power, seen = np.eye(size), np.zeros((agents, size, size))
    for rows in sight.rows[start : start + stretch]:
        turned = (rows @ power) * scale
        seen += turned[:, :, None] * turned[:, None, :]
        power = motion.transition @ power
    gramians = np.concatenate([seen.sum(axis=0, keepdims=True), seen])
    bounds = _bounds(initial, motion, sight, first)
    network, *alone = (_seen(gramian, float(bound)) for gramian, bound in zip(gramians, bounds, strict=True))
    return Observability(stretch, size, network, alone)


def unseen_steps(traces: Sequence[Trace]) -> Bools:
    """The estimated steps in which the agents that took part and had ranges could not determine the position, (r, K).

    An agent whose messages are not in the log counts as present.
    """
    estimated: Bools = np.stack([np.isfinite(trace.estimates).all(axis=2) for trace in traces])
    known: Bools = np.asarray(estimated.any(axis=1))
    silent = ~estimated.any(axis=2, keepdims=True)
    there = np.isfinite(np.stack([trace.ranges for trace in traces])) & (estimated | silent) | ~known[:, None]
    for run, trace in enumerate(traces):
        if trace.unlogged is not None:
            there[run] |= trace.unlogged
    return unobservable_steps(traces[0].plan, np.stack([trace.positions for trace in traces]), there) & known


def _seen(gramian: Floats, bound: float) -> Seen:
    values = np.linalg.eigvalsh(gramian)
    rank = int((values > _LEAST * values[-1]).sum()) if values[-1] > 0.0 else 0
    condition = float(np.sqrt(values[-1] / values[0])) if rank == len(values) else None
    return Seen(rank, condition, bound)


def _bounds(initial: Floats, motion: LinearMotion, sight: Sight, first: int) -> Floats:
    """Root mean square position bound of the network (first) and of each agent alone, (1 + n,), m."""
    agents, axes = sight.rows.shape[1], motion.axes
    covariance = np.broadcast_to(initial, (1 + agents, *initial.shape))
    total = np.zeros(1 + agents)
    for k, rows in enumerate(sight.rows):
        each = rows[:, :, None] * rows[:, None, :] / sight.range_std**2
        seen = np.concatenate([each.sum(axis=0, keepdims=True), each])
        covariance = inverse(inverse(motion.predict_covariance(covariance)) + seen)
        if k >= first:
            total += np.trace(covariance[:, :axes, :axes], axis1=1, axis2=2)
    return np.asarray(np.sqrt(total / (len(sight.rows) - first)))
