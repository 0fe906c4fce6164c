"""Errors below the bound: what that bound assumes."""

from __future__ import annotations

from zenoh_cbef.analysis.results import Number
from zenoh_cbef.numbers import number

_BELOW = 0.9
"""Below this share of the bound, an error asks for a word; between it and 1 runs are by chance."""

_FEW = 100
"""Of fewer scored steps errors are that far below by chance."""


def bound_note(ratio: Number, steps: int) -> str:
    """What a reader has to know of errors that are clearly below the bound; "" of others.

    ratio: to it. steps: that are scored, of all runs.
    """
    if ratio is None or ratio >= _BELOW or steps < _FEW:
        return ""
    return (
        f"the error is {number(ratio)} times the bound, which is a mean over targets that accelerate by "
        "filter.acceleration_std, with the noise filter.range_std: this target is calmer, or its ranges are better, or "
        "the run is lucky"
    )
