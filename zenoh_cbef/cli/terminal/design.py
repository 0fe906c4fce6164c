"""How a prediction looks in the terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.table import Table

from zenoh_cbef.analysis.designed import Design
from zenoh_cbef.analysis.mixing import Scheme
from zenoh_cbef.analysis.recommended import Recommended
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.numbers import number
from zenoh_cbef.words import counted

_MOST_ROWS = 12
_SCHEMES: dict[Scheme, str] = {"average": "average", "chebyshev": "Chebyshev", "running-sums": "running sums"}


def design_lines(told: Design) -> Iterator[Fitting | str]:
    """Tables and sentences, in the order they are read."""
    yield _observability(told)
    seen = told.observability
    yield (
        f"rank and condition over {seen.steps} steps in the middle; bound: posterior Cramér-Rao bound of the "
        f"position RMSE after step {told.skip}"
    )
    gaps = ", ".join(f"{name} {told.spectral_gap[key]:.3g}" for key, name in _SCHEMES.items())
    yield f"spectral gap (share of the disagreement that a round removes): {gaps}"
    if told.rounds:
        yield _rounds(told)
        yield from _answers(told)
    configured = told.configured
    line = f"as configured: {_SCHEMES[configured.scheme]}, L = {configured.rounds}, "
    line += f"{configured.bytes_per_step:.0f} bytes per agent and step"
    if found := configured.expected:
        line += f", expected position RMSE {number(found.position_rmse, 'm')}, "
        line += f"velocity RMSE {number(found.velocity_rmse, 'm/s')}"
    yield line
    agent, recorder = told.demand.agent, told.demand.recorder
    yield (
        f"a step as configured: an agent has {number(agent.links)} links, sends {number(agent.sent)} messages and gets "
        f"{number(agent.received)} (means); the recorder gets {recorder.received:g}, "
        f"{number(1e-3 * recorder.bytes_received)} kB (docs/scale.md)"
    )
    if configured.rounds:
        yield (
            f"consensus.precision = {told.precision!r}: a message of {told.bytes.round[configured.scheme]} bytes, "
            f"{number(1e-3 * told.demand.link, 'kbit/s')} on a link, either way (docs/bytes.md)"
        )
    if told.recommended is not None:
        yield _recommended(told.recommended)
    yield from (f"note: {sentence}" for sentence in told.cannot)


def _recommended(told: Recommended) -> str:
    keys = [f"--set consensus.rounds={told.rounds}", f"--set consensus.precision='\"{told.precision}\"'"]
    if told.trigger:
        keys.append(f"--set consensus.trigger={told.trigger:g}")
    short = ""
    if not told.fits:
        keys.append(f"--set dt={told.dt:g}")
        short = "no round fits into a step; a longer one has room: "
    reached = "" if told.ratio is None else f", expected position RMSE / centralised {told.ratio:.4f}"
    most = f"{number(told.link, 'kbit/s')} at most"
    return f"for a link of {told.kbits:g} kbit/s: {short}{' '.join(keys)} ({most}{reached})"


def _observability(told: Design) -> Fitting:
    seen = told.observability
    counts = f"{counted(told.agents, 'agent')}, {counted(told.edges, 'edge')}, {counted(told.steps, 'step')}"
    title = f"{told.name}: {told.filter}, {counts}"
    table = Table(title=title, title_justify="left")
    for column in ("sees", "rank", "condition", "bound (m)"):
        table.add_column(column, justify="left" if column == "sees" else "right")
    rows = [("network", seen.network)]
    rows += [(f"agent {agent} alone", one) for agent, one in enumerate(seen.agents[:_MOST_ROWS])]
    for name, one in rows:
        rank = f"{one.rank} of {seen.dimension}"
        table.add_row(name, rank, number(one.condition), number(one.bound))
    if len(seen.agents) > _MOST_ROWS:
        table.add_row(f"and {len(seen.agents) - _MOST_ROWS} more", "", "", "")
    return Fitting(table)


def _rounds(told: Design) -> Fitting:
    table = Table(title="expected position RMSE / centralised, and NEES", title_justify="left")
    table.add_column("L", justify="right")
    table.add_column("bytes (average)", justify="right")
    for name in _SCHEMES.values():
        table.add_column(name, justify="right")
        table.add_column("NEES", justify="right")
    for row in told.rounds:
        cells = [str(row.rounds), f"{next(iter(row.schemes.values())).bytes_per_step:.0f}"]
        for key in _SCHEMES:
            found = row.schemes.get(key)
            enough = told.smallest[key] == row.rounds
            ratio = f"{found.ratio_to_centralized:.4f}" if found else ""
            cells += [f"[bold]{ratio}[/bold]" if enough else ratio, number(found.nees) if found else ""]
        table.add_row(*cells)
    return Fitting(table)


def _answers(told: Design) -> Iterator[str]:
    if told.centralized is not None:
        yield (
            f"centralised: position RMSE {number(told.centralized.position_rmse, 'm')}, velocity RMSE "
            f"{number(told.centralized.velocity_rmse, 'm/s')}; the NEES of a consistent filter is "
            f"{told.observability.dimension}"
        )
    needed = ", ".join(
        f"{name} {'more than 64' if told.smallest[key] is None else told.smallest[key]}"
        for key, name in _SCHEMES.items()
    )
    yield f"smallest L within {100.0 * told.within:g} % of centralised: {needed}"
