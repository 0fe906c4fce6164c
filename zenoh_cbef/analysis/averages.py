"""Averages of values of which some are missing."""

from __future__ import annotations

from typing import Any

import numpy as np

from zenoh_cbef.analysis.results import Number
from zenoh_cbef.arrays import Floats


def mean(values: Floats) -> Number:
    """The mean of the finite values; None for nothing."""
    flat = values.ravel()
    known = np.isfinite(flat)
    finite = flat if np.logical_and.reduce(known) else flat[known]
    return float(np.add.reduce(finite) / finite.size) if finite.size else None


def means(values: Floats) -> Floats:
    """The same along the last axis of (..., k), to the last bit; NaN for nothing."""
    rows = values.reshape(-1, values.shape[-1])
    whole, found = np.isfinite(rows).all(axis=1), np.full(len(rows), np.nan)
    found[whole] = np.add.reduce(rows[whole], axis=1) / rows.shape[1]
    for row in np.flatnonzero(~whole).tolist():
        found[row] = np.nan if (one := mean(rows[row])) is None else one
    return found.reshape(values.shape[:-1])


def middle(values: Floats) -> Floats:
    """The median of the known values along the last axis of (..., k); NaN for nothing."""
    rows, count = np.sort(values), np.isfinite(values).sum(axis=-1)[..., None]
    both = np.take_along_axis(rows, np.concatenate([(count - 1) // 2, count // 2], axis=-1), axis=-1)
    return np.asarray(0.5 * both.sum(axis=-1))


def told(values: Floats) -> Any:
    """As lists, with None for NaN."""
    found = values.astype(object)
    found[np.isnan(values)] = None
    return found.tolist()


def rms(values: Floats) -> Number:
    """The root of their mean square."""
    square = mean(values**2)
    return None if square is None else float(np.sqrt(square))


def ratio_of_rms(errors: Floats, yardstick: Floats) -> Number:
    """Of the root mean squares of the agents' errors (n, K) and a yardstick's (K,), over the steps that both have."""
    own, other = rms(errors[:, np.isfinite(yardstick)]), rms(yardstick[np.isfinite(errors).any(axis=0)])
    return own / other if own is not None and other else None


def mean_over_agents(values: Floats) -> Floats:
    """The mean of the finite values over the first axis; NaN where there is none."""
    present = np.isfinite(values)
    total, count = np.where(present, values, 0.0).sum(axis=0), present.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def rms_over_agents(values: Floats) -> Floats:
    """The root of their mean square, likewise."""
    return np.sqrt(mean_over_agents(np.where(np.isfinite(values), values, np.nan) ** 2))


def running_mean(values: Floats) -> Floats:
    """(1/k) sum_{t<=k} along the last axis; steps without a value are left out of sum and count."""
    present = np.isfinite(values)
    total, count = np.cumsum(np.where(present, values, 0.0), axis=-1), np.cumsum(present, axis=-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def last(values: Floats) -> Number:
    """The last that is known."""
    finite = values[np.isfinite(values)]
    return float(finite[-1]) if finite.size else None
