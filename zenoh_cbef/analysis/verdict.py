"""What a run looks like at a moment, in one line of words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.slow import REMEDY
from zenoh_cbef.tracking.graph import components
from zenoh_cbef.tracking.status import STATUSES
from zenoh_cbef.words import counted, first_of

WINDOW = 40
"""Steps that overconfidence is judged by: one step's NEES scatters."""
OVERCONFIDENT = 2.0
"""By what factor errors exceed what the agents claim, before that is said."""
RECENT = 3
"""Steps without any message after which a link counts as cut."""
_APART = 3.0
"""By what factor the agents' estimates are farther apart than they claim to be wrong, before that is said."""


class Verdict(NamedTuple):
    """level: "good", "doubt", "bad" or "none"."""

    level: str
    words: str


@dataclass(frozen=True)
class Moment:
    """What a verdict is about; n agents, the last w steps.

    states, seconds: (n,), status and for how long, s. there: (n,). honest: (n,), whom the verdict is about, as others
    send wrong values. error, claimed: (w,), of these, m. apart: m.
    parts: in how many parts the network is. slow: the process that lately said that it does not keep up, or empty.
    names: n, what the reader calls the agents.
    """

    states: Floats
    seconds: Floats
    there: Bools
    honest: Bools
    error: Floats
    claimed: Floats
    apart: float
    parts: int
    slow: str
    names: Sequence[str]


def verdict(moment: Moment) -> Verdict:
    """The verdict of a moment."""
    if moment.slow:
        return Verdict("bad", f"{moment.slow} does not keep up: this host is too slow for dt; {REMEDY}")
    there, apart = moment.there, moment.apart
    if not there.any():
        return Verdict("bad", "no agent is there")
    judged = there & moment.honest
    if not judged.any():
        return Verdict("bad", f"no honest agent is there{_liars(moment)}")
    level, words = _standing(moment.states[judged], moment.seconds[judged])
    now, claimed = float(moment.error[-1]), float(moment.claimed[-1])
    if level == "good":
        level, words = _honest(moment.error, moment.claimed) or (level, words)
    if moment.parts > 1:
        level, words = "bad", f"the network is in {moment.parts} parts, {number(apart, 'm')} apart; {words}"
    elif np.isfinite(apart) and np.isfinite(claimed) and apart > _APART * claimed:
        level, words = "bad", f"the agents disagree by {number(apart, 'm')}; {words}"
    shown = f", error {number(now, 'm')}" if np.isfinite(now) else ""
    away = _away(there, moment.names)
    return Verdict("doubt" if away and level == "good" else level, f"{words}{shown}{_liars(moment)}{away}")


def _liars(moment: Moment) -> str:
    names = [moment.names[agent] for agent in np.flatnonzero(~moment.honest).tolist()]
    return f"; left out: agent {first_of(names, 5)}, as of wrong values" if names else ""


def parts(links: Ints, came: Bools, there: Bools) -> int:
    """In how many parts the agents that are there are. links: (e, 2). came: (e,), which of them carried messages."""
    if came.all():
        return 1
    return sum(bool(there[part].any()) for part in components(len(there), links[came]))


def _away(there: Bools, names: Sequence[str]) -> str:
    gone = [names[agent] for agent in np.flatnonzero(~there).tolist()]
    return f"; away: agent {first_of(gone, 5)}" if gone else ""


def _standing(states: Floats, seconds: Floats) -> tuple[str, str]:
    """What most agents say of their estimates."""
    known = states[np.isfinite(states)].astype(int)
    if not known.size:
        return "good", f"{counted(len(states), 'agent')} estimating"
    most = int(np.bincount(known, minlength=len(STATUSES)).argmax())
    lasted = np.nanmedian(np.where(states == most, seconds, np.nan))
    number_of = int((known == most).sum())
    who = f"{number_of} of {counted(len(states), 'agent')}"
    words = {
        "acquiring": f"acquiring the target: {who}",
        "tracking": f"tracking: {who}",
        "coasting": f"coasting for {lasted:.1f} s without enough ranges: {who}",
        "lost": f"lost for {lasted:.1f} s, the ranges do not fit: {who}",
    }
    return {"tracking": "good", "lost": "bad"}.get(STATUSES[most], "doubt"), words[STATUSES[most]]


def _honest(error: Floats, claimed: Floats) -> tuple[str, str] | None:
    """Whether errors are as large as the agents claim."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = float(np.sqrt(np.nanmean(error**2 / claimed**2))) if np.isfinite(error / claimed).any() else 0.0
    if ratio > OVERCONFIDENT:
        return "bad", f"overconfident: errors are {ratio:.1f} times as large as the agents claim"
    return None
