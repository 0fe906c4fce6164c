"""What a step looks like, in one line of words."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.lab.scene import Scene
from zenoh_cbef.log.read.recording import Event
from zenoh_cbef.numbers import number
from zenoh_cbef.protocol.slow import AGAIN_SECONDS, REMEDY, SLOW
from zenoh_cbef.tracking.diagnostics import NAMES
from zenoh_cbef.tracking.graph import components
from zenoh_cbef.tracking.status import STATUSES
from zenoh_cbef.words import counted

_WINDOW = 40
"""Steps that overconfidence is judged by: one step's NEES scatters."""
_OVERCONFIDENT = 2.0
"""By what factor errors exceed what the agents claim, before that is said."""
_RECENT = 3
"""Steps without any message after which a link counts as cut."""
_APART = 3.0
"""By what factor the agents' estimates are farther apart than they claim to be wrong, before that is said."""


class Verdict(NamedTuple):
    """level: "good", "doubt", "bad" or "none"."""

    level: str
    words: str


def verdict(scene: Scene, step: int) -> Verdict:
    """The verdict of a step, of the last steps where one does not tell."""
    if step < 1:
        return Verdict("none", "no estimate yet")
    slow = _slow(scene.recording.events)
    if slow:
        return Verdict("bad", f"{slow} does not keep up: this host is too slow for dt; {REMEDY}")
    said = scene.recording.estimates.numbers("said", step)[:, step - 1]
    states = said[:, NAMES.index("status")]
    there = scene.recording.estimates.seen(step)[:, step - 1]
    away = _away(there)
    if not there.any():
        return Verdict("bad", "no agent is there")
    level, words = _standing(states[there], said[there, NAMES.index("status_seconds")])
    errors = scene.curves(max(step - _WINDOW, 0), step)
    now, claimed, apart = (float(errors[name][-1]) for name in ("error", "claimed", "disagreement"))
    if level == "good":
        level, words = _honest(errors["error"], errors["claimed"]) or (level, words)
    if (parts := _parts(scene, step, there)) > 1:
        level, words = "bad", f"the network is in {parts} parts, {number(apart, 'm')} apart; {words}"
    elif np.isfinite(apart) and np.isfinite(claimed) and apart > _APART * claimed:
        level, words = "bad", f"the agents disagree by {number(apart, 'm')}; {words}"
    shown = f", error {number(now, 'm')}" if np.isfinite(now) else ""
    return Verdict("doubt" if away and level == "good" else level, f"{words}{shown}{away}")


def _parts(scene: Scene, step: int, there: Bools) -> int:
    """In how many parts the agents that are there are: no message came through between them in the last steps."""
    came = np.nansum(scene.fresh(max(step - _RECENT, 0), step)[:, :, 0], axis=1) > 0.0
    if came.all():
        return 1
    return sum(bool(there[part].any()) for part in components(len(there), scene.links[came]))


def _away(there: Bools) -> str:
    gone = np.flatnonzero(~there).tolist()
    return f"; away: agent {', '.join(map(str, gone[:5]))}{' ...' * (len(gone) > 5)}" if gone else ""


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
    if ratio > _OVERCONFIDENT:
        return "bad", f"overconfident: errors are {ratio:.1f} times as large as the agents claim"
    return None


def _slow(events: list[Event]) -> str:
    """The process that said last, and lately, that it does not keep up with real time."""
    if not events:
        return ""
    now = events[-1].sent
    told = [one for one in events if one.message["kind"] == SLOW and now - one.sent < 1e9 * AGAIN_SECONDS]
    return told[-1].message["from"].replace("/", " ") if told else ""
