"""What all viewers show alike: colours, sizes, and the layout."""

from __future__ import annotations

from math import isfinite

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.trace import Trace

Colour = tuple[float, float, float, float]

LAYOUT = "viz-layout.json"
"""The file of this package that says what viewers show where."""

TRAIL = 50
"""Steps that a path shows."""

TRUTH: Colour = (1.0, 1.0, 1.0, 1.0)
_WHOLE, _BROKEN = np.array([0.2, 0.7, 0.3, 0.9]), np.array([0.9, 0.15, 0.1, 0.9])
_UNKNOWN = np.array([0.6, 0.6, 0.6, 0.5])
WARNINGS = ("rejected", "silent", "crashed", "left", "unobservable")


def agent_colour(agent: int, alpha: float = 1.0) -> Colour:
    """One of eight colours that colour-blind readers can tell apart (Okabe and Ito, with grey in place of black)."""
    palette = ("0072B2", "D55E00", "009E73", "CC79A7", "56B4E9", "E69F00", "999999", "F0E442")
    code = palette[agent % len(palette)]
    red, green, blue = (int(code[place : place + 2], 16) / 255.0 for place in (0, 2, 4))
    return red, green, blue, alpha


def health_colour(delivered: float) -> Floats:
    """From green, all messages came in time, to red, none did; grey where that is unknown. (4,), from 0 to 1."""
    return _WHOLE + (1.0 - delivered) * (_BROKEN - _WHOLE) if isfinite(delivered) else _UNKNOWN


def body_size(trace: Trace) -> float:
    """The size of an agent's body in the scene, m: a fiftieth of the space that all agents fill."""
    places = trace.positions[:, 0]
    return max(0.05, 0.02 * float(np.linalg.norm(places.max(axis=0) - places.min(axis=0))))
