"""How a prediction looks in the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.table import Table

from zenoh_cbef.cli.console import number
from zenoh_cbef.cli.fitting import Fitting
from zenoh_cbef.words import counted

_MOST_ROWS = 12
_SCHEMES = {"average": "average", "chebyshev": "Chebyshev", "running-sums": "running sums"}


def design_lines(told: dict[str, Any]) -> Iterator[Fitting | str]:
    """Tables and sentences, in the order they are read."""
    yield _observability(told)
    seen = told["observability"]
    yield (
        f"rank and condition over {seen['steps']} steps in the middle; bound: posterior Cramér-Rao bound of the "
        f"position RMSE after step {told['skip']}"
    )
    gaps = ", ".join(f"{name} {told['spectral_gap'][key]:.3g}" for key, name in _SCHEMES.items())
    yield f"spectral gap (share of the disagreement that a round removes): {gaps}"
    if told["rounds"]:
        yield _rounds(told)
        yield from _answers(told)
    configured = told["configured"]
    line = f"as configured: {_SCHEMES[configured['scheme']]}, L = {configured['rounds']}, "
    line += f"{configured['bytes_per_step']:.0f} bytes per agent and step"
    if "position_rmse" in configured:
        line += f", expected position RMSE {number(configured['position_rmse'], 'm')}, "
        line += f"velocity RMSE {number(configured['velocity_rmse'], 'm/s')}"
    yield line
    yield from (f"note: {sentence}" for sentence in told["cannot"])


def _observability(told: dict[str, Any]) -> Fitting:
    seen = told["observability"]
    counts = ", ".join(counted(told[f"{one}s"], one) for one in ("agent", "edge", "step"))
    title = f"{told['name']}: {told['filter']}, {counts}"
    table = Table(title=title, title_justify="left")
    for column in ("sees", "rank", "condition", "bound (m)"):
        table.add_column(column, justify="left" if column == "sees" else "right")
    rows = [("network", seen["network"])]
    rows += [(f"agent {one['agent']} alone", one) for one in seen["agents"][:_MOST_ROWS]]
    for name, one in rows:
        rank = f"{one['rank']} of {seen['dimension']}"
        table.add_row(name, rank, number(one["condition"]), number(one["bound"]))
    if len(seen["agents"]) > _MOST_ROWS:
        table.add_row(f"and {len(seen['agents']) - _MOST_ROWS} more", "", "", "")
    return Fitting(table)


def _rounds(told: dict[str, Any]) -> Fitting:
    table = Table(title="expected position RMSE / centralised, and NEES", title_justify="left")
    table.add_column("L", justify="right")
    table.add_column("bytes (average)", justify="right")
    for name in _SCHEMES.values():
        table.add_column(name, justify="right")
        table.add_column("NEES", justify="right")
    for row in told["rounds"]:
        cells = [str(row["rounds"]), f"{next(row[key] for key in _SCHEMES if key in row)['bytes_per_step']:.0f}"]
        for key in _SCHEMES:
            found = row.get(key)
            enough = told["smallest"][key] == row["rounds"]
            ratio = f"{found['ratio_to_centralized']:.4f}" if found else ""
            cells += [f"[bold]{ratio}[/bold]" if enough else ratio, number(found["nees"]) if found else ""]
        table.add_row(*cells)
    return Fitting(table)


def _answers(told: dict[str, Any]) -> Iterator[str]:
    centralized, dimension = told["centralized"], told["observability"]["dimension"]
    yield (
        f"centralised: position RMSE {number(centralized['position_rmse'], 'm')}, velocity RMSE "
        f"{number(centralized['velocity_rmse'], 'm/s')}; the NEES of a consistent filter is {dimension}"
    )
    needed = ", ".join(
        f"{name} {'more than 64' if told['smallest'][key] is None else told['smallest'][key]}"
        for key, name in _SCHEMES.items()
    )
    yield f"smallest L within {100.0 * told['within']:g} % of centralised: {needed}"
