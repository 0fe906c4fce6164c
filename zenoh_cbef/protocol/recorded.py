"""Which keys of a run a recorder takes."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from typing import NamedTuple

import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.keys import Keys, address

_BEACONS = re.compile(r"beacon/[^/]+")
_OF_AN_AGENT = re.compile(r"\*/(\d+)/\*\*")


def recorded_keys(run: str, wanted: Sequence[str]) -> list[str]:
    """The key expressions to subscribe to, from whole ones or ones relative to the run; all keys where none is given.

    Events and signals are always among them, each under one expression. Raises UserError where one is malformed, of
    another run, or overlaps another: its messages would be recorded twice.
    """
    keys = Keys(run)
    if not wanted:
        return [keys.everything]
    found: list[zenoh.KeyExpr] = []
    for text in wanted:
        whole = text if text.startswith("cbef/") else f"{keys.root}/{text}"
        try:
            expression = zenoh.KeyExpr.autocanonize(whole)
        except (zenoh.ZError, ValueError):
            raise UserError(f"{text!r} is no key expression; name keys as in 'agent/0/**' or 'beacon/*'") from None
        if not zenoh.KeyExpr(keys.everything).includes(expression):
            raise UserError(f"{text!r} is not of run {run!r}; name keys below cbef/{run}, as in 'agent/0/**'")
        twice = next((known for known in found if known.intersects(expression)), None)
        if twice is not None:
            raise UserError(
                f"{text!r} overlaps {str(twice)!r}, so messages would be recorded twice; name each key once"
            )
        found.append(expression)
    for always in map(zenoh.KeyExpr, (keys.all_events, keys.all_signals)):
        if not any(known.includes(always) for known in found):
            found = [*(known for known in found if not always.includes(known)), always]
    return [str(known) for known in found]


class Apart(NamedTuple):
    """Key expressions of what agents publish of their own, of truth and beacons, and of all else."""

    agents: list[str]
    target: list[str]
    others: list[str]


def apart(run: str, expressions: Sequence[str]) -> Apart:
    """Recorded key expressions in three parts.

    The expression for all keys of a run is cut into those of each part. Any other expression that covers several parts
    counts as one of the others.
    """
    keys = Keys(run)
    root, found = keys.root, Apart([], [], [])
    for one in expressions:
        below = one.removeprefix(f"{root}/")
        if below == "**":
            found.agents.append(f"{root}/agent/**")
            found.target.extend((f"{root}/target/**", keys.all_beacons))
            found.others.extend((keys.all_signals, f"{root}/event/**", f"{root}/faults"))
        elif share := _OF_AN_AGENT.fullmatch(below):
            found.agents.append(f"{root}/agent/{share[1]}/**")
            found.target.append(f"{root}/beacon/{share[1]}")
        elif below.startswith("agent/"):
            found.agents.append(one)
        else:
            (found.target if below.startswith("target/") or _BEACONS.fullmatch(below) else found.others).append(one)
    return found


def belongs(key: str, expression: str, expressions: Collection[str]) -> bool:
    """Whether a message is recorded under this expression: of all that match its key, exactly one takes it."""
    at = address(key)
    if at is None or at.kind not in {"event", "signal"}:
        return True
    keys = Keys(at.run)
    home = keys.all_events if at.kind == "event" else keys.all_signals
    return expression == home or home not in expressions


def covering(expressions: Sequence[str]) -> Callable[[str], bool]:
    """A test of keys: whether any of the expressions includes it."""
    parsed = [zenoh.KeyExpr(expression) for expression in expressions]

    def covers(key: str) -> bool:
        try:
            return any(expression.includes(zenoh.KeyExpr(key)) for expression in parsed)
        except zenoh.ZError:
            return False

    return covers
