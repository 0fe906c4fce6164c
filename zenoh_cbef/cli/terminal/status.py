"""A run's status as terminal tables."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.cli.terminal.ids import ids_of, shortened
from zenoh_cbef.numbers import number
from zenoh_cbef.outside.status import AgentStatus, LinkStatus, RunStatus, Whereabouts
from zenoh_cbef.protocol.slow import REMEDY, SLOW
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.words import counted

_MOST_LINKS = 12
_FEW_AGENTS, _WORST_AGENTS = 24, 10
_WORST = ("gone", "missing", "silent", "killed", "paused", "lost", "coasting", "acquiring")
_COLOURS = {"on": "green", "ready": "green", "silent": "red", "gone": "red", "killed": "yellow", "paused": "yellow"}
_COLOURS |= {"tracking": "green", "coasting": "yellow", "lost": "red"}
_SERIOUS = {
    "silent": "red",
    SLOW: "red",
    "unobservable": "red",
    "rejected": "yellow",
    "fault": "yellow",
    "killed": "yellow",
    "paused": "yellow",
}


_CARRIED = "neither reaches the other; the target carries their messages"
_APART = "neither reaches the other, and the target carries nothing; check --listen and --connect"
_MOST_PAIRS = 5


def status_view(status: RunStatus, find: str = "") -> RenderableType:
    """Everything, from the whole to the parts. find: which agents alone, as for `agents_table`."""
    parts: list[RenderableType] = [headline(status), Text(), agents_table(status, find=find)]
    if status.links:
        parts += [Text(), links_table(status)]
    return Group(*parts)


def headline(status: RunStatus) -> Text:
    """The run as a whole, in a few lines."""
    at = "not started" if status.step is None else f"step {status.step} of {status.steps}, {number(status.time)} s"
    agents = counted(len(status.agents), "agent")
    lines = [
        f"run {status.run}: {status.filter}, {agents}, {status.mode}; {status.state}, {at}",
        f"error {number(status.error, 'm')}, disagreement {number(status.disagreement, 'm')}",
        f"target {_place(status.target)}; recorder {_place(status.recorder) if status.recorder else 'none'}",
    ]
    lines += [f"fault {fault['fault']} is on: {_keys_of(fault)}" for fault in status.faults]
    text = Text("\n".join(lines))
    if status.unobservable:
        text.append(f"\nthe position cannot be determined: {status.unobservable}", style="red")
    for carried, style in ((True, "yellow"), (False, "red")):
        if pairs := [
            f"{in_words(one.first)} and {in_words(one.second)}" for one in status.apart if one.carried is carried
        ]:
            text.append(f"\n{_and_more(pairs)}: {_CARRIED if carried else _APART}", style=style)
    missing = [one.agent for one in status.agents if one.state in {"missing", "gone"}]
    if missing:
        text.append(f"\nnot here: agent {shortened(missing).replace(',', ', ')}", style="red")
    if status.slow:
        names = ", ".join(map(in_words, status.slow))
        text.append(f"\ndo not keep up with real time: {names}; {REMEDY}", style="red")
    versions = {one.where.version for one in status.agents if one.where.version} | {status.target.version}
    if len(versions) > 1:
        text.append(f"\nversions differ: {', '.join(sorted(map(str, versions)))}", style="red")
    return text


def _and_more(names: list[str]) -> str:
    more = len(names) - _MOST_PAIRS
    return "; ".join([*names[:_MOST_PAIRS], *([f"{more} more pairs"] if more > 0 else [])])


def _keys_of(fault: dict[str, object]) -> str:
    # Times of steps are as exact as floats are: 3.3000000000000003.
    short = {key: round(value, 9) if isinstance(value, float) else value for key, value in fault.items()}
    rest = [f"{key}={json.dumps(value)}" for key, value in short.items() if key not in {"fault", "kind"}]
    return " ".join([str(fault["kind"]), *rest])


def _place(where: Whereabouts) -> str:
    return "here" if where.host is None else f"{where.host}:{where.pid} {where.version}"


def agents_table(status: RunStatus, *, brief: bool = False, find: str = "") -> Fitting:
    """Where each agent is, and how well it tracks; brief: without the place. Of many agents only the worst.

    find: only those of a list of ids, as in "0-9,17", or of a host or a state with these letters, all of them. Host
    and version stand there only where an agent's are not the target's, which the headline has.
    """
    target = status.target
    places = [] if brief else ["pid", "clock, ms"]
    if any(one.where.version not in {None, target.version} for one in status.agents) and not brief:
        places.insert(1, "version")
    if any(one.where.host not in {None, target.host} for one in status.agents) and not brief:
        places.insert(0, "host")
    chosen = _found(status.agents, find) if find else status.agents
    few = len(chosen) <= _FEW_AGENTS or bool(find)
    shown = chosen if few else sorted(chosen, key=_badness, reverse=True)[:_WORST_AGENTS]
    caption = None if few else f"the worst of {len(chosen)} agents; 'status --find 0-9' shows others, --json all"
    table = Table(box=None, pad_edge=False, caption=caption, caption_justify="left")
    columns = ("agent", "", *places, "step", "error, m", "claimed, m", "NIS")
    for column in columns:
        words = column in {"", "host", "version"}
        table.add_column(column, justify="left" if words else "right", no_wrap=True)
    for one in shown:
        cells = _agent_cells(one)
        table.add_row(*map(cells.__getitem__, columns))
    return Fitting(table)


def _found(agents: Sequence[AgentStatus], find: str) -> list[AgentStatus]:
    if find[0].isdecimal():
        ids = set(ids_of(find, "--find"))
        return [one for one in agents if one.agent in ids]
    return [one for one in agents if any(find in (word or "") for word in (one.where.host, one.state, one.estimate))]


def _badness(one: AgentStatus) -> tuple[int, float]:
    """The order of agents: those that are not there, then by what they say of their estimates, then by their errors."""
    words = [one.state, one.estimate or ""]
    rank = max(len(_WORST) - _WORST.index(word) if word in _WORST else 0 for word in words)
    return rank, one.error or 0.0


def _agent_cells(one: AgentStatus) -> dict[str, str | Text]:
    where = one.where
    return {
        "agent": str(one.agent),
        "": _state(one),
        "host": where.host or "-",
        "pid": "-" if where.pid is None else str(where.pid),
        "version": where.version or "-",
        "clock, ms": "-" if where.clock is None else f"{1e3 * where.clock:+.2f}",
        "step": "-" if one.step is None else str(one.step),
        "error, m": number(one.error),
        "claimed, m": number(one.spread),
        "NIS": number(one.nis),
    }


def _state(one: AgentStatus) -> Text:
    """Whether an agent is there; of one that takes part, what it says of its estimate, and if need be how long."""
    if one.state != "on" or one.estimate is None:
        return Text(one.state, style=_COLOURS.get(one.state, ""))
    calm = one.estimate == "tracking" or one.estimate_seconds is None
    said = one.estimate if calm else f"{one.estimate} {one.estimate_seconds:.1f} s"
    return Text(said, style=_COLOURS.get(one.estimate, ""))


def links_table(status: RunStatus) -> Fitting:
    """What was received and lost, link by link, the worst first."""
    worst = sorted(status.links, key=_trouble, reverse=True)
    more = len(worst) - _MOST_LINKS
    known = (link.recent_seconds for link in worst if link.recent_seconds is not None)
    caption = f"since the start; now: in the last {round(max(known, default=0.0))} s"
    caption += f"; the worst of {len(worst)} links, --json has all" if more > 0 else ""
    table = Table(box=None, pad_edge=False, caption=caption, caption_justify="left")
    for column in ("from", "to", "received", "lost", "now", "late", "now", "latency, ms"):
        table.add_column(column, justify="right", no_wrap=True)
    for link in worst[:_MOST_LINKS]:
        latency = None if link.latency is None else 1e3 * link.latency
        counts = (link.received, link.lost, link.late)
        recent = (link.recent_received, link.recent_lost, link.recent_late)
        table.add_row(
            *(str(link.source), str(link.destination), str(link.received)),
            *(_count(link.lost, counts), _share(link.recent_lost, recent)),
            *(_count(link.late, counts), _share(link.recent_late, recent)),
            number(latency),
        )
    return Fitting(table)


def links_line(status: RunStatus) -> Text:
    """All links in one sentence, with the share of the last seconds, too."""
    said = [f"{sum(one.received for one in status.links)} received"]
    for name in ("lost", "late"):
        counts = [sum(getattr(one, each) for one in status.links) for each in (name, "received", "lost", "late")]
        recent = [getattr(one, f"recent_{each}") for one in status.links for each in ("received", "lost", "late")]
        now = sum(getattr(one, f"recent_{name}") or 0 for one in status.links)
        said.append(f"{_count(counts[0], counts[1:])} {name}, lately {_share(now, recent)}")
    return Text("links: " + "; ".join(said))


def _count(count: int, of: Sequence[int | None]) -> str:
    return f"{count} ({_share(count, of)})" if count else "0"


def _share(count: int | None, of: Sequence[int | None]) -> str:
    """A count's share of the sum of all, as text."""
    total = sum(one or 0 for one in of)
    return "-" if count is None or not total else f"{count / total:.1%}" if count else "0"


def _trouble(link: LinkStatus) -> tuple[float, float, float]:
    """The order of links: by what goes wrong now, then by what went wrong since the start."""

    def part(received: int | None, lost: int | None, late: int | None) -> float:
        bad = (lost or 0) + (late or 0)
        return bad / max(1, bad + (received or 0))

    now = part(link.recent_received, link.recent_lost, link.recent_late)
    return now, part(link.received, link.lost, link.late), link.latency or 0.0


def events_view(status: RunStatus, most: int) -> Text:
    """The latest events, the last one at the bottom."""
    text = Text()
    for event in status.events[-most:]:
        clock = time.strftime("%H:%M:%S", time.localtime(event["at"]))
        text.append(f"{clock} {event['from']}: {event['text']}\n", style=_SERIOUS.get(event["kind"], ""))
    return text
