"""A run's results as terminal tables."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from zenoh_cbef.analysis.metrics import LINK_COUNTS
from zenoh_cbef.cli.console import number
from zenoh_cbef.cli.fitting import Fitting, Told
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.words import counted


def scheme_line(plan: Plan) -> str:
    """What consensus.scheme = "auto" picked, and why; empty where nothing was picked."""
    if plan.scenario.consensus.scheme != "auto" or plan.rounds == 0:
        return ""
    scheme, reason = plan.scheme
    return f"consensus.scheme = {scheme}: {reason[0].lower()}{reason[1:]}"


def metrics_table(metrics: dict[str, Any]) -> Fitting:
    """A run's result."""
    central, bound, messages = (metrics[name] for name in ("centralized", "bound", "messages"))
    counts = f"{counted(metrics['agents'], 'agent')}, {counted(metrics['steps'], 'step')}"
    title = f"{metrics['run']}: {metrics['filter']}, {counts}"
    title += ", errors of x and y alone" if metrics["planar"] else ""
    table = Table(title=title if metrics["complete"] else title + " (incomplete)", title_justify="left")
    for column in ("", "network", "centralised", "bound"):
        table.add_column(column, justify="left" if not column else "right")
    for name, key, unit in (("position RMSE", "position_rmse", "m"), ("velocity RMSE", "velocity_rmse", "m/s")):
        table.add_row(name, *(number(source[key], unit) for source in (metrics, central, bound)))
    table.add_row("MSEE, average", number(metrics["msee"]["average"]), number(central["msee"]), number(bound["msee"]))
    table.add_row("ratio to centralised", number(ratio := metrics["ratio_to_centralized"]), "1" if ratio else "-", "")
    for name in ("nees", "nis"):
        found = metrics[name]
        if found is not None:
            share = "-" if found["inside"] is None else f"{found['inside']:.0%}"
            inside = "{} in [{:.3g}, {:.3g}]".format(share, *found["band"])
            table.add_row(name.upper(), number(found["average"]), Told(f"ideal {found['dimension']}"), Told(inside))
    for name, title, cells in _WHERE_TOLD:
        if metrics[name] is not None:
            agents, *told = cells(metrics[name])
            table.add_row(title, agents, *map(Told, told))
    table.add_row("disagreement", number(metrics["disagreement"], "m"), "", "")
    for row in _remarks(metrics):
        table.add_row(*row)
    if messages["sent"]:
        table.add_row(
            "messages",
            Told(f"{messages['sent']} sent"),
            Told(f"{messages['missing']} not logged"),
            Told(f"{messages['rejected']} rejected"),
        )
    links = {name: sum(link[name] for link in metrics["links"]) for name in LINK_COUNTS}
    on_links = (Told(f"{links[name]} {name}") for name in ("sent", "lost", "late"))
    table.add_row("on links", *on_links)
    lost, late, doubled = links["injected_lost"] + links["corrupted"], links["injected_late"], links["duplicated"]
    if lost or late or doubled:
        table.add_row("of these by faults", Told(f"{doubled} doubled"), Told(f"{lost} lost"), Told(f"{late} late"))
    return Fitting(table)


def _bias_cells(bias: dict[str, Any]) -> tuple[str, str, str]:
    known = [value for value in bias["agents"] if value is not None]
    weights = [value for value in bias["weight"] if value is not None]
    relied = f"relied on: {sum(weights) / len(weights):.0%}" if weights else ""
    return f"{number(min(known))} to {number(max(known), 'm')}" if known else "-", relied, ""


def _distrust_cells(distrust: dict[str, Any]) -> tuple[str, str, str]:
    flagged = [f"{agent}: {share:.0%}" for agent, share in enumerate(distrust["agents"]) if share]
    return ", ".join(flagged) or "none", "of the steps", ""


def _slow_cells(slow: dict[str, Any]) -> tuple[str, str, str]:
    """Mean and largest share of the agents' rounds, and the target's share: narrow, for terminals of 80 columns."""
    shares = [share for share in slow["agents"] if share is not None]
    agents = (f"{sum(shares) / len(shares):.0%}", f"at most {max(shares):.0%}") if shares else ("-", "")
    return *agents, "" if slow["target"] is None else f"beacons {slow['target']:.0%}"


_WHERE_TOLD = (
    ("bias", "bias of ranges", _bias_cells),
    ("distrust", "agents that distrust their ranges", _distrust_cells),
    ("slow", "late by own slowness", _slow_cells),
)
"""Metrics that not every run has: name, title of the row, and its cells."""


def _remarks(metrics: dict[str, Any]) -> list[list[str]]:
    """Rows, of four cells, for what not every run has."""
    rows = []
    if unseen := metrics["unobservable_steps"]:
        cells = [f"{first} to {last}" for first, last in unseen]
        last = [f"and {len(cells) - 2} more" if len(cells) > 3 else cells[2]] if len(cells) > 2 else []
        rows.append([*("undetermined in steps", *cells[:2], *last), *[""] * (3 - len(cells))])
    if metrics["left_out"]:
        rows.append(["left out of all this", f"agent {', '.join(map(str, metrics['left_out']))}", "", ""])
    return rows


def summary_table(summary: dict[str, Any]) -> Fitting:
    """Many runs' results."""
    counts = f"{counted(summary['agents'], 'agent')}, {counted(len(summary['seeds']), 'seed')}"
    table = Table(title=f"{summary['run']}: {summary['filter']}, {counts}", title_justify="left")
    for column in ("", "median", "least", "largest"):
        table.add_column(column, justify="left" if not column else "right")
    for name, values in summary.items():
        if isinstance(values, dict):
            table.add_row(name, *(number(values[column]) for column in ("median", "least", "largest")))
    return Fitting(table)
