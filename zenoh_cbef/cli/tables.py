"""A run's results as terminal tables."""

from __future__ import annotations

from typing import Any

from rich.table import Table

from zenoh_cbef.analysis.metrics import LINK_COUNTS
from zenoh_cbef.cli.console import number
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.build import rounds_of, scheme_of


def scheme_line(scenario: Scenario) -> str:
    """What consensus.scheme = "auto" picked, and why; empty where nothing was picked."""
    if scenario.consensus.scheme != "auto" or rounds_of(scenario) == 0:
        return ""
    scheme, reason = scheme_of(scenario)
    return f"consensus.scheme = {scheme}: {reason[0].lower()}{reason[1:]}"


def metrics_table(metrics: dict[str, Any]) -> Table:
    """A run's result."""
    central, bound, messages = (metrics[name] for name in ("centralized", "bound", "messages"))
    title = f"{metrics['run']}: {metrics['filter']}, {metrics['agents']} agents, {metrics['steps']} steps"
    title += ", errors of x and y alone" if metrics["planar"] else ""
    table = Table(title=title if metrics["complete"] else title + " (incomplete)", title_justify="left")
    for column in ("", "network", "centralised", "bound"):
        table.add_column(column, justify="left" if not column else "right")
    for name, key, unit in (("position RMSE", "position_rmse", "m"), ("velocity RMSE", "velocity_rmse", "m/s")):
        table.add_row(name, *(number(source[key], unit) for source in (metrics, central, bound)))
    table.add_row("MSEE, average", number(metrics["msee"]["average"]), number(central["msee"]), number(bound["msee"]))
    table.add_row("ratio to centralised", number(metrics["ratio_to_centralized"]), "1", "")
    for name in ("nees", "nis"):
        found = metrics[name]
        if found is not None:
            share = "-" if found["inside"] is None else f"{found['inside']:.0%}"
            inside = "{} in [{:.3g}, {:.3g}]".format(share, *found["band"])
            table.add_row(name.upper(), number(found["average"]), f"ideal {found['dimension']}", inside)
    if (bias := metrics["bias"]) is not None:
        known = [value for value in bias["agents"] if value is not None]
        weights = [value for value in bias["weight"] if value is not None]
        relied = f"relied on: {sum(weights) / len(weights):.0%}" if weights else ""
        table.add_row(
            "bias of ranges", f"{number(min(known))} to {number(max(known), 'm')}" if known else "-", relied, ""
        )
    if (distrust := metrics["distrust"]) is not None:
        flagged = [f"{agent}: {share:.0%}" for agent, share in enumerate(distrust["agents"]) if share > 0.0]
        table.add_row("agents that distrust their ranges", ", ".join(flagged) or "none", "of the steps", "")
    table.add_row("disagreement", number(metrics["disagreement"], "m"), "", "")
    if metrics["left_out"]:
        table.add_row("left out of all this", f"agent {', '.join(map(str, metrics['left_out']))}", "", "")
    if messages["sent"]:
        table.add_row(
            "messages",
            f"{messages['sent']} sent",
            f"{messages['missing']} not logged",
            f"{messages['rejected']} rejected",
        )
    links = {name: sum(link[name] for link in metrics["links"]) for name in LINK_COUNTS}
    table.add_row("on links", f"{links['sent']} sent", f"{links['lost']} lost", f"{links['late']} late")
    lost, late, doubled = links["injected_lost"] + links["corrupted"], links["injected_late"], links["duplicated"]
    if lost or late or doubled:
        table.add_row("of these by faults", f"{doubled} doubled", f"{lost} lost", f"{late} late")
    return table


def summary_table(summary: dict[str, Any]) -> Table:
    """Many runs' results."""
    table = Table(
        title=f"{summary['run']}: {summary['filter']}, {summary['agents']} agents, {len(summary['seeds'])} seeds",
        title_justify="left",
    )
    for column in ("", "median", "least", "largest"):
        table.add_column(column, justify="left" if not column else "right")
    for name, values in summary.items():
        if isinstance(values, dict):
            table.add_row(name, *(number(values[column]) for column in ("median", "least", "largest")))
    return table
