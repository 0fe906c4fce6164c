"""A step of a run in lockstep that stands between two rounds, as the page draws it.

Agents tell of a step when it is over. What becomes of its messages follows from the scenario and the injected faults.
"""

from __future__ import annotations

import numpy as np

from zenoh_cbef.faults.injected import ABSENT, Injected
from zenoh_cbef.lab.scene import Arrays, Scene
from zenoh_cbef.scenario.build import fates_of

_LOST, _LATE = "x!", ">"


def under_way(scene: Scene, step: int, round_: int) -> tuple[Arrays, list[str]]:
    """The numbers of a step up to a round, with estimates of the step before, and its messages' marks, as of Scene."""
    plan, (source, destination) = scene.plan, scene.links.T
    fates = fates_of(plan, np.full(len(source), plan.scenario.seed, dtype=np.uint64), source, destination)
    injected = Injected(len(source))
    for number in range(0 if plan.sharing.uses_neighbour_ranges else 1, round_ + 1):
        injected.note(fates.of(step, number))
    marks = injected.take().marks
    begun = scene.frame(step)
    passed = np.array([_passed(each) for each in marks]).reshape(-1, 4)
    return scene.frame(step - 1) | {"truth": begun["truth"], "place": begun["place"], "links": passed}, marks


def _passed(marks: str) -> tuple[float, ...]:
    """How many messages of a link came, were lost and late, and their latency, which agents have not told, s."""
    lost, late, absent = (sum(mark in which for mark in marks) for which in (_LOST, _LATE, ABSENT))
    return len(marks) - lost - late - absent, lost, late, np.nan
