"""A run's results as terminal tables."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from zenoh_cbef.analysis.results import Bias, Distrust, Honesty, Metrics, Slowness
from zenoh_cbef.analysis.summary import SUMMARIZED, Summary
from zenoh_cbef.cli.terminal.fitting import Fitting, Told
from zenoh_cbef.numbers import number
from zenoh_cbef.words import counted, first_of

_NAMED = 8
"""Agents of which a row speaks; of a large network all of them would fill the screen."""
_TOLD = 0.005
"""Shares that are less are no whole per cent."""
_FEW_SEEDS = 22
"""From so many seeds on, one of them is above what 90 % are below, with a probability of 90 %: 0.9^22 < 0.1."""


def metrics_table(metrics: Metrics) -> Fitting:
    """A run's result."""
    messages = metrics.messages
    claimed = None if metrics.scored.steps else metrics.claimed_position_error
    title = f"{metrics.run}: {metrics.filter}, {counted(metrics.agents, 'agent')}, {counted(metrics.steps, 'step')}"
    title += ", errors of x and y alone" if metrics.planar else ""
    title += "" if metrics.complete else " (stopped early)" if metrics.stopped else " (incomplete)"
    table = Table(title=title, title_justify="left")
    for column in ("", "network", "centralised", "bound") if claimed is None else ("", "network", "", ""):
        table.add_column(column, justify="left" if not column else "right")
    if claimed is None:
        for error in _errors(metrics):
            table.add_row(*error)
    else:
        table.add_row("position error, as claimed", number(claimed, "m"), "", "")
    for name, found in (("NEES", metrics.nees), ("NIS", metrics.nis)):
        if found is not None:
            table.add_row(name, number(found.average), Told(f"ideal {found.dimension}"), _inside(found))
    for told in _where_told(metrics):
        table.add_row(*told)
    table.add_row("disagreement", number(metrics.disagreement, "m"), "", "")
    for remark in _remarks(metrics):
        table.add_row(*remark)
    if messages.sent:
        # A log that was cut off does not know what came later.
        known = messages.missing or metrics.complete or metrics.stopped
        table.add_row(
            "messages",
            Told(f"{messages.sent} sent"),
            Told(f"{messages.missing if known else '?'} not logged"),
            Told(f"{messages.rejected} rejected"),
        )
    for counts in _on_links(metrics):
        table.add_row(*counts)
    return Fitting(table)


def _errors(metrics: Metrics) -> Iterator[tuple[str | Told, ...]]:
    """Rows, of four cells, of errors beside those of the yardsticks."""
    central, bound, ratio = metrics.centralized, metrics.bound, metrics.ratio_to_centralized
    sources = metrics, central, bound
    yield "position RMSE", *(number(source.position_rmse, "m") for source in sources)
    yield "velocity RMSE", *(number(source.velocity_rmse, "m/s") for source in sources)
    yield "MSEE, average", number(metrics.msee.average), number(central.msee), number(bound.msee)
    yield "ratio to centralised", number(ratio), "1" if ratio else "-", ""
    if metrics.strong != central:
        reached = Told(f"reaches {number(metrics.strong.position_rmse, 'm')}")
        lost = Told("centralised: lost" if metrics.twin_lost else "")
        yield "ratio to strong yardstick", number(metrics.ratio_to_strong), reached, lost
    yield "ratio to bound", number(metrics.ratio_to_bound), "", "1 on average" if metrics.ratio_to_bound else "-"


def _inside(found: Honesty) -> Told:
    share = "-" if found.inside is None else f"{found.inside:.0%}"
    return Told("{} in [{:.3g}, {:.3g}]".format(share, *found.band))


def _on_links(metrics: Metrics) -> Iterator[tuple[str | Told, ...]]:
    links = metrics.links_total
    if metrics.precision != "float64" or metrics.silent is not None:
        silent = "" if metrics.silent is None else f"silent {metrics.silent:.0%}"
        size = Told(number(metrics.link_bytes_per_step, "B"))
        yield "on a link, a step", size, Told(metrics.precision), Told(silent)
    yield "on links", Told(f"{links.sent} sent"), Told(f"{links.lost} lost"), Told(f"{links.late} late")
    lost, late, doubled = links.injected_lost + links.corrupted, links.injected_late, links.duplicated
    if lost or late or doubled:
        yield "of these by faults", Told(f"{doubled} doubled"), Told(f"{lost} lost"), Told(f"{late} late")


def _where_told(metrics: Metrics) -> Iterator[tuple[str | Told, ...]]:
    """Rows, of four cells, of metrics that not every run has."""
    if told := metrics.smoothed:
        yield "smoothed position", number(told.position_rmse, "m"), number(told.centralized_position_rmse, "m"), ""
        yield "smoothed velocity", number(told.velocity_rmse, "m/s"), "", ""
        if found := told.nees:
            yield "smoothed NEES", number(found.average), Told(f"ideal {found.dimension}"), _inside(found)
    for name, stood in (metrics.status or {}).items():
        if stood.share:
            share = Told(f"{stood.share:.0%} of run")
            if stood.nees is None and stood.position_rmse is None:
                yield name, share, "", ""
            else:
                yield f"while {name}", number(stood.position_rmse, "m"), share, Told(f"NEES {number(stood.nees)}")
    if metrics.bias:
        yield "bias of ranges", *_bias_cells(metrics.bias)
    if metrics.distrust:
        yield "agents that distrust their ranges", _distrust_cell(metrics.distrust), "", ""
    if metrics.slow:
        yield "late by own slowness", *_slow_cells(metrics.slow)


def _bias_cells(bias: Bias) -> tuple[str, Told, Told]:
    known = [value for value in bias.agents if value is not None]
    weights = [value for value in bias.weight if value is not None]
    relied = f"relied on: {sum(weights) / len(weights):.0%}" if weights else ""
    return f"{number(min(known))} to {number(max(known), 'm')}" if known else "-", Told(relied), Told("")


def _distrust_cell(distrust: Distrust) -> str:
    """The agents that distrust most of the time first."""
    shares = {agent: share for agent, share in enumerate(distrust.agents) if share}
    worst = sorted(shares, key=lambda agent: -shares[agent])
    flagged = [f"{agent}: {shares[agent]:.0%}" if shares[agent] >= _TOLD else f"{agent}: under 1%" for agent in worst]
    return first_of([f"{flagged[0]} of the steps", *flagged[1:]], _NAMED) if flagged else "none"


def _slow_cells(slow: Slowness) -> tuple[str, Told, Told]:
    """Mean and largest share of the agents' rounds, and the target's share: narrow, for terminals of 80 columns."""
    shares = [share for share in slow.agents if share is not None]
    mean, most = (f"{sum(shares) / len(shares):.0%}", f"at most {max(shares):.0%}") if shares else ("-", "")
    return mean, Told(most), Told("" if slow.target is None else f"beacons {slow.target:.0%}")


def _remarks(metrics: Metrics) -> list[list[str]]:
    """Rows, of four cells, for what not every run has."""
    rows = []
    if unseen := metrics.unobservable_steps:
        cells = [f"{first} to {last}" for first, last in unseen]
        last = [f"and {len(cells) - 2} more" if len(cells) > 3 else cells[2]] if len(cells) > 2 else []
        rows.append([*("undetermined in steps", *cells[:2], *last), *[""] * (3 - len(cells))])
    if metrics.left_out:
        rows.append(["left out of all this", f"agent {first_of([*map(str, metrics.left_out)], _NAMED)}", "", ""])
    return rows


def summary_table(summary: Summary) -> Fitting:
    """Many runs' results."""
    counts = f"{counted(summary.agents, 'agent')}, {counted(len(summary.seeds), 'seed')}"
    table = Table(title=f"{summary.run}: {summary.filter}, {counts}", title_justify="left")
    columns = {"median": "median", "p90": "90 % below", "least": "least", "largest": "largest"}
    if len(summary.seeds) < _FEW_SEEDS:
        del columns["p90"]
    for head in ("", *columns.values()):
        table.add_column(head, justify="right" if head else "left")
    for name, spread in summary.spreads.items():
        words, unit = SUMMARIZED[name]
        if spread is not None:
            table.add_row(words, *(_in_unit(getattr(spread, column), unit) for column in columns))
    for words, share in (("target lost", summary.share_lost), ("centralised filter lost", summary.share_twin_lost)):
        if share:
            table.add_row(words, Told(f"in {share:.0%} of the seeds"), *[""] * (len(columns) - 1))
    return Fitting(table)


def _in_unit(value: float, unit: str) -> str:
    return f"{value:.0%}" if unit == "%" else number(value, unit)
