"""The space-time picture for paper: agents as lines, messages as strokes between them."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.figures import INK, MUTED
from zenoh_cbef.analysis.timeline import WORDS
from zenoh_cbef.pages.parts import Figure, Plot
from zenoh_cbef.trace import Exchange, Fortune, Passage

_COLOURS: dict[Fortune, str] = {
    "in time": "#8b96a1",
    "duplicated": "#0072B2",
    "late": "#E69F00",
    "lost": "#9c1c3c",
    "damaged": "#AA3377",
    "missed": "#A6761D",
    "unheard": "#56B4E9",
}
_SHORT = 0.6
"""How far on its way a message ends that does not arrive."""


def timeline_figure(exchange: Exchange) -> Figure:
    """The figure of a part of a run."""
    beside = any(one.source is None for one in exchange.passages)
    nodes = [*(["target"] if beside else []), *(f"agent {label}" for label in exchange.labels)]
    lines: list[Plot] = [
        {
            "type": "scatter",
            "mode": "lines",
            "x": [exchange.since, exchange.until],
            "y": [row, row],
            "line": {"color": INK, "width": 1},
            "showlegend": False,
        }
        for row in range(len(nodes))
    ]
    lines += [_strokes(name, exchange, beside=beside) for name in WORDS if _any(name, exchange)]
    along = {"range": [len(nodes) - 0.5, -0.5], "tickvals": [*range(len(nodes))], "ticktext": nodes}
    across = {"title": {"text": "time (s)"}, "range": [exchange.since, exchange.until]}
    plot: Plot = {"data": lines, "layout": {"xaxis": across, "yaxis": along, "showlegend": True}}
    return Figure("timeline", "Messages over time", "", plot if exchange.passages else None)


def _any(fortune: Fortune, exchange: Exchange) -> bool:
    return any(one.fortune == fortune for one in exchange.passages)


def _strokes(fortune: Fortune, exchange: Exchange, *, beside: bool) -> Plot:
    """All messages of one fortune as one line with gaps."""
    ends = [_ends(one, beside=beside) for one in exchange.passages if one.fortune == fortune]
    x = [part for (start, _), (end, _) in ends for part in (start, end, None)]
    y = [part for (_, start), (_, end) in ends for part in (start, end, None)]
    dash = "solid" if fortune == "in time" else "dash" if fortune in {"lost", "unheard"} else "dot"
    line = {"color": _COLOURS.get(fortune, MUTED), "width": 1.2, "dash": dash}
    return {"type": "scatter", "mode": "lines", "x": x, "y": y, "line": line, "name": WORDS[fortune][1]}


def _ends(one: Passage, *, beside: bool) -> tuple[tuple[float, float], tuple[float, float]]:
    """Where a stroke begins and ends: time, and row."""
    begin, end = (float((-1 if node is None else node) + beside) for node in (one.source, one.destination))
    until = one.ended if np.isfinite(one.ended) else one.sent
    if one.fortune in {"lost", "unheard"}:
        return (one.sent, begin), (one.sent + _SHORT * (until - one.sent), begin + _SHORT * (end - begin))
    return (one.sent, begin), (until, end)
