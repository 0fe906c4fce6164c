"""A run's figures for notebooks and papers: what the report shows, drawn with matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.printed import PLAIN, Style, drawn
from zenoh_cbef.analysis.report import figures_of
from zenoh_cbef.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class _Analysed(Protocol):
    @property
    def analysis(self) -> Analysis: ...


class Plots:
    """Figures of one run; each call draws one and returns it, and a notebook shows it."""

    def __init__(self, run: _Analysed) -> None:
        self._run = run

    @property
    def names(self) -> list[str]:
        """What `named` draws: the figures of the report that this run has."""
        return [one.name for one in figures_of(self._run.analysis) if one.plot is not None]

    def map(self, style: Style = PLAIN) -> Figure:
        """Truth, estimates and agents from above."""
        return self.named("top", style)

    def errors(self, style: Style = PLAIN) -> Figure:
        """The position error of each agent over time, beside the centralised filter and the bound."""
        return self.named("position-error", style)

    def links(self, style: Style = PLAIN) -> Figure:
        """Each link between agents, by the share of messages that were lost or late."""
        return self.named("network", style)

    def named(self, name: str, style: Style = PLAIN) -> Figure:
        """A figure of the report, by its name. Raises UserError where this run has none of it."""
        found = {one.name: one.plot for one in figures_of(self._run.analysis)}
        plot = found.get(name)
        if plot is None:
            raise UserError(f"this run has no figure {name!r}; it has {', '.join(self.names)}")
        return drawn(plot, style)
