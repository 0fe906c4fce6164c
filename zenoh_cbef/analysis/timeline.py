"""The space-time picture of a part of a run: nodes as lines, time to the right, messages as arrows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.trace import Exchange, Fortune, Passage
from zenoh_cbef.words import counted

_LEFT, _RIGHT, _TOP, _BOTTOM = 92.0, 28.0, 62.0, 96.0
_ROUND_WIDTH, _NARROWEST, _WIDEST = 62.0, 820.0, 6000.0
_CROSS = 0.6
"""How far on its way a lost message is shown to end."""

_LONGEST = 72.0
"""How far to the right it may be shown to get: it was under way for a moment, whenever its receiver went on."""

_WORDS: dict[Fortune, tuple[str, str]] = {
    "in time": ("time", "used"),
    "duplicated": ("twice", "brought twice by a fault"),
    "late": ("late", "late by a fault"),
    "lost": ("lost", "lost by a fault"),
    "damaged": ("damaged", "damaged by a fault and rejected"),
    "missed": ("missed", "missed without a fault"),
    "unheard": ("unheard", "beacon that was not heard"),
}
"""The class of each fortune in the picture, and what it means, in the order of drawing."""


def check_format(path: Path) -> None:
    """Raises UserError where a picture cannot be written under this name."""
    if path.suffix not in {".svg", ".html"}:
        raise UserError(f"--output {path} must end with .svg for the picture or .html for a page around it")


def write_timeline(exchange: Exchange, path: Path) -> None:
    """Write the picture as .svg, or a page with it as .html. Raises UserError where it cannot be written."""
    check_format(path)
    text = timeline_svg(exchange) if path.suffix == ".svg" else timeline_html(exchange)
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another --output") from None


def timeline_html(exchange: Exchange) -> str:
    """One page with the picture, which scrolls sideways where it is wide."""
    page = Template(files(__package__).joinpath("timeline.html").read_text(encoding="utf-8"))
    notes = "".join(f'<p class="note">{escape(note)}</p>' for note in exchange.notes)
    rows = (
        f"<tr><td>{_moment(time)}</td><td>{escape(who)}</td><td>{escape(text)}</td></tr>"
        for who, time, text in exchange.events
    )
    events = (
        "<h2>Events</h2><p>Times since the start.</p><table>" + "".join(rows) + "</table>" if exchange.events else ""
    )
    return page.substitute(
        name=escape(exchange.name), lead=escape(_lead(exchange)), notes=notes, events=events, picture=_svg(exchange)
    )


def timeline_svg(exchange: Exchange) -> str:
    """The picture alone, a valid SVG file."""
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + _svg(exchange)


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
        """Far outside is as good as infinitely far, and SVG knows no infinity."""
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


def _svg(exchange: Exchange) -> str:
    frame = _frame(exchange)
    counts = Counter(one.fortune for one in exchange.passages)
    width, height = frame.right + _RIGHT, frame.bottom + _BOTTOM
    size, sides = f"{width:.0f} {height:.0f}", f'width="{width:.0f}" height="{height:.0f}"'
    style = files(__package__).joinpath("timeline.css").read_text(encoding="utf-8")
    drawn = [_passage(one, frame, exchange) for name in _WORDS for one in exchange.passages if one.fortune == name]
    title = f"{exchange.name}: who sent what to whom, {_lead(exchange)}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {size}" {sides} role="img" aria-labelledby="about">',
        f'<title id="about">{escape(title)}</title>',
        f"<style>{style}</style>",
        _definitions(frame),
        f'<rect class="paper" {sides}/>',
        *_shades(exchange, frame),
        *_axis(frame, exchange),
        *_lines(exchange, frame),
        f'<g clip-path="url(#inside)">{"".join(drawn)}</g>',
        *_estimates(exchange, frame),
        *_legend(counts, frame),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _definitions(frame: _Frame) -> str:
    heads = "".join(
        f'<marker id="head-{name}" viewBox="0 0 8 8" refX="7.5" refY="4" markerWidth="7" markerHeight="7" '
        f'markerUnits="userSpaceOnUse" orient="auto"><path class="head {name}" d="M0.5 1L7.5 4L0.5 7Z"/></marker>'
        for name, _ in _WORDS.values()
    )
    place = f'x="{_LEFT}" y="{_TOP}" width="{frame.width:.1f}" height="{frame.bottom - _TOP:.1f}"'
    return f'<defs>{heads}<clipPath id="inside"><rect {place}/></clipPath></defs>'


def _shades(exchange: Exchange, frame: _Frame) -> Iterator[str]:
    """Every other round shaded, from when half of the agents had sent in it; a line and a name where a step begins."""
    ends = [*(time for *_, time in exchange.rounds), max(exchange.until, frame.until)][1:]
    for (step, round_, begin), end in zip(exchange.rounds, ends, strict=bool(exchange.rounds)):
        left, right = (min(max(frame.x(time), _LEFT), frame.right) for time in (begin, end))
        if right <= left:
            continue
        if round_ % 2:
            yield (
                f'<rect class="shade" x="{left:.1f}" y="{_TOP}" width="{right - left:.1f}" '
                f'height="{frame.bottom - _TOP:.1f}"/>'
            )
        if right - left > 14.0 and round_:
            yield f'<text class="round" x="{(left + right) / 2:.1f}" y="{_TOP - 8}">{round_}</text>'
        if not round_ and frame.x(begin) >= _LEFT:
            yield f'<path class="step" d="M{left:.1f} {_TOP - 34}V{frame.bottom:.1f}"/>'
            name = f"step {step}, {step * exchange.dt:.6g} s of run time"
            room = _room(exchange, frame, step)
            shown = (
                name if room > 6.4 * len(name) else f"step {step}" if room > 48.0 else f"{step}" if room > 20 else ""
            )
            yield f'<text class="name" x="{left + 5:.1f}" y="{_TOP - 24}">{shown}<title>{name}</title></text>'


def _room(exchange: Exchange, frame: _Frame, step: int) -> float:
    begins = [time for one, round_, time in exchange.rounds if not round_ and one >= step]
    return (frame.x(begins[1]) if len(begins) > 1 else frame.right) - frame.x(begins[0])


def _axis(frame: _Frame, exchange: Exchange) -> Iterator[str]:
    span = frame.until - frame.since
    size = 10.0 ** np.floor(np.log10(span / max(frame.width / 110.0, 1.0)))
    size *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if span / (size * factor) <= frame.width / 90.0)
    unit, scale = ("s", 1.0) if size >= 0.1 else ("ms", 1e3)
    bottom = frame.bottom
    yield f'<path class="axis" d="M{_LEFT} {bottom:.1f}H{frame.right:.1f}"/>'
    for tick in np.arange(np.ceil(frame.since / size), np.floor(frame.until / size) + 1):
        x = frame.x(float(tick * size))
        yield f'<path class="axis" d="M{x:.1f} {bottom:.1f}v5"/>'
        yield f'<text class="tick" x="{x:.1f}" y="{bottom + 18:.1f}">{float(tick * size * scale):.10g}</text>'
    told = f"time since the start ({unit})"
    yield f'<text class="tick" x="{_LEFT + frame.width / 2:.1f}" y="{bottom + 36:.1f}">{told}</text>'
    if exchange.rounds:
        yield f'<text class="side" x="{_LEFT - 12}" y="{_TOP - 8}">round</text>'


def _lines(exchange: Exchange, frame: _Frame) -> Iterator[str]:
    nodes: list[int | None] = [None] if frame.target else []
    for node in [*nodes, *range(frame.agents)]:
        y, name = frame.y(node), "target" if node is None else f"agent {exchange.labels[node]}"
        yield f'<path class="node" d="M{_LEFT} {y:.1f}H{frame.right:.1f}"/>'
        yield f'<text class="side" x="{_LEFT - 12}" y="{y + 4:.1f}">{escape(name)}</text>'


def _estimates(exchange: Exchange, frame: _Frame) -> Iterator[str]:
    for agent, step, time in exchange.estimates:
        told = escape(f"agent {exchange.labels[agent]}: estimate of step {step}, at {_moment(time)}")
        where = f'cx="{frame.x(time):.1f}" cy="{frame.y(agent):.1f}"'
        yield f'<circle class="estimate" {where} r="3.6"><title>{told}</title></circle>'


def _passage(one: Passage, frame: _Frame, exchange: Exchange) -> str:
    name, words = _WORDS[one.fortune]
    x0, y0, x1, y1 = frame.x(one.sent), frame.y(one.source), frame.x(one.ended), frame.y(one.destination)
    if one.fortune in {"lost", "unheard"}:
        x1, y1 = x0 + _CROSS * min(max(x1 - x0, 0.0), _LONGEST), y0 + _CROSS * (y1 - y0)
    way = f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}"
    marks = {
        "lost": f'<path class="sign" d="M{x1 - 4:.1f} {y1 - 4:.1f}l8 8m0 -8l-8 8"/>',
        "unheard": f'<path class="sign" d="M{x1 - 4:.1f} {y1 - 4:.1f}l8 8m0 -8l-8 8"/>',
        "damaged": f'<path class="sign" d="M{x1 - 5:.1f} {y1:.1f}l5 -5l5 5l-5 5Z"/>',
        "missed": f'<circle class="sign" cx="{x1:.1f}" cy="{y1:.1f}" r="4"/>',
        "duplicated": f'<path d="M{x0 + 5:.1f} {y0:.1f}L{x1 + 5:.1f} {y1:.1f}" marker-end="url(#head-{name})"/>',
    }
    head = f' marker-end="url(#head-{name})"' if one.fortune in {"in time", "late", "duplicated"} else ""
    return (
        f'<g class="{name}"><title>{escape(_told(one, words, exchange))}</title><path class="near" d="{way}"/>'
        f'<path d="{way}"{head}/>{marks.get(one.fortune, "")}</g>\n'
    )


def _told(one: Passage, words: str, exchange: Exchange) -> str:
    source = "target" if one.source is None else f"agent {exchange.labels[one.source]}"
    what = "beacon" if one.source is None else f"round {one.round}" if one.round else "range"
    route = f"{source} → agent {exchange.labels[one.destination]}, step {one.step}, {what}"
    took = 1e3 * (one.ended - one.sent)
    after = f", {took:.3g} ms after it was sent" if one.fortune in {"in time", "duplicated", "late"} else ""
    return f"{route}: {words}{after if 0.0 < took < np.inf else ''}; sent at {_moment(one.sent)}"


def _moment(time: float) -> str:
    return f"{time:.4f} s"


def _legend(counts: Counter[Fortune], frame: _Frame) -> Iterator[str]:
    """The arrows that occur and how many there are, in as many rows as they need."""
    x, y = _LEFT, frame.bottom + 64.0
    for name, (kind, words) in _WORDS.items():
        if not counts[name]:
            continue
        text = f"{words} ({counts[name]})"
        if x + 44.0 + 6.6 * len(text) > frame.right and x > _LEFT:
            x, y = _LEFT, y + 20.0
        sign = {
            "lost": '<path class="sign" d="M22 -4l8 8m0 -8l-8 8"/>',
            "unheard": '<path class="sign" d="M22 -4l8 8m0 -8l-8 8"/>',
            "damaged": '<path class="sign" d="M21 0l5 -5l5 5l-5 5Z"/>',
            "missed": '<circle class="sign" cx="26" cy="0" r="4"/>',
            "duplicated": '<path d="M0 4H28" marker-end="url(#head-twice)"/>',
        }.get(name, "")
        head = f' marker-end="url(#head-{kind})"' if name in {"in time", "late", "duplicated"} else ""
        yield (
            f'<g class="{kind}" transform="translate({x:.1f} {y:.1f})"><path d="M0 0H28"{head}/>{sign}'
            f'<text class="word" x="38" y="4">{text}</text></g>'
        )
        x += 62.0 + 6.6 * len(text)
    yield (
        f'<g transform="translate({x:.1f} {y:.1f})"><circle class="estimate" cx="14" cy="0" r="3.6"/>'
        '<text class="word" x="26" y="4">estimate</text></g>'
    )
