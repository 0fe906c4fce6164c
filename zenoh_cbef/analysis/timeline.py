"""The space-time picture of a part of a run: nodes as lines, time to the right, messages as arrows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from zenoh_cbef.pages.parts import Table
from zenoh_cbef.pages.render import render
from zenoh_cbef.trace import Exchange, Fortune, Passage
from zenoh_cbef.words import counted
from zenoh_cbef.writing import write_whole

_LEFT, _RIGHT, _TOP, _BOTTOM = 92.0, 28.0, 62.0, 96.0
_ROUND_WIDTH, _NARROWEST, _WIDEST = 62.0, 820.0, 6000.0
_CROSS = 0.6
"""How far on its way a lost message is shown to end."""

_LONGEST = 72.0
"""How far to the right a lost message is shown to get: it was under way for a moment only."""

WORDS: dict[Fortune, tuple[str, str]] = {
    "in time": ("time", "used"),
    "duplicated": ("twice", "brought twice by a fault"),
    "late": ("late", "late by a fault"),
    "lost": ("lost", "lost by a fault"),
    "damaged": ("damaged", "damaged by a fault and rejected"),
    "missed": ("missed", "missed without a fault"),
    "unheard": ("unheard", "beacon that was not heard"),
}
"""The class of each fortune in the picture, and what it means, in the order of drawing."""

_ARRIVE: frozenset[Fortune] = frozenset(("in time", "duplicated", "late"))
"""Fortunes that end with an arrow's head."""


def write_timeline(exchange: Exchange, path: Path) -> None:
    """Write the picture as .svg, or a page with it as .html. Raises UserError where it cannot be written."""
    text = timeline_svg(exchange) if path.suffix == ".svg" else timeline_html(exchange)
    write_whole(path, text)


def timeline_html(exchange: Exchange) -> str:
    """One page with the picture, which scrolls sideways where it is wide."""
    events = Table("Times since the start", [], [[_moment(time), who, text] for who, time, text in exchange.events])
    return render("timeline.html", notes=exchange.notes, events=events, alone=False, **_picture(exchange))


def timeline_svg(exchange: Exchange) -> str:
    """The picture alone, a valid SVG file."""
    picture = render("timeline.svg", alone=True, **_picture(exchange))
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + picture[picture.index("<svg") :] + "\n"


def _lead(exchange: Exchange) -> str:
    steps = sorted({one.step for one in exchange.passages})
    which = f"steps {steps[0]} to {steps[-1]}, " if steps and steps[0] != steps[-1] else ""
    which = f"step {steps[0]}, " if steps and steps[0] == steps[-1] else which
    times = f"{exchange.since:.4g} s to {exchange.until:.4g} s after the start"
    return f"{which}{times}, {counted(len(exchange.passages), 'message')}"


@dataclass(frozen=True)
class _Frame:
    """Where times and nodes are in the picture."""

    since: float
    until: float
    width: float
    lane: float
    target: bool
    agents: int

    @property
    def right(self) -> float:
        return _LEFT + self.width

    @property
    def bottom(self) -> float:
        return self.y(self.agents - 1) + 30.0

    def x(self, time: float) -> float:
        """Place of a time, limited to a little beyond the picture, as SVG has no infinity."""
        place = (time - self.since) / (self.until - self.since)
        return _LEFT + self.width * min(max(place, -2.0), 3.0)

    def y(self, node: int | None) -> float:
        """Height of an agent's line, or of the target's."""
        return _TOP + 28.0 + self.lane * ((-1 if node is None else node) + self.target)


def _frame(exchange: Exchange) -> _Frame:
    count, target = len(exchange.labels), any(one.source is None for one in exchange.passages)
    shown = [time for _, _, time in exchange.rounds if exchange.since <= time <= exchange.until]
    width = float(np.clip(_ROUND_WIDTH * len(shown), _NARROWEST, _WIDEST))
    lane = float(np.clip(620.0 / max(count, 1), 30.0, 84.0))
    span = max(exchange.until - exchange.since, 1e-6)
    since, until = exchange.since - 0.01 * span, exchange.since + 1.015 * span
    return _Frame(since, until, width, lane, target, count)


@dataclass(frozen=True)
class _Arrow:
    """A message as it is drawn; told: its whole story."""

    fortune: Fortune
    x0: float
    y0: float
    x1: float
    y1: float
    told: str

    @property
    def kind(self) -> str:
        return WORDS[self.fortune][0]

    @property
    def arrives(self) -> bool:
        return self.fortune in _ARRIVE


@dataclass(frozen=True)
class _Shade:
    """The time of one round; dark: every other one. round, step, shown: what is written there."""

    left: float
    right: float
    dark: bool
    round: str
    step: str
    shown: str


@dataclass(frozen=True)
class _Sign:
    """One entry of the legend, at x and y."""

    kind: str
    fortune: Fortune | None
    arrives: bool
    x: float
    y: float
    text: str


def _picture(exchange: Exchange) -> dict[str, object]:
    """What the template draws: names, sizes, and where everything is."""
    frame = _frame(exchange)
    unit, ticks = _ticks(frame)
    nodes: list[int | None] = [None] if frame.target else []
    arrows = [_arrow(one, frame, exchange) for name in WORDS for one in exchange.passages if one.fortune == name]
    return {
        "name": exchange.name,
        "lead": _lead(exchange),
        "width": round(frame.right + _RIGHT),
        "height": round(frame.bottom + _BOTTOM),
        "left": _LEFT,
        "right": frame.right,
        "top": _TOP,
        "bottom": frame.bottom,
        "kinds": [kind for kind, _ in WORDS.values()],
        "shades": list(_shades(exchange, frame)),
        "unit": unit,
        "ticks": ticks,
        "nodes": [(frame.y(node), _name(node, exchange)) for node in [*nodes, *range(frame.agents)]],
        "arrows": arrows,
        "estimates": [
            (frame.x(time), frame.y(agent), f"{_name(agent, exchange)}: estimate of step {step}, at {_moment(time)}")
            for agent, step, time in exchange.estimates
        ],
        "legend": list(_legend(Counter(one.fortune for one in exchange.passages), frame)),
    }


def _shades(exchange: Exchange, frame: _Frame) -> Iterator[_Shade]:
    """Every round from when half of the agents had sent in it; a name where a step begins."""
    ends = [*(time for *_, time in exchange.rounds), max(exchange.until, frame.until)][1:]
    for (step, round_, begin), end in zip(exchange.rounds, ends, strict=bool(exchange.rounds)):
        left, right = (min(max(frame.x(time), _LEFT), frame.right) for time in (begin, end))
        if right <= left:
            continue
        name = shown = ""
        if not round_ and frame.x(begin) >= _LEFT:
            name, room = f"step {step}, {step * exchange.dt:.6g} s of run time", _room(exchange, frame, step)
            names = (name, 6.4 * len(name)), (f"step {step}", 48.0), (f"{step}", 20.0)
            shown = next((text for text, wanted in names if room > wanted), "")
        number = str(round_) if round_ and right - left > 14.0 else ""
        yield _Shade(left, right, dark=bool(round_ % 2), round=number, step=name, shown=shown)


def _room(exchange: Exchange, frame: _Frame, step: int) -> float:
    begins = [time for one, round_, time in exchange.rounds if not round_ and one >= step]
    return (frame.x(begins[1]) if len(begins) > 1 else frame.right) - frame.x(begins[0])


def _ticks(frame: _Frame) -> tuple[str, list[tuple[float, str]]]:
    """The unit of the axis, and the places and texts of its ticks."""
    span = frame.until - frame.since
    size = 10.0 ** np.floor(np.log10(span / max(frame.width / 110.0, 1.0)))
    size *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if span / (size * factor) <= frame.width / 90.0)
    unit, scale = ("s", 1.0) if size >= 0.1 else ("ms", 1e3)
    times = size * np.arange(np.ceil(frame.since / size), np.floor(frame.until / size) + 1)
    return unit, [(frame.x(time), f"{time * scale:.10g}") for time in times.tolist()]


def _name(node: int | None, exchange: Exchange) -> str:
    return "target" if node is None else f"agent {exchange.labels[node]}"


def _arrow(one: Passage, frame: _Frame, exchange: Exchange) -> _Arrow:
    x0, y0, x1, y1 = frame.x(one.sent), frame.y(one.source), frame.x(one.ended), frame.y(one.destination)
    if one.fortune in {"lost", "unheard"}:
        x1, y1 = x0 + _CROSS * min(max(x1 - x0, 0.0), _LONGEST), y0 + _CROSS * (y1 - y0)
    return _Arrow(one.fortune, x0, y0, x1, y1, _told(one, exchange))


def _told(one: Passage, exchange: Exchange) -> str:
    what = "beacon" if one.source is None else f"round {one.round}" if one.round else "range"
    route = f"{_name(one.source, exchange)} → {_name(one.destination, exchange)}, step {one.step}, {what}"
    took = 1e3 * (one.ended - one.sent)
    after = f", {took:.3g} ms after it was sent" if one.fortune in _ARRIVE and 0.0 < took < np.inf else ""
    return f"{route}: {WORDS[one.fortune][1]}{after}; sent at {_moment(one.sent)}"


def _moment(time: float) -> str:
    return f"{time:.4f} s"


def _legend(counts: Counter[Fortune], frame: _Frame) -> Iterator[_Sign]:
    """The arrows that occur and how many there are, in as many rows as they need."""
    x, y = _LEFT, frame.bottom + 64.0
    for name, (kind, words) in WORDS.items():
        if not counts[name]:
            continue
        text = f"{words} ({counts[name]})"
        if x + 44.0 + 6.6 * len(text) > frame.right and x > _LEFT:
            x, y = _LEFT, y + 20.0
        yield _Sign(kind, name, name in _ARRIVE, x, y, text)
        x += 62.0 + 6.6 * len(text)
    yield _Sign("estimates", None, arrives=False, x=x, y=y, text="estimate")
