"""A run's status as terminal tables."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from zenoh_cbef.cli.console import number
from zenoh_cbef.nodes.status import AgentStatus, LinkStatus, RunStatus, Whereabouts

_MOST_LINKS = 12
_WIDEST = 24
_COLOURS = {"on": "green", "ready": "green", "silent": "red", "gone": "red", "killed": "yellow", "paused": "yellow"}
_SERIOUS = {"silent": "red", "rejected": "yellow", "fault": "yellow", "killed": "yellow", "paused": "yellow"}


def status_view(status: RunStatus) -> RenderableType:
    """Everything, from the whole to the parts."""
    parts: list[RenderableType] = [headline(status), Text(), agents_table(status)]
    if status.links:
        parts += [Text(), links_table(status)]
    return Group(*parts)


def headline(status: RunStatus) -> Text:
    """The run as a whole, in a few lines."""
    at = "not started" if status.step is None else f"step {status.step} of {status.steps}, {number(status.time)} s"
    lines = [
        f"run {status.run}: {status.filter}, {len(status.agents)} agents, {status.mode}; {status.state}, {at}",
        f"error {number(status.error, 'm')}, disagreement {number(status.disagreement, 'm')}",
        f"target {_place(status.target)}; recorder {_place(status.recorder) if status.recorder else 'none'}",
    ]
    lines += [f"fault {fault['fault']} is on: {_keys_of(fault)}" for fault in status.faults]
    missing = [str(one.agent) for one in status.agents if one.state in {"missing", "gone"}]
    text = Text("\n".join(lines))
    if missing:
        text.append(f"\nnot here: agent {', '.join(missing)}", style="red")
    versions = {one.where.version for one in status.agents if one.where.version} | {status.target.version}
    if len(versions) > 1:
        text.append(f"\nversions differ: {', '.join(sorted(map(str, versions)))}", style="red")
    return text


def _keys_of(fault: dict[str, object]) -> str:
    rest = [f"{key}={json.dumps(value)}" for key, value in fault.items() if key not in {"fault", "kind"}]
    return " ".join([str(fault["kind"]), *rest])


def _place(where: Whereabouts) -> str:
    return "here" if where.host is None else f"{where.host}:{where.pid} {where.version}"


def agents_table(status: RunStatus) -> Table:
    """Who is where, and how well it tracks."""
    table = Table(box=None, pad_edge=False)
    for column in ("agent", "", "host", "pid", "version", "clock, ms", "step", "error, m", "claimed, m", "NIS"):
        words = column in {"", "host", "version"}
        table.add_column(column, justify="left" if words else "right", no_wrap=True, max_width=_WIDEST)
    for one in status.agents:
        table.add_row(*_agent_cells(one))
    return table


def _agent_cells(one: AgentStatus) -> Sequence[str | Text]:
    where = one.where
    return (
        str(one.agent),
        Text(one.state, style=_COLOURS.get(one.state, "")),
        where.host or "-",
        "-" if where.pid is None else str(where.pid),
        where.version or "-",
        "-" if where.clock is None else f"{1e3 * where.clock:+.2f}",
        "-" if one.step is None else str(one.step),
        number(one.error),
        number(one.spread),
        number(one.nis),
    )


def links_table(status: RunStatus) -> Table:
    """What was received and lost, link by link, the worst first."""
    worst = sorted(status.links, key=_trouble, reverse=True)
    more = len(worst) - _MOST_LINKS
    caption = f"the worst of {len(worst)} links, since the start; --json has all" if more > 0 else "since the start"
    table = Table(box=None, pad_edge=False, caption=caption, caption_justify="left")
    for column in ("from", "to", "received", "lost", "late", "latency, ms"):
        table.add_column(column, justify="right", no_wrap=True)
    for link in worst[:_MOST_LINKS]:
        latency = None if link.latency is None else 1e3 * link.latency
        ends = (str(link.source), str(link.destination))
        table.add_row(*ends, str(link.received), _share(link, link.lost), _share(link, link.late), number(latency))
    return table


def _share(link: LinkStatus, count: int) -> str:
    total = link.received + link.lost + link.late
    return f"{count} ({count / total:.1%})" if count else "0"


def _trouble(link: LinkStatus) -> tuple[float, float]:
    total = max(1, link.received + link.lost + link.late)
    return (link.lost + link.late) / total, link.latency or 0.0


def events_view(status: RunStatus, most: int) -> Text:
    """The latest events, the last one at the bottom."""
    text = Text()
    for event in status.events[-most:]:
        clock = time.strftime("%H:%M:%S", time.localtime(event["at"]))
        text.append(f"{clock} {event['from']}: {event['text']}\n", style=_SERIOUS.get(event["kind"], ""))
    return text
