"""What the agents of a scenario, or those of them that are left, cannot see; and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.scenario import paths
from zenoh_cbef.scenario.build import absences_of, range_std_of
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.scenario.start import settling_steps, space_of
from zenoh_cbef.tracking.sight import MIRRORED, open_axes
from zenoh_cbef.words import counted

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

_SHAPES = {2: "a circle", 3: "a sphere"}
_FLAT = {0: "at one place", 1: "on one line", 2: "in one plane"}
_REMEDY = {
    3: "let four or more agents take part that are not in one plane, or give filter.planar_height where the target "
    "moves in a plane",
    2: "let three or more agents take part that are not on one line",
}


def window_of(scenario: Scenario, steps: int) -> int:
    """Of how many steps the ranges are looked at together, where there are so many; the estimate bridges fewer."""
    return max(1, min(settling_steps(scenario), steps))


def open_axes_between(scenario: Scenario, agents: Sequence[int], first: int, last: int) -> int:
    """How many axes (see tracking.sight) these agents leave open from one step to another, where the scenario has them.

    Of a long time as many moments are looked at as a window has steps.
    """
    first, last = max(first, 1), max(1, min(last, scenario.length))
    window = window_of(scenario, last - first + 1)
    places = paths.places_at(scenario, scenario.dt * np.linspace(first, last, window))[:, :, : space_of(scenario).axes]
    there = np.zeros(places.shape[:2], dtype=bool)
    there[list(agents)] = True
    return int(open_axes(places, there, window, range_std_of(scenario))[0])


def unobservable_steps(scenario: Scenario, positions: Floats, there: Bools) -> Bools:
    """The steps (K,) of all windows in which ranges do not determine the position, whatever came before.

    positions: (n, K, 3), m. there: (n, K), of whom there is a range.
    """
    window = window_of(scenario, there.shape[1])
    left_open = open_axes(positions[:, :, : space_of(scenario).axes], there, window, range_std_of(scenario))
    return np.asarray(np.convolve(left_open > MIRRORED, np.ones(window)) > 0.5)


def described(scenario: Scenario, agents: int, left_open: int) -> str:
    """In words what ranges of so many agents fit that leave axes open."""
    axes = space_of(scenario).axes
    spanned = axes - left_open
    who = "no agent" if agents == 0 else counted(agents, "agent")
    who += f" {_FLAT[spanned]}" if agents > spanned + 1 else ""
    if agents == 0:
        return f"{who} is left"
    if left_open > MIRRORED:
        return f"ranges of {who} fit every point of {_SHAPES[left_open]}"
    return f"ranges of {who} fit a mirror image of the target, too"


def warnings(scenario: Scenario) -> list[str]:
    """What the places of agents leave open, all of them and those whom planned absences leave: a sentence each."""
    axes, left_open = space_of(scenario).axes, open_axes_between(scenario, range(scenario.count), 1, scenario.length)
    if left_open > MIRRORED:
        return [f"the position cannot be determined: {described(scenario, scenario.count, left_open)}; {_REMEDY[axes]}"]
    found = []
    if left_open == MIRRORED:
        said = f"{described(scenario, scenario.count, left_open)}, and only the initial estimate tells the two apart"
        found.append(f"{said}; {_REMEDY[axes]}")
    for first, last, fewest, most_open in _dark_stretches(scenario):
        if last - first + 1 >= window_of(scenario, scenario.length):
            left = f"from step {first} to {last} faults leave only {counted(fewest, 'agent')}"
            found.append(f"{left}: {described(scenario, fewest, most_open)}; let more agents stay")
    return found


def _dark_stretches(scenario: Scenario) -> list[tuple[int, int, int, int]]:
    """Stretches in which the agents that faults leave do not determine the position.

    Each is its first and last step, the fewest agents that are left in it, and the most axes that they leave open.
    """
    dark: list[tuple[int, int, int, int]] = []
    absences = absences_of(scenario)
    for first, last in absences.stretches():
        left = np.flatnonzero(~absences.at(first)).tolist()
        left_open = open_axes_between(scenario, left, first, last)
        if left_open > MIRRORED:
            joins = dark and dark[-1][1] == first - 1
            since, _, fewest, most_open = dark.pop() if joins else (first, last, len(left), left_open)
            dark.append((since, last, min(fewest, len(left)), max(most_open, left_open)))
    return dark
