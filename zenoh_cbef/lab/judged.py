"""The verdict on a step of a scene."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.faulted import honest_agents
from zenoh_cbef.analysis.verdict import RECENT, WINDOW, Moment, Verdict, parts, verdict
from zenoh_cbef.lab.scene import Scene
from zenoh_cbef.protocol.slow import AGAIN_SECONDS, SLOW
from zenoh_cbef.protocol.tokens import in_words
from zenoh_cbef.tracking.diagnostics import NAMES


def judged(scene: Scene, step: int) -> Verdict:
    """The verdict of a step, of the last steps where one does not tell."""
    if step < 1:
        return Verdict("none", "no estimate yet")
    estimates = scene.recording.estimates
    said, there = estimates.numbers("said", step)[:, step - 1], estimates.seen(step)[:, step - 1]
    curves = scene.curves(max(step - WINDOW, 0), step)
    came = np.nansum(scene.fresh(max(step - RECENT, 0), step)[:, :, 0], axis=1) > 0.0
    states, seconds = (said[:, NAMES.index(name)] for name in ("status", "status_seconds"))
    split = parts(scene.links, came, there)
    moment = Moment(
        states=states,
        seconds=seconds,
        there=there,
        honest=honest_agents(scene.plan.scenario),
        error=curves["error"],
        claimed=curves["claimed"],
        apart=float(curves["disagreement"][-1]),
        parts=split,
        slow=_slow(scene, step),
        names=scene.plan.scenario.agents.names,
    )
    return verdict(moment)


def _slow(scene: Scene, step: int) -> str:
    """The process that said last, as of a step and lately, that it does not keep up with real time."""
    told = [one for one in scene.recording.events if one.message["kind"] == SLOW]
    if not told:
        return ""
    # At the newest step also what was said since: a run that is too slow may conclude no other.
    past = step < scene.newest
    now = scene.recording.estimates.stamps(step).sent[:, step - 1].max() if past else scene.recording.events[-1].sent
    told = [one for one in told if 0 <= now - one.sent < 1e9 * AGAIN_SECONDS]
    return in_words(told[-1].message["from"]) if told else ""
