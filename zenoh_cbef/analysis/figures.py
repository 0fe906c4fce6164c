"""The paper's three figures, and how lines look anywhere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.arrays import Floats, Ints
from zenoh_cbef.pages.parts import Plot

Dash = Literal["solid", "dash", "dot", "dashdot"]
Role = Literal["network", "centralized", "bound", "median", "most", "extreme"]

INK, MUTED = "#16191d", "#6b737c"
# Chosen from the usual colour-blind-safe sets for the largest least difference (CIE76 18) over normal vision,
# deuteranopia and protanopia, with contrast above 2.3 on white and on near-black alike.
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#AA3377", "#56B4E9", "#A6761D", "#785EF0", "#117733")
DASHES: tuple[Dash, ...] = ("solid", "dash", "dot", "dashdot")
ROLES: dict[Role, tuple[str, Dash]] = {
    "network": (INK, "solid"),
    "centralized": (INK, "dash"),
    "bound": (MUTED, "dot"),
    "median": (COLOURS[0], "solid"),
    "most": (COLOURS[0], "dash"),
    "extreme": (COLOURS[0], "dot"),
}
MOST_SHOWN = 100
"""Up to how many agents have a line, a row and a place on maps each; of more, percentiles are shown."""
PERCENTILES: dict[str, tuple[float, Role]] = {
    "largest": (1.0, "extreme"),
    "90 % below": (0.9, "most"),
    "median": (0.5, "median"),
    "10 % below": (0.1, "most"),
    "least": (0.0, "extreme"),
}

_POINTS, _POINTS_OF_ALL = 2000, 120_000


@dataclass(frozen=True)
class Reference:
    """One line that belongs to no agent: values (K,)."""

    name: str
    role: Role
    values: Floats


@dataclass(frozen=True)
class Chart:
    """A positive quantity over the steps, on a log axis.

    name: of its files and its place in the report. axis: the quantity and its unit. agents: (n, K), or None.
    band: two values between which the quantity should lie. scored: whether only the scored window counts.
    """

    name: str
    title: str
    caption: str
    axis: str
    agents: Floats | None
    references: tuple[Reference, ...] = ()
    band: tuple[float, float] | None = None
    scored: bool = False

    def values(self) -> list[Floats]:
        """Everything drawn as lines."""
        rows = [] if self.agents is None else list(self.agents)
        return [*rows, *(reference.values for reference in self.references)]

    @property
    def empty(self) -> bool:
        """Whether a log axis has nothing to show."""
        return not any(np.isfinite(positive(values)).any() for values in self.values())


def paper_charts(analysis: Analysis) -> list[Chart]:
    """Describe the paper's figures: innovation per agent, MSEE per agent, average MSEE."""
    kind = analysis.trace.scenario.filter.kind
    unit = "m²" if kind == "cbef" else "m"
    references = (
        Reference("centralised filter", "centralized", analysis.centralized_msee),
        Reference("posterior bound", "bound", analysis.bound_msee),
    )
    msee = "MSEE (m² + m²/s²)"
    charts = (
        Chart(
            "innovation",
            "(a) Innovation of each agent",
            "How far each agent's measurements were from its prediction; gaps where it heard no beacon.",
            f"innovation ({unit})",
            analysis.trace.diagnostics.innovation,
        ),
        Chart(
            "msee",
            "(b) MSEE of each agent",
            "Running mean from step 1 of the squared error of position and velocity together. "
            "Agents that agree cover one another.",
            msee,
            analysis.msee,
            references,
        ),
        Chart(
            "msee-average",
            "(c) Average MSEE",
            "The mean of (b) over the agents.",
            msee,
            None,
            (Reference("network", "network", analysis.msee_average), *references),
        ),
    )
    return [few_lines(chart) for chart in charts]


def percentiles(values: Floats) -> dict[str, Floats]:
    """`PERCENTILES` of values (n, ...) over the agents that have one, as values of agents; NaN where none has."""
    known = np.isfinite(values)
    ordered, last = np.sort(np.where(known, values, np.nan), axis=0), known.sum(axis=0) - 1
    found = {}
    for name, (share, _) in PERCENTILES.items():
        place = np.rint(share * np.maximum(last, 0)).astype(np.intp)
        found[name] = np.asarray(np.take_along_axis(ordered, place[None], axis=0)[0])
    return found


def few_lines(chart: Chart) -> Chart:
    """The same chart, with percentiles in place of the lines of very many agents."""
    if chart.agents is None or len(chart.agents) <= MOST_SHOWN:
        return chart
    lines = [Reference(name, PERCENTILES[name][1], values) for name, values in percentiles(chart.agents).items()]
    caption = f"{chart.caption} Percentiles of {len(chart.agents)} agents, at each step."
    return replace(chart, agents=None, references=(*lines, *chart.references), caption=caption)


def agent_names(analysis: Analysis) -> list[str]:
    """What figures and tables call the agents."""
    names, agents = analysis.trace.scenario.agents.names, analysis.trace.agents
    return list(names) if agents is None else [names[agent] for agent in agents.tolist()]


def agent_style(agent: int) -> tuple[str, Dash]:
    """Give an agent's colour and dash, the same in every figure; colours repeat with another dash."""
    return COLOURS[agent % len(COLOURS)], DASHES[agent // len(COLOURS) % len(DASHES)]


def points_each(lines: int, of_all: int = _POINTS_OF_ALL) -> int:
    """How many points a line may have where so many share a figure. of_all: how many they may have together."""
    return max(60, min(_POINTS, of_all // max(lines, 1)))


def positive(values: Floats) -> Floats:
    """Keep what a log axis can show; the rest becomes a gap."""
    shown = np.isfinite(values) & (np.nan_to_num(values) > 0.0)
    return np.where(shown, values, np.nan)


def thinned(values: Floats, points: int) -> Ints:
    """Choose about `points` indices of the values (K,), among them the extremes and one of each gap."""
    count = len(values)
    if count <= points:
        return np.arange(count)
    width = -(-count // max(points // 3, 1))
    starts = np.arange(0, count, width)
    padded = np.full(len(starts) * width, np.nan)
    padded[:count] = values
    table = padded.reshape(-1, width)
    gaps = np.isnan(table)
    chosen = [
        np.where(gaps, np.inf, table).argmin(axis=1),
        np.where(gaps, -np.inf, table).argmax(axis=1),
        gaps.argmax(axis=1),
    ]
    inside = np.concatenate([[0, count - 1], *(starts + offset for offset in chosen)])
    return np.unique(np.minimum(inside, count - 1))


def has_lone_points(values: Floats) -> bool:
    """Whether some value stands between two gaps, where a line would not show it."""
    there = np.concatenate([[False], np.isfinite(values), [False]])
    return bool((there[1:-1] & ~there[:-2] & ~there[2:]).any())


def log_range(chart: Chart) -> tuple[float, float]:
    """Limits of a log axis; a few values that are almost zero do not stretch it."""
    return log_limits(np.concatenate([*(np.ravel(values) for values in chart.values()), np.array(chart.band or ())]))


def log_limits(values: Floats) -> tuple[float, float]:
    """As `log_range`, of these values."""
    shown = values[np.isfinite(values) & (values > 0.0)]
    if not shown.size:
        return 0.1, 10.0
    low, high = max(shown.min(), np.quantile(shown, 0.002) / 2.0), shown.max()
    margin = max((high / low) ** 0.05, 1.1)
    return float(low / margin), float(high * margin)


def log_axis(title: str, low: float, high: float) -> Plot:
    """A logarithmic axis with few marks, for values from 10^low to 10^high."""
    marks = 1 if high - low > 3.2 else "D2"
    return {"type": "log", "exponentformat": "power", "dtick": marks, "title": {"text": title}}
