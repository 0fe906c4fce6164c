"""What the strong yardstick is told of runs: what agents know at the start, the noise, and which ranges are wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.prior import known_together
from zenoh_cbef.analysis.strong.yardstick import Known, Seen
from zenoh_cbef.arrays import Bools
from zenoh_cbef.faults import SensorFault
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.trace import Trace

_HEAVY = 4.0
_WRONG = 0.1
"""A range that differs by more than this share of its noise from what an honest receiver measures is an outlier."""


def told(traces: Sequence[Trace], steps: int) -> tuple[Known, Seen]:
    """What is known of runs of one shape, and what they measured in the first steps."""
    plan = traces[0].plan
    scenario, settings = plan.scenario, plan.settings
    count = scenario.count
    emulated = plan.scenario.target.motion != "dataset"
    wrong = [wrong_ranges(trace) if emulated else None for trace in traces]
    ranges = np.stack(
        [
            trace.ranges if odd is None else np.where(odd, np.nan, trace.ranges)
            for trace, odd in zip(traces, wrong, strict=True)
        ]
    )
    own, common = max(settings.own_bias_std, scenario.sensor.bias_std), settings.common_bias_std
    accelerations = {plan.plain_motion.acceleration_std}
    if scenario.target.motion == "ncv":
        accelerations.add(scenario.target.acceleration_std)
    known = Known(
        dt=scenario.dt,
        range_std=scenario.sensor.range_std if emulated else plan.range_std,
        accelerations=tuple(accelerations),
        heavy=_HEAVY if any(one is None for one in wrong) else np.inf,
        settle=plan.settling_steps,
        height=scenario.filter.planar_height,
        mean=np.stack([trace.initial for trace in traces]).mean(axis=1)[:, plan.space.kept],
        covariance=known_together(plan),
        bias=None if plan.bias == "none" else own**2 * np.eye(count) + common**2,
        turn_rate_std=None if scenario.target.motion == "ncv" else scenario.filter.turn_rate_std,
    )
    positions, age = (np.stack([getattr(trace, part) for trace in traces]) for part in ("positions", "age"))
    return known, Seen(positions[:, :, :steps], ranges[:, :, :steps], age[:, :, :steps])


def wrong_ranges(trace: Trace) -> Bools | None:
    """Which ranges (n, K) honest receivers of the emulated world would not have measured; None where it is not that."""
    scenario = trace.scenario
    faults = tuple(fault for fault in scenario.fault if not isinstance(fault, SensorFault))
    steps = trace.ranges.shape[1]  # a run may have ended early
    world = make_world(scenario.changed(sensor={"outlier_probability": 0.0}, fault=faults, steps=steps))
    honest = scenario.sensor.signal_speed * (world.arrived - world.emitted)
    differs = np.abs(trace.ranges - honest) > _WRONG * scenario.sensor.range_std
    heard = np.isfinite(trace.ranges)
    return None if heard.any() and np.mean(differs[heard]) > 0.8 else differs
