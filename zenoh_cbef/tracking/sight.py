"""Whether the agents' positions determine the target: ranges may also fit a mirror image of it, or a whole circle."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints

MIRRORED = 1
"""So many open axes leave a mirror image; more leave infinitely many positions."""

_LEAST = 1e-12


def open_axes(positions: Floats, there: Bools, window: int, resolution: float) -> Ints:
    """How many of d axes the agents do not span, in every window of steps, (K - window + 1,).

    If a target at constant velocity is rotated about the space that the agents span, no range changes. A common linear
    motion of the agents does not count: they span what remains of their positions without it.
    With 0 open axes ranges determine the target, with 1 they fit a mirror image too, with 2 a circle, with 3 a sphere.
    positions: (n, K, d), m. there: (n, K), which of them range. window: steps. resolution: the noise of a range, m; an
    axis is open where all places of a window together reach out of the others by less (root of the sum of squares).
    """
    axes = positions.shape[2]
    if not there.any():
        return np.full(positions.shape[1] - window + 1, axes)
    if _alike(positions) and _alike(there):  # All windows are.
        positions, there, count = positions[:, :window], there[:, :window], positions.shape[1] - window + 1
        return np.repeat(_open_axes(positions, there, window, resolution), count)
    return _open_axes(positions, there, window, resolution)


def _alike(values: Floats | Bools) -> bool:
    """Whether values (n, K, ...) are the same in all steps."""
    return bool((values == values[:, :1]).all())


def _open_axes(positions: Floats, there: Bools, window: int, resolution: float) -> Ints:
    """The same where some agent ranges, window by window."""
    places = np.where(there[:, :, None], positions - positions[there].mean(axis=0), 0.0)
    moments = there.sum(axis=0).astype(np.float64), places.sum(axis=0), np.einsum("nki,nkj->kij", places, places)
    number, total, squares = moments
    time = np.arange(window, dtype=np.float64) - (window - 1) / 2.0

    def summed(values: Floats, power: int) -> Floats:
        if len(values) == window:
            return np.asarray(np.moveaxis(values, 0, -1) @ time**power)[None]
        return np.asarray(np.lib.stride_tricks.sliding_window_view(values, window, axis=0) @ time**power)

    common = np.stack([summed(number, power) for power in (0, 1, 1, 2)], axis=-1).reshape(-1, 2, 2)
    along = np.stack([summed(total, power) for power in (0, 1)], axis=1)
    whole = summed(squares, 0)
    motion = np.linalg.pinv(common, rcond=_LEAST, hermitian=True) @ along
    spread = np.linalg.eigvalsh(whole - np.swapaxes(along, 1, 2) @ motion)
    least = np.maximum(resolution**2, _LEAST * np.trace(whole, axis1=1, axis2=2))
    return np.asarray((spread <= least[:, None]).sum(axis=1))
