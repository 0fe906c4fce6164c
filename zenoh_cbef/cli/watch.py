"""watch: a run that goes on, with curves."""

from __future__ import annotations

import threading
from collections import deque

from rich.console import Group, RenderableType
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.text import Text

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.asking import RunName, locate
from zenoh_cbef.cli.options.joining import JoiningCommand, JoiningContext
from zenoh_cbef.cli.terminal.braille import plot
from zenoh_cbef.cli.terminal.console import console
from zenoh_cbef.cli.terminal.status import agents_table, events_view, headline, links_line, links_table, status_view
from zenoh_cbef.errors import UserError
from zenoh_cbef.numbers import number
from zenoh_cbef.outside.keyboard import Keyboard
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.outside.status import RunStatus

_EVERY_SECONDS = 0.5
_KEPT = 1000
_PLOT_LINES = 8
_FEW_PLOT_LINES = 4
_WIDEST = 150
"""Columns of a terminal from which on the places of agents have room, too; 'status' always has them."""
_WIDE, _HIGH = 110, 32
"""Columns and lines of a terminal from which on agents, links and events have a panel each."""
_LEAST = 4
"""Lines that agents have at least; curves give theirs away."""
_EVENTS = 40


class Screen:
    """What is seen of a run: its present state, and how error and disagreement went."""

    def __init__(self) -> None:
        self._errors: deque[float | None] = deque(maxlen=_KEPT)
        self._disagreements: deque[float | None] = deque(maxlen=_KEPT)

    def take(self, status: RunStatus) -> RenderableType:
        """Take in the next status; returns the new picture."""
        if status.step is not None:
            self._errors.append(status.error)
            self._disagreements.append(status.disagreement)
        layout = Layout()
        top = headline(status)
        small = console.width < _WIDE or console.height < _HIGH
        high = _FEW_PLOT_LINES if small else _PLOT_LINES
        # Where there is no room for both, the agents are more than the curves.
        room = console.height - _lines(top) - high - 2 - 1
        curves = [self._curves(status, high)] if not small or room >= _LEAST else []
        if small:
            body = Group(agents_table(status, brief=True), links_line(status), self._events(status))
            layout.split_column(
                *(Layout(top, size=_lines(top)), *curves),
                *(Layout(body), Layout(Text("q quits; 'status' has all"), size=1)),
            )
            return layout
        below = Layout()
        parts: list[RenderableType] = [agents_table(status, brief=console.width < _WIDEST)]
        if status.links:
            parts += [Text(), links_table(status)]
        below.split_row(
            Layout(Panel(Group(*parts), title="agents and links", title_align="left"), ratio=3),
            Layout(Panel(self._events(status), title="events, the latest first", title_align="left"), ratio=2),
        )
        layout.split_column(Layout(top, size=_lines(top)), *curves, below, Layout(Text("q quits"), size=1))
        return layout

    def _curves(self, status: RunStatus, lines: int) -> Layout:
        curves = Layout(size=lines + 2)
        curves.split_row(
            Layout(self._curve("position error, m", self._errors, status.error, lines)),
            Layout(self._curve("disagreement, m", self._disagreements, status.disagreement, lines)),
        )
        return curves

    @staticmethod
    def _events(status: RunStatus) -> Text:
        lines = events_view(status, _EVENTS).split("\n")
        return Text("\n").join(reversed([line for line in lines if line.plain]))

    @staticmethod
    def _curve(title: str, values: deque[float | None], now: float | None, height: int) -> Panel:
        lines = plot(list(values), max(12, console.width // 2 - 4), height)
        return Panel(
            Text("\n".join(lines), no_wrap=True),
            title=title if console.width < _WIDE else f"{title}: {number(now)}",
            title_align="left",
        )


def _lines(text: Text) -> int:
    """How many lines a text takes on this terminal."""
    return len(text.wrap(console, console.width))


def _watch(ctx: JoiningContext, run: RunName = None) -> None:
    """Watch a run that goes on: curves of error and disagreement, agents, links, events. q quits; the run goes on."""
    if not console.is_terminal:
        raise UserError("watch needs a terminal; 'status' prints a run's state once, with --json for programs")
    name, connection = locate(run, ctx.joining)
    with Operator(name, connection) as operator:
        status = operator.status()
        last, ended = _follow(operator, status)
    console.print(status_view(last))
    if ended:
        console.print(f"run {name} has ended" + ("" if last.step is None else f" after step {last.step}"))


def _follow(operator: Operator, status: RunStatus) -> tuple[RunStatus, bool]:
    """Show a run until it is gone or the user quits; the last that was heard of it, and whether it is gone."""
    over, screen = threading.Event(), Screen()
    try:
        with (
            Keyboard({"q": over.set}),
            Live(screen.take(status), console=console, screen=True, auto_refresh=False) as live,
        ):
            while not over.wait(_EVERY_SECONDS):
                now = operator.status_if_on()
                if now is None:
                    return status, True
                status = now
                live.update(screen.take(status), refresh=True)
    except KeyboardInterrupt:
        pass
    return status, False


VERB = verb(_watch, "watch --run mine", JoiningCommand)
