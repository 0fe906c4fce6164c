"""Predictions for a scenario before any run: observability, errors at each number of rounds, bytes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.analysis.demand import demand
from zenoh_cbef.analysis.designed import Bytes, Compared, Configured, Design, Expected, Tried, TriedRounds
from zenoh_cbef.analysis.mixing import SCHEMES, Scheme, configured_scheme, contraction, mixing, with_scheme
from zenoh_cbef.analysis.observability import observability
from zenoh_cbef.analysis.prediction import Clipping, Sight, propagate
from zenoh_cbef.analysis.recommended import Recommended, recommended
from zenoh_cbef.analysis.traffic import other_bytes, round_bytes
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.numbers import SKIPPED
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.sight import determined
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.tracking.filters import level_of
from zenoh_cbef.tracking.ranging import own_range

LADDER = (1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 25, 32, 40, 50, 64)
"""Numbers of rounds that are tried; gaps are filled where the smallest sufficient number lies."""

_AT_FIRST = 8
_MOST_STATES = 240
_PREDICTED = ("sicf", "icf", "hcmci", "ci", "local")


def design(
    plan: Plan, *, within: float = 0.01, skip: float = SKIPPED, search: bool = True, kbits: float | None = None
) -> Design:
    """Everything that `zenoh-cbef design` tells.

    within: wanted excess of the position RMSE over the centralised filter's. skip: share of steps left out at the
    start. search: also predict other numbers of rounds and schemes than the configured ones. kbits: recommend settings
    for links that carry so many kbit/s.
    """
    scenario, rounds, scheme = plan.scenario, plan.rounds, configured_scheme(plan)
    first = min(int(skip * scenario.length), scenario.length - 1)
    sight = sight_of(plan)
    cost = Bytes({each: round_bytes(with_scheme(plan, each)) for each in SCHEMES}, other_bytes(plan))
    predictor = _Predictor(plan, sight, first, (scheme, rounds)) if _predictable(plan) else None
    smallest: dict[Scheme, int | None] = dict.fromkeys(SCHEMES)
    expected: Compared | None = None
    if predictor is not None:
        if search and rounds:
            smallest = _search(predictor, within)
        expected = predictor.compared(scheme, rounds)
    told = None if kbits is None or not rounds else _recommended(plan, kbits, smallest[scheme], predictor)
    return Design(
        name=scenario.name,
        filter=scenario.filter.kind,
        precision=scenario.consensus.precision,
        agents=scenario.count,
        steps=scenario.length,
        skip=first,
        edges=len(plan.edges),
        within=within,
        observability=observability(plan.initial_covariance, plan.calm_motion, sight, first),
        spectral_gap={each: 1.0 - contraction(plan, each) for each in SCHEMES},
        bytes=cost,
        cannot=cannot(plan),
        configured=Configured(scheme, rounds, cost.per_step(scheme, rounds), expected),
        centralized=None if predictor is None else predictor.centralized,
        rounds=[] if predictor is None else _tried(predictor, cost),
        smallest=smallest,
        demand=demand(plan, other=cost.other),
        recommended=told,
    )


def _recommended(plan: Plan, kbits: float, enough: int | None, predictor: _Predictor | None) -> Recommended:
    def ratio(rounds: int) -> float | None:
        if predictor is None:
            return None
        scheme = configured_scheme(plan)
        predictor.predict([(scheme, rounds)])
        return predictor.compared(scheme, rounds).ratio_to_centralized

    return recommended(plan, kbits, enough, ratio)


def _tried(predictor: _Predictor, cost: Bytes) -> list[TriedRounds]:
    return [
        TriedRounds(
            rounds,
            {
                each: Tried(**vars(predictor.compared(each, rounds)), bytes_per_step=cost.per_step(each, rounds))
                for each in SCHEMES
                if (each, rounds) in predictor.found
            },
        )
        for rounds in sorted({rounds for _, rounds in predictor.found})
    ]


def sight_of(plan: Plan) -> Sight:
    """What the agents will measure along the path that the scenario describes, linearised at the truth."""
    world, space = make_world(plan.scenario), plan.space
    steps, agents = plan.scenario.length, plan.scenario.count
    heard = np.isfinite(world.arrived).T
    age = np.where(heard, (world.time - world.emitted).T, 0.0)
    state = np.repeat(_path(world.truth)[:, space.kept], agents, axis=0)
    positions = np.swapaxes(world.positions, 0, 1).reshape(-1, 3)
    _, rows = own_range(space, state, positions, age.ravel())
    return Sight(np.where(heard[:, :, None], rows.reshape(steps, agents, -1), 0.0), plan.range_std)


def _path(truth: Floats) -> Floats:
    """The truth (K, 6) with the steps filled in of which it is not known: good enough for directions."""
    known, steps = np.isfinite(truth).all(axis=1), np.arange(len(truth))
    if known.all():
        return truth
    if not known.any():
        raise UserError(
            "design needs to know where the target goes, and the dataset has no truth.csv; run it instead: "
            "zenoh-cbef sim tells NIS and what the covariances claim"
        )
    return np.stack([np.interp(steps, steps[known], each) for each in truth[known].T], axis=1)


def cannot(plan: Plan) -> list[str]:
    """What the prediction does not take into account, one sentence each."""
    scenario, recorded = plan.scenario, plan.scenario.target.motion == "dataset"
    chosen, sensor = scenario.filter, scenario.sensor
    said = {
        f"The error of {chosen.kind} is not predicted, as it is no linear average of information; try 'sim'.": (
            chosen.kind not in _PREDICTED
        ),
        "The filter has several motions, or one with more states than position and velocity, whose errors are not "
        "predicted; bounds are those of its plainest motion. Try 'sim'.": not _plain(plan),
        "Errors from differenced ranges are not predicted, as agents share their noise; try 'sim'.": (
            chosen.measurement == "difference"
        ),
        f"Errors of more than {_MOST_STATES // plan.plain_motion.size} agents are not predicted; try 'sim'.": (
            scenario.count * plan.plain_motion.size > _MOST_STATES
        ),
        "Ranges leave the position open, or nearly, so covariances come out too small and NEES is not predicted: "
        "expect larger errors.": not determined(plan),
        "Recorded ranges have biases and outliers that are unknown beforehand: errors are those of noise of "
        f"{plan.range_std:g} m alone, so expect more.": recorded,
        "Outliers are not in the prediction: expect larger errors.": (
            not recorded and sensor.outlier_probability > 0.0
        ),
        "Range biases are not in the prediction: expect larger errors.": (
            not recorded and (sensor.bias_std > 0.0 or bool(np.any(sensor.bias)))
        ),
        "The filter assumes another range noise than the receivers have; the prediction uses the filter's.": (
            not recorded and plan.range_std != sensor.range_std
        ),
        "Messages of earlier steps are not in the prediction, which is of consensus.lag = 0.": (
            scenario.consensus.lag > 0
        ),
        "Trimmed consensus is not linear; the prediction is of averaging without it.": scenario.consensus.trim > 0,
        "Agents that send wrong values are not in the prediction.": any(
            fault.kind == "byzantine" for fault in scenario.fault
        ),
    }
    return [sentence for sentence, holds in said.items() if holds]


def _plain(plan: Plan) -> bool:
    return not plan.models and plan.motion is plan.plain_motion


def _predictable(plan: Plan) -> bool:
    chosen, states = plan.scenario.filter, plan.scenario.count * plan.plain_motion.size
    plain = chosen.kind in _PREDICTED and chosen.measurement == "range" and _plain(plan)
    return plain and states <= _MOST_STATES


def _search(predictor: _Predictor, within: float) -> dict[Scheme, int | None]:
    """The smallest sufficient number of rounds for each scheme; None where 64 are not enough."""
    limit = (1.0 + within) * predictor.centralized.position_rmse

    def enough(scheme: Scheme) -> int | None:
        tried = sorted(rounds for each, rounds in predictor.found if each == scheme)
        return next((one for one in tried if predictor.found[scheme, one].position_rmse <= limit), None)

    predictor.predict([(scheme, rounds) for scheme in SCHEMES for rounds in LADDER[:_AT_FIRST]])
    late = [scheme for scheme in SCHEMES if (enough(scheme) or LADDER[-1]) > LADDER[_AT_FIRST - 1]]
    # One probe far out tells whether more rounds help at all.
    predictor.predict([(scheme, LADDER[-1]) for scheme in late])
    predictor.predict([(each, rounds) for each in late if enough(each) for rounds in LADDER[_AT_FIRST:-1]])
    for scheme in SCHEMES:
        if (reached := enough(scheme)) is not None:
            below = max((rounds for each, rounds in predictor.found if each == scheme and rounds < reached), default=0)
            predictor.predict([(scheme, rounds) for rounds in range(below + 1, reached)])
    return {scheme: enough(scheme) for scheme in SCHEMES}


class _Predictor:
    """Expected errors of a scenario, by scheme and number of rounds: of the configured ones from the start."""

    def __init__(self, plan: Plan, sight: Sight, first: int, configured: tuple[Scheme, int]) -> None:
        scenario = plan.scenario
        self._plan, self._sight, self._first = plan, sight, first
        kind, count = scenario.filter.kind, float(scenario.count)
        omega = count if scenario.filter.omega is None else scenario.filter.omega
        self._weight = {"sicf": count, "icf": count, "hcmci": omega}.get(kind, 1.0)
        self._clipping = Clipping.at(level_of(kind, plan.xi))
        self._mixing: dict[Scheme, Floats] = {}
        self._plain_sight = determined(plan)
        shared = self._rounds(*configured)
        both = np.stack([np.full_like(shared, 1.0 / count), shared])
        self.centralized, expected = self._errors(
            both, np.stack([np.full(scenario.count, count), self._counts(*configured)])
        )
        self.found = {configured: expected}

    def predict(self, wanted: Sequence[tuple[Scheme, int]]) -> None:
        """Add predictions for these schemes and numbers of rounds."""
        new = [one for one in dict.fromkeys(wanted) if one not in self.found]
        if not new:
            return
        # The most rounds first: fewer are contained in them.
        new.sort(key=lambda one: -one[1])
        matrices = np.stack([self._rounds(scheme, rounds) for scheme, rounds in new])
        self.found.update(zip(new, self._errors(matrices, np.stack([self._counts(*one) for one in new])), strict=True))

    def compared(self, scheme: Scheme, rounds: int) -> Compared:
        """What was predicted, beside the centralised filter."""
        found = self.found[scheme, rounds]
        ratio = found.position_rmse / self.centralized.position_rmse
        return Compared(**vars(found), ratio_to_centralized=ratio)

    def _counts(self, scheme: Scheme, rounds: int) -> Floats:
        """How often agents count their own ranges, (n,)."""
        return self._weight / with_scheme(self._plan, scheme, rounds=rounds).overcounted

    def _rounds(self, scheme: Scheme, rounds: int) -> Floats:
        if rounds == 0:
            return np.eye(self._plan.scenario.count)[None]
        if len(self._mixing.get(scheme, ())) < rounds:
            self._mixing[scheme] = mixing(self._plan, scheme, rounds)
        matrices: Floats = self._mixing[scheme][rounds - 1]
        return matrices

    def _errors(self, matrices: Floats, weight: Floats) -> list[Expected]:
        expected = propagate(
            self._plan.initial_covariance,
            self._plan.plain_motion,
            self._sight,
            matrices,
            weight=weight,
            clipping=self._clipping,
        )
        position, velocity, nees = (
            part[:, self._first :].mean(axis=1) for part in (expected.position, expected.velocity, expected.nees)
        )
        return [
            Expected(float(np.sqrt(p)), float(np.sqrt(v)), float(e) if self._plain_sight else None)
            for p, v, e in zip(position, velocity, nees, strict=True)
        ]
