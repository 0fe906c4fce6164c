"""Whether the agents of a scenario, or those that its faults leave, determine the position; and what to do if not."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.datasets.findings import mirrored
from zenoh_cbef.scenario import near_plane, paths
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import target_path
from zenoh_cbef.tracking.sight import MIRRORED, open_axes
from zenoh_cbef.words import counted

_SHAPES = {2: "a circle", 3: "a sphere"}
_FLAT = {0: "at one place", 1: "on one line", 2: "in one plane"}
_REMEDY = {
    3: "let four or more agents take part that are not in one plane, or give filter.planar_height where the target "
    "moves in a plane",
    2: "let three or more agents take part that are not on one line",
}

_MOMENTS = 2000
_PLACES = 2_000_000
"""At so many places of agents the geometry is looked at: of many agents at fewer moments."""
_DILUTED = 15.0
_NEAR = 1e-12


def window_of(plan: Plan, steps: int) -> int:
    """Of how many steps the ranges are looked at together, where there are so many; the estimate bridges fewer."""
    return max(1, min(plan.settling_steps, steps))


def open_axes_between(plan: Plan, agents: Sequence[int], first: int, last: int) -> int:
    """How many axes (see tracking.sight) these agents leave open from one step to another, where the scenario has them.

    Of a long time as many moments are looked at as a window has steps.
    """
    first, last = max(first, 1), max(1, min(last, plan.scenario.length))
    window = window_of(plan, last - first + 1)
    times = plan.scenario.dt * np.linspace(first, last, window)
    places = paths.places_at(plan.scenario, times)[:, :, : plan.space.axes]
    there = np.zeros(places.shape[:2], dtype=bool)
    there[list(agents)] = True
    return int(open_axes(places, there, window, plan.range_std)[0])


def unobservable_steps(plan: Plan, positions: Floats, there: Bools) -> Bools:
    """The steps, (r, K), of all windows in which ranges do not determine the position, whatever came before.

    positions: (r, n, K, 3), m, of r runs. there: (r, n, K), which agents have a range.
    """
    steps = there.shape[2]
    window = window_of(plan, steps)
    dark = open_axes(positions[..., : plan.space.axes], there, window, plan.range_std) > MIRRORED
    unseen = np.zeros((len(there), steps), dtype=bool)
    for later in range(window):
        unseen[:, later : later + dark.shape[1]] |= dark
    return unseen


def described(plan: Plan, agents: int, left_open: int) -> str:
    """In words what ranges of so many agents fit that leave axes open."""
    axes = plan.space.axes
    spanned = axes - left_open
    who = "no agent" if agents == 0 else counted(agents, "agent")
    who += f" {_FLAT[spanned]}" if agents > spanned + 1 else ""
    if agents == 0:
        return f"{who} is left"
    if left_open > MIRRORED:
        return f"ranges of {who} fit every point of {_SHAPES[left_open]}"
    return f"ranges of {who} fit a mirror image of the target, too"


def warnings(plan: Plan) -> list[str]:
    """Warnings, a sentence each, where all agents, or those that absences leave, do not determine the position."""
    count, axes, length = plan.scenario.count, plan.space.axes, plan.scenario.length
    left_open = open_axes_between(plan, range(count), 1, length)
    if left_open > MIRRORED:
        return [f"the position cannot be determined: {described(plan, count, left_open)}; {_REMEDY[axes]}"]
    if _each_alone(plan):
        kind, left_open = plan.scenario.filter.kind, open_axes_between(plan, [0], 1, length)
        why = f"agents of {kind} exchange nothing" if plan.scenario.consensus.rounds else "consensus.rounds is 0"
        if left_open > MIRRORED:
            alone = f"agents cannot determine the position: {why}, and {described(plan, 1, left_open)}"
            return [f'{alone}; let them exchange what they know, as with filter.kind = "sicf" and ten rounds']
    found = []
    if left_open == MIRRORED:
        said = f"{described(plan, count, left_open)}, and only the initial estimate tells the two apart"
        found.append(f"{said}; {_REMEDY[axes]}")
    for first, last, fewest, most_open in _dark_stretches(plan):
        if last - first + 1 >= window_of(plan, length):
            left = f"from step {first} to {last} faults leave only {counted(fewest, 'agent')}"
            found.append(f"{left}: {described(plan, fewest, most_open)}; let more agents stay")
    return found or _weak_geometry(plan)


def _each_alone(plan: Plan) -> bool:
    """Whether each agent has nothing but its own ranges."""
    return not (plan.rounds or plan.sharing.uses_neighbour_ranges)


def determined(plan: Plan) -> bool:
    """Whether ranges alone tell where the target is, so that a covariance can be right: no mirror image fits them."""
    agents, length = range(1 if _each_alone(plan) else plan.scenario.count), plan.scenario.length
    return not open_axes_between(plan, agents, 1, length) and not _weak_geometry(plan)


def _weak_geometry(plan: Plan) -> list[str]:
    """Agents that are so nearly on one line or in one plane that ranges say little about one direction."""
    if plan.scenario.target.motion == "dataset":
        told = plan.space.height is not None or near_plane.guess_tells_side(plan.scenario, plan.space.axes)
        return [] if told else mirrored(paths.placement(plan.scenario), near_plane.NEAR * plan.range_std)
    moments = max(1, min(plan.scenario.length, _MOMENTS, _PLACES // plan.scenario.count))
    path = target_path(plan.scenario.changed(steps=moments))[1:, :3]
    away = path - paths.agent_positions(plan.scenario.changed(steps=moments))
    rows = away / np.maximum(np.linalg.norm(away, axis=2, keepdims=True), _NEAR)
    rows = rows[:, :, : plan.space.axes]
    least = np.linalg.eigvalsh(np.einsum("nki,nkj->kij", rows, rows))[:, 0]
    dilution = float(np.median(1.0 / np.sqrt(np.maximum(least, _NEAR))))
    if dilution <= _DILUTED:
        return []
    near = _FLAT[plan.space.axes - 1]
    warning = (
        f"the geometry is weak: in one direction a step's ranges determine the position to {dilution:.3g} times their "
        f"noise only, as the agents are nearly {near} with the target or far from it; place them around its path"
    )
    return [warning]


def _dark_stretches(plan: Plan) -> list[tuple[int, int, int, int]]:
    """Stretches in which the agents that faults leave do not determine the position.

    Each is its first and last step, the fewest agents that are left in it, and the most axes that they leave open.
    """
    dark: list[tuple[int, int, int, int]] = []
    absences = plan.absences
    for first, last in absences.stretches():
        left = np.flatnonzero(~absences.at(first)).tolist()
        left_open = open_axes_between(plan, left, first, last)
        if left_open > MIRRORED:
            joins = dark and dark[-1][1] == first - 1
            since, _, fewest, most_open = dark.pop() if joins else (first, last, len(left), left_open)
            dark.append((since, last, min(fewest, len(left)), max(most_open, left_open)))
    return dark
