"""Which consensus settings a link of so many kbit/s carries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil

from zenoh_cbef.analysis.demand import link_bytes
from zenoh_cbef.analysis.mixing import configured_scheme
from zenoh_cbef.analysis.results import Number
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.tracking.compact import Precision

QUIET = 0.1
"""The trigger that costs next to no error (docs/bytes.md)."""


@dataclass(frozen=True)
class Recommended:
    """Settings for a link. kbits: what it carries, either way. link: what they send, kbit/s, at most.

    trigger: 0 where agents cannot keep silent. dt: s, that of the scenario, or the shortest that the link carries where
    it does not carry one round of the scenario's. ratio: of the expected position RMSE to the centralised filter's;
    None where it cannot be predicted, or dt is another one.
    """

    kbits: float
    precision: Precision
    trigger: float
    rounds: int
    dt: float
    link: float
    ratio: Number
    fits: bool


def recommended(plan: Plan, kbits: float, enough: int | None, ratio: Callable[[int], Number]) -> Recommended:
    """Find the settings of the least error that a link carries, and among those of enough rounds the shortest.

    enough: rounds that are sufficient, None where that is not known. ratio: what so many rounds reach.
    """
    stage, scenario = plan.scenario.consensus, plan.scenario
    whole = bool(plan.sharing.blocks) and not plan.sums
    plain = configured_scheme(plan) == "average" and not (stage.trim or stage.lag or plan.isolates)
    precision: Precision = "int12" if whole else "float32"
    short = Plan(scenario.changed(consensus={"precision": precision}))
    fixed, one = link_bytes(short, rounds=0), link_bytes(short, rounds=1)
    budget = 1e3 * kbits * scenario.dt / 8.0
    wanted = max(1, enough or plan.rounds)
    rounds = min(wanted, int((budget - fixed) // (one - fixed)))
    fits = rounds >= 1
    rounds = rounds if fits else wanted
    sent = link_bytes(short, rounds=rounds)
    dt = scenario.dt if fits else ceil(8.0 * sent / kbits) / 1e3
    trigger = QUIET if whole and plain and rounds > 1 else 0.0
    return Recommended(
        kbits=kbits,
        precision=precision,
        trigger=trigger,
        rounds=rounds,
        dt=dt,
        link=sent * 8e-3 / dt,
        ratio=ratio(rounds) if fits else None,
        fits=fits,
    )
