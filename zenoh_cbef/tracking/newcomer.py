"""How an agent that comes back without a memory begins: with its neighbours' estimates."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.rows import picked
from zenoh_cbef.tracking.linalg import inverse, matvec, neighbour_sum
from zenoh_cbef.tracking.ranging import Space


def belief_from(space: Space, states: Floats, covariances: Floats | None, told: Bools, initial: Belief) -> Belief:
    """Covariance intersection, with equal weights, of the neighbours' estimates (Julier, Uhlmann, ACC 1997).

    states: (n, m, 6), covariances: (n, m, 6, 6), None for filters without one; told: (n, m), which neighbours answered.
    Returns `initial`, (n, s) and (n, s, s), where no neighbour answered, and what follows position and velocity in a
    state as it is there. The neighbours' estimates have nearly all information in common, so together they count as
    one.
    """
    kept, count = space.kept, told.sum(axis=1)
    safe = np.maximum(count, 1)
    alone, size = (count == 0)[:, None], len(kept)
    state = np.where(told[:, :, None], states[:, :, kept], 0.0)
    if covariances is None:
        mean = neighbour_sum(state) / safe[:, None]
        return replace(initial, state=np.where(alone, initial.state, _begins_with(mean, initial.state)))
    unit = np.broadcast_to(np.eye(size), (*told.shape, size, size))
    known = np.where(told[:, :, None, None], covariances[:, :, kept[:, None], kept], unit)
    information = np.where(told[:, :, None, None], inverse(known), 0.0)
    vectors = np.sum(information * state[:, :, None, :], axis=3)
    total = neighbour_sum(information.reshape(*told.shape, -1)).reshape(known.shape[0], *known.shape[2:])
    total = np.where(alone[:, :, None], np.eye(size), total / safe[:, None, None])
    covariance = inverse(total)
    state = matvec(covariance, neighbour_sum(vectors) / safe[:, None])
    widened = np.array(initial.known_covariance)
    widened[:, :size] = widened[:, :, :size] = 0.0
    widened[:, :size, :size] = covariance
    return Belief(
        np.where(alone, initial.state, _begins_with(state, initial.state)),
        np.where(alone[:, :, None], initial.known_covariance, widened),
    )


def _begins_with(state: Floats, longer: Floats) -> Floats:
    return np.concatenate([state, longer[:, state.shape[1] :]], axis=1)


def merged(old: Update, new: Update, rows: Bools) -> Update:
    """An update with some rows (n,) taken from another one."""
    return Update(
        picked(old.payload, new.payload, rows),
        old.diagnostics.chosen(rows, new.diagnostics),
        kept=tuple(picked(*pair, rows) for pair in zip(old.kept, new.kept, strict=True)),
        parts=tuple(merged(*pair, rows) for pair in zip(old.parts, new.parts, strict=True)),
    )
