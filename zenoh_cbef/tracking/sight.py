"""Whether the agents' positions determine the target: ranges may also fit a mirror image of it, or a whole circle."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints

MIRRORED = 1
"""So many open axes leave a mirror image; more leave infinitely many positions."""

_LEAST = 1e-12


def open_axes(positions: Floats, there: Bools, window: int, resolution: float) -> Ints:
    """How many of d axes the agents do not span, in every window of steps, (..., K - window + 1).

    If a target at constant velocity is rotated about the space that the agents span, no range changes. A common linear
    motion of the agents does not count: they span what remains of their positions without it.
    With 0 open axes ranges determine the target, with 1 they fit a mirror image too, with 2 a circle, with 3 a sphere.
    positions: (..., n, K, d), m. there: (..., n, K), which of them range. window: steps. resolution: the noise of a
    range, m; an axis is open where all places of a window together reach out of the others by less (root of the sum of
    squares).
    """
    windows = there.shape[-1] - window + 1
    if (positions == positions[..., :1, :]).all() and (there == there[..., :1]).all():  # All windows are alike.
        positions, there = positions[..., :window, :], there[..., :window]
        return np.repeat(_open_axes(positions, there, window, resolution), windows, axis=-1)
    return _open_axes(positions, there, window, resolution)


def _open_axes(positions: Floats, there: Bools, window: int, resolution: float) -> Ints:
    """The same window by window."""
    ranging = there[..., None]
    count = np.maximum(np.count_nonzero(there, axis=(-2, -1), keepdims=True), 1)[..., None]
    middle = np.where(ranging, positions, 0.0).sum(axis=(-3, -2), keepdims=True) / count
    places = np.where(ranging, positions - middle, 0.0)
    number, total = there.sum(axis=-2, dtype=np.float64), places.sum(axis=-3)
    squares = np.einsum("...nki,...nkj->...kij", places, places)
    time, steps = np.arange(window, dtype=np.float64) - (window - 1) / 2.0, number.ndim - 1

    def summed(values: Floats, power: int) -> Floats:
        return np.asarray(np.lib.stride_tricks.sliding_window_view(values, window, axis=steps) @ time**power)

    common = np.stack([summed(number, power) for power in (0, 1, 1, 2)], axis=-1)
    along = np.stack([summed(total, power) for power in (0, 1)], axis=-2)
    whole = summed(squares, 0)
    motion = np.linalg.pinv(common.reshape(*common.shape[:-1], 2, 2), rcond=_LEAST, hermitian=True) @ along
    spread = np.linalg.eigvalsh(whole - np.swapaxes(along, -1, -2) @ motion)
    least = np.maximum(resolution**2, _LEAST * np.trace(whole, axis1=-2, axis2=-1))
    return np.asarray((spread <= least[..., None]).sum(axis=-1))
