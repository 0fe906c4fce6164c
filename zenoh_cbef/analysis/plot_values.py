"""How plots of pages write numbers and colours, read back."""

from __future__ import annotations

import base64
import html
from collections.abc import Mapping, Sequence

import numpy as np

from zenoh_cbef.arrays import Floats


def values_of(given: object) -> Sequence[str] | Floats:
    """A column of a plot: packed numbers, numbers with gaps, or names."""
    if isinstance(given, Mapping):
        return np.frombuffer(base64.b64decode(given["bdata"]), "<f4").astype(np.float64)
    several = list(given) if isinstance(given, Sequence) else []
    if any(isinstance(one, str) for one in several):
        return [html.unescape(str(one)) for one in several]
    return np.array([np.nan if one is None else one for one in several], dtype=np.float64)


def numbers_of(given: object) -> Floats:
    """A column of numbers."""
    return np.asarray(values_of(given), dtype=np.float64)


def rgba_of(text: str) -> tuple[float, ...] | str:
    """A colour as pages write it."""
    if not text.startswith("rgb"):
        return text
    *shares, last = (float(part) for part in text[text.index("(") + 1 : -1].split(","))
    return (*(one / 255.0 for one in shares), last) if text.startswith("rgba") else (*shares, last)
