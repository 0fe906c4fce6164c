"""Whether a run that goes on can be reached from here, and fits: versions and clocks."""

from __future__ import annotations

from collections.abc import Iterator

from zenoh_cbef import __version__
from zenoh_cbef.outside.doctor import OK, PROBLEM, WARNING, Finding, check_size
from zenoh_cbef.outside.operator import Operator
from zenoh_cbef.outside.status import RunStatus
from zenoh_cbef.protocol.reach import runs_on, wait_for_link, why_no_answer
from zenoh_cbef.protocol.scenario_service import measure_clock
from zenoh_cbef.protocol.session import Connection
from zenoh_cbef.words import counted

_TRIES = 10
_NOTICEABLE = 1e-3
"""Clocks that differ by more, s, make figures of latency look wrong."""
_SHARE = 0.1
"""Share of a step by which a clock may be wrong in realtime, as rounds have deadlines."""


def check_run(run: str | None, connection: Connection, *, sized: bool = False) -> Iterator[Finding]:
    """Findings about a run; where no run is named, about the runs that answer.

    sized: also whether this host has room for all its agents.
    """
    with Operator(run or "*", connection) as operator:
        if not wait_for_link(operator.session, operator.patience):
            yield Finding("link", PROBLEM, why_no_answer(operator.session, connection, str(run)))
            return
        if run is None:
            runs = ", ".join(sorted(runs_on(operator.session)))
            yield Finding("link", OK, f"Zenoh answers; runs there: {runs or 'none'}")
            return
        status = operator.status_if_on()
        if status is None:
            yield Finding("run", PROBLEM, why_no_answer(operator.session, connection, run))
            return
        yield Finding("run", OK, f"{run} is {status.state}, {counted(len(status.agents), 'agent')}, {status.mode}")
        if sized:
            yield from check_size(len(status.agents))
        yield _versions(status)
        yield _own_clock(operator, status)
        yield from _their_clocks(status)


def _versions(status: RunStatus) -> Finding:
    ours = {f"agent {one.agent}": one.where for one in status.agents} | {"the target": status.target}
    others = {name: where.version for name, where in ours.items() if where.version not in {None, __version__}}
    if others:
        words = ", ".join(f"{name} has {found}" for name, found in others.items())
        return Finding("versions", PROBLEM, f"this is {__version__}, {words}; install the same on every host")
    zenohs = {where.zenoh for where in ours.values() if where.zenoh}
    if len(zenohs) > 1:
        words = f"eclipse-zenoh differs: {', '.join(sorted(zenohs))}"
        return Finding("versions", WARNING, f"{words}; install the same on every host")
    return Finding("versions", OK, f"all that are known are {__version__}")


def _own_clock(operator: Operator, status: RunStatus) -> Finding:
    clock = measure_clock(operator.session, operator.run, _TRIES)
    if clock is None:
        return Finding("clock", WARNING, "the target tells no time; compare clocks by hand, with NTP or PTP")
    words = f"{_offset(clock.ahead)} the target's, to within {clock.round_trip * 5e2:.3f} ms"
    return _judged("clock", f"this host's is {words}", abs(clock.ahead) - clock.round_trip / 2, status)


def _their_clocks(status: RunStatus) -> Iterator[Finding]:
    found = [(one.where.clock, one.where.round_trip or 0.0, one.agent) for one in status.agents if one.where.clock]
    if found:
        ahead, round_trip, agent = max(found, key=lambda one: abs(one[0]) - one[1] / 2)
        yield _judged(
            "clocks", f"agent {agent}'s is {_offset(ahead)} the target's", abs(ahead) - round_trip / 2, status
        )


def _offset(seconds: float) -> str:
    return f"{abs(seconds) * 1e3:.3f} ms {'ahead of' if seconds >= 0.0 else 'behind'}"


def _judged(subject: str, words: str, surely: float, status: RunStatus) -> Finding:
    """surely: what the clocks differ by at least, s."""
    remedy = "synchronise the hosts with NTP or PTP"
    if status.mode == "realtime" and surely > _SHARE * status.dt:
        return Finding(subject, PROBLEM, f"{words}: rounds of {status.dt:g} s steps miss their deadlines; {remedy}")
    if surely > _NOTICEABLE:
        return Finding(subject, WARNING, f"{words}: latency figures of its links are off by as much; {remedy}")
    return Finding(subject, OK, f"{words}; latency figures are off by as much")
