"""Warns of numbers of a scenario that do not fit each other: steps and motion, noise and receivers, units."""

from __future__ import annotations

from functools import partial
from math import ceil, log2
from pathlib import Path

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.datasets import Dataset, read_dataset
from zenoh_cbef.datasets.first_scenario import time_step
from zenoh_cbef.numbers import number
from zenoh_cbef.scenario import bending, start
from zenoh_cbef.scenario.paths import places_at
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.start import half_box, half_diagonal
from zenoh_cbef.scenario.world import target_path

_SEEN = 1.0
"""How many standard deviations of their noise ranges may be off that come from outside of the plane: by that they are
in all steps, which no average makes less.
"""

_OFF = 1.5
_SELDOM = 10.0
_LONG = 2.0
"""How many of the steps that an import chooses one may be long."""
_ENOUGH = 20
_MOST_STEPS = 10_000
_MOST_PLACES = 1_000_000


def warnings(plan: Plan) -> list[str]:
    """Warnings, a sentence each with its remedy."""
    recorded = (
        _recorded(plan) if plan.scenario.target.motion == "dataset" else _emulated_noise(plan) + _out_of_plane(plan)
    )
    return _long_steps(plan) + _long_for_turns(plan) + _wide_guess(plan) + _coarse(plan) + recorded


def _long_steps(plan: Plan) -> list[str]:
    scenario, dt = plan.scenario, plan.scenario.dt
    bent = partial(bending.bending, scenario, plan.plain_motion, plan.range_std)
    uncertain, times = bent(dt)
    if times <= bending.MOST:
        return []
    shorter = dt
    while bent(shorter)[1] > bending.MOST and shorter > 1e-6 * dt:
        shorter /= 2.0
    taken = "" if plan.squares else ", which filters take for straight"
    warning = (
        f"steps of dt = {number(dt)} s are long for this motion: from one to the next the position gets uncertain by "
        f"{number(uncertain)} m per axis, and ranges over {number(half_box(scenario))} m bend there by {number(times)} "
        f"times their noise{taken}; set dt to {number(shorter)} or less (are these milliseconds?)"
    )
    return [warning]


def _long_for_turns(plan: Plan) -> list[str]:
    """Of several motions, each agent linearises its range where the target may be after a turn."""
    scenario = plan.scenario
    if plan.tells_ranges or not plan.models or not start.leaps(scenario, plan.range_std):
        return []
    reach = start.reach(scenario)
    times = start.sag(scenario, reach) / plan.range_std
    shorter = scenario.dt / 2.0 ** ceil(0.5 * log2(times))
    warning = (
        f"steps of dt = {number(scenario.dt)} s are long for a target that turns: it gets {number(reach)} m in one, "
        f"and ranges over {number(half_box(scenario))} m bend there by {number(times)} times their noise, which "
        f"filters of several motions take for straight; set dt to {number(shorter)} or less"
    )
    return [warning]


def _wide_guess(plan: Plan) -> list[str]:
    """Of a filter that takes its guess as it is, where ranges are not straight over that."""
    scenario, chosen = plan.scenario, plan.scenario.filter
    able = plan.abilities.covariance and chosen.measurement == "range"
    if not able or plan.first_fix_steps or plan.tells_ranges or plan.squares or not start.bends_over_guess(scenario):
        return []
    std = float(start.initial_std(scenario)[0])
    times = start.sag(scenario, std) / scenario.sensor.range_std
    other = "" if plan.abilities.biases else ", or use filter.kind = 'sicf'"
    kept = ", or leave filter.start out" if chosen.start == "given" else ""
    warning = (
        f"agents make no first fix here, and the filter takes ranges for straight that bend by {number(times)} times "
        f"their noise over filter.initial_position_std = {number(std)} m: it may lose its target, and be sure of a "
        f"wrong place; give a better guess{kept}{other}"
    )
    return [warning]


def _coarse(plan: Plan) -> list[str]:
    half = half_diagonal(plan.scenario)
    if plan.range_std <= half or half == 0.0:
        return []
    warning = (
        f"the range noise of {number(plan.range_std)} m is larger than half of the box around the agents, "
        f"{number(half)} m; give lengths in metres, or place the agents farther apart"
    )
    return [warning]


def _emulated_noise(plan: Plan) -> list[str]:
    given, true = plan.scenario.filter.range_std, plan.scenario.sensor.range_std
    if not isinstance(given, float) or 1.0 / _OFF <= given / true <= _OFF:
        return []
    warning = (
        f"filter.range_std = {number(given)} m, but the receivers have sensor.range_std = {number(true)} m, so NEES "
        "will be off; leave filter.range_std out, or set it to 'auto'"
    )
    return [warning]


def _out_of_plane(plan: Plan) -> list[str]:
    height, scenario = plan.space.height, plan.scenario
    if height is None or half_diagonal(scenario) == 0.0:
        return []
    seen = scenario.changed(steps=min(scenario.length, _MOST_STEPS))
    path = target_path(seen)[1:, :3]
    moments = np.linspace(0.0, len(path) - 1.0, min(len(path), max(1, _MOST_PLACES // scenario.count))).astype(np.intp)
    agents, path = places_at(scenario, scenario.dt * (1.0 + moments.astype(np.float64))), path[moments]
    flat = np.concatenate([path[:, :2], np.full((len(path), 1), height)], axis=1)
    true, believed = (np.linalg.norm(place - agents, axis=2) for place in (path, flat))
    if float(np.abs(true - believed).max()) <= _SEEN * plan.range_std:
        return []
    off = float(np.abs(path[:, 2] - height).max())
    warning = (
        f"filter.planar_height = {number(height)} m, but the target gets {number(off)} m away from that plane; leave "
        "filter.planar_height out, or let the target move in the plane (target.motion = 'ncv' accelerates in all axes)"
    )
    return [warning]


def _recorded(plan: Plan) -> list[str]:
    """What the recorded ranges themselves say, as far as the folder is on this host."""
    folder = Path(plan.scenario.target.path or "")
    if not folder.is_dir():
        return []
    dataset = read_dataset(folder)
    interval = dataset.interval
    if interval is not None and interval > _SELDOM:
        said = f"an anchor's ranges come {number(interval)} s apart; give times in seconds (are these milliseconds?)"
        return [said]
    return _long_for_recording(plan, dataset) + _misjudged_noise(plan, _residuals(dataset))


def _long_for_recording(plan: Plan, dataset: Dataset) -> list[str]:
    """Until its step ends each range counts as one of a target that goes straight on."""
    dt, shorter = plan.scenario.dt, time_step(dataset)
    if dt <= _LONG * shorter:
        return []
    warning = (
        f"steps of dt = {number(dt)} s are long for this recording: its target turns between a range and the end of "
        f"the step; set dt to {number(shorter)}, or to {number(_LONG * shorter)} at most"
    )
    return [warning]


def _residuals(dataset: Dataset) -> Floats:
    """Ranges less the true distances and each anchor's median, where the truth is known, (m,)."""
    truth = dataset.truth_at(dataset.range_time)[:, :3]
    residuals = dataset.ranges - np.linalg.norm(truth - dataset.anchors[dataset.range_anchor], axis=1)
    known = np.isfinite(residuals)
    each = [residuals[known & (dataset.range_anchor == anchor)] for anchor in range(len(dataset.anchors))]
    return np.concatenate([row - np.median(row) for row in each if len(row)] or [np.zeros(0)])


def _misjudged_noise(plan: Plan, residuals: Floats) -> list[str]:
    if len(residuals) < _ENOUGH or plan.scenario.filter.range_std == "auto":
        return []
    found = 1.4826 * float(np.median(np.abs(residuals)))
    if found == 0.0 or 1.0 / (2.0 * _OFF) <= plan.range_std / found <= 2.0 * _OFF:
        return []
    warning = (
        f"the filter takes the range noise for {number(plan.range_std)} m, but the recorded ranges scatter by "
        f"{number(found)} m about the true distances; set filter.range_std to about that, or to 'auto'"
    )
    return [warning]
