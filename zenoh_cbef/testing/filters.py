"""What every filter must hold to: `check_filter(Mine)`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef import streams
from zenoh_cbef.arrays import Floats
from zenoh_cbef.plugins import told_options
from zenoh_cbef.testing.nonconforming import Nonconforming
from zenoh_cbef.tracking.compact import FLOAT32, Compact
from zenoh_cbef.tracking.filters.base import Belief, Filter, Kind, Update, filter_of
from zenoh_cbef.tracking.filters.plugged import Shapes
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.moderation import LARGEST, immoderate_belief
from zenoh_cbef.tracking.motion import MotionSettings, make_motion
from zenoh_cbef.tracking.ranging import Measurement, Space

_AGENTS, _STEPS, _NEIGHBOURS, _DT, _STD = 7, 12, 2, 0.1, 0.1
_NEGATIVE = -1e-9
"""A covariance's least eigenvalue in units of its largest one, as rounding leaves it."""

_MOSTLY = 0.5
_REMEDY = "correct conclude()"


@dataclass(frozen=True)
class _Course:
    """What a batch went through: its updates, mixed payloads and beliefs, one for each step."""

    updates: list[Update]
    mixed: list[Floats]
    beliefs: list[Belief]

    def bits(self, rows: slice) -> list[bytes]:
        """All numbers of some agents, step by step."""
        parts: list[Floats] = []
        for update, belief in zip(self.updates, self.beliefs, strict=True):
            said = update.diagnostics.named().values()
            kept = [] if belief.covariance is None else [belief.covariance]
            parts += [update.payload, belief.state, *kept, *said, *update.kept, *belief.memory]
        return [np.ascontiguousarray(part[rows]).tobytes() for part in parts]


class _Rules(Shapes):
    """What a filter says of itself, and what is reasonable."""

    def check_update(self, update: Update, measurement: Measurement, when: str) -> None:
        """Raise Nonconforming where a payload is of the wrong size or no number, or says something of no range."""
        if words := self.flaw_of_update(update, len(measurement.range)):
            raise Nonconforming(f"{when} {words}")
        if not np.isfinite(update.payload).all():
            raise Nonconforming(
                f"{when} the payload is not finite; a missing range is NaN, and an agent without one shares its "
                "prediction"
            )
        silent, said = ~np.isfinite(measurement.range), update.diagnostics
        if np.isfinite([said.innovation[silent], said.weight[silent]]).any():
            raise Nonconforming(
                f"{when} an agent without a range reports an innovation or a weight; use Diagnostics.where(measured, "
                "...), which leaves them out"
            )

    def check_belief(self, belief: Belief, count: int, when: str) -> None:
        """Raise Nonconforming where a belief is of the wrong size, no number, or certain beyond reason."""
        if words := self.flaw_of_belief(belief, count):
            raise Nonconforming(f"{when} {words}")
        if not np.isfinite(belief.state).all():
            raise Nonconforming(f"{when} the state is not finite; {_REMEDY}")
        if immoderate_belief(belief).any():
            raise Nonconforming(f"{when} conclude() gives a number beyond {LARGEST:g}, which no agent takes; {_REMEDY}")
        if belief.covariance is not None:
            self._check_covariance(belief.covariance, when)

    def _check_covariance(self, covariance: Floats, when: str) -> None:
        if not np.isfinite(covariance).all():
            raise Nonconforming(f"{when} the covariance is not finite; {_REMEDY}")
        turned = np.swapaxes(covariance, 1, 2)
        values = np.linalg.eigvalsh(0.5 * (covariance + turned))
        symmetric = np.allclose(covariance, turned, rtol=1e-6, atol=1e-9)
        if not symmetric or not (values[:, 0] >= _NEGATIVE * np.abs(values[:, -1])).all():
            raise Nonconforming(f"{when} the covariance is not symmetric and positive; {_REMEDY}")


def check_filter(kind: type, **options: object) -> None:
    """Ask of a filter all that agents rely on, in space and in a plane.

    Raises Nonconforming, or ValueError for options that the filter has not, or a class that is no filter.
    kind: the class that `filter.kind` would name. options: as in `filter.options`. The filter goes through twelve steps
    of seven agents whose payloads are averaged, with ranges missing here and there.
    """
    chosen = filter_of(kind, kind.__qualname__)
    told = told_options(getattr(chosen, "options", None), kind.__qualname__, options, "filter.options")
    for height in (None, 1.0):
        try:
            _check(chosen, replace(_settings(height), options=told))
        except Nonconforming as error:
            raise Nonconforming(f"{'in space' if height is None else 'in a plane'} {error}") from None


def _settings(height: float | None) -> FilterSettings:
    space = Space(height)
    motion = make_motion("ncv", MotionSettings(dt=_DT, acceleration_std=0.5, axes=space.axes))
    return FilterSettings(motion=motion, space=space, range_std=_STD, xi=1.5, network_size=_AGENTS)


def _check(kind: type[Kind], settings: FilterSettings) -> None:
    one, rules = kind.of(settings), _Rules.of(kind, settings)
    begun, measured = _begun(settings), _measured(kind, settings)
    course = _through(one, begun, measured, rules)
    if _through(one, begun, measured, rules).bits(slice(None)) != course.bits(slice(None)):
        raise Nonconforming(
            "the same filter gives other numbers the second time; keep what it remembers in the belief, and draw "
            "nothing at random"
        )
    if _through(kind.of(settings), begun, measured, rules).bits(slice(None)) != course.bits(slice(None)):
        raise Nonconforming("two filters of the same settings give different numbers; draw nothing at random")
    _check_blocks(kind, settings, course)
    _check_batches(one, begun, measured, course, rules)
    _check_mixtures(one, course, rules)


def _check_blocks(kind: type[Kind], settings: FilterSettings, course: _Course) -> None:
    """What a filter says is information on states is so: nearly all payloads travel in 16 bits, and little changes."""
    sharing = kind.sharing(settings)
    if not sharing.blocks:
        return
    compact = Compact(sharing.payload_size, sharing.blocks, "int16")
    payload = np.concatenate([update.payload for update in course.updates])
    short = [compact.pack(row)[0] != FLOAT32 for row in payload]
    if np.mean(short) < _MOSTLY:
        raise Nonconforming(
            f"sharing() says blocks = {sharing.blocks}, but payloads do not begin with information vectors and "
            "positive definite matrices of so many states; leave blocks out, and payloads travel in float32 at least"
        )


def _begun(settings: FilterSettings) -> Belief:
    """A belief for each agent before the first step."""
    key = streams.stream(1, "initial estimate", np.arange(_AGENTS))[:, None]
    state = streams.normal(key, np.arange(settings.motion.size))
    return Belief(state, np.tile(np.eye(settings.motion.size), (_AGENTS, 1, 1)))


def _measured(kind: type[Kind], settings: FilterSettings) -> list[Measurement]:
    """Ranges to a target that flies by; some are missing, one agent's always, and one is far too long."""
    agents = np.arange(_AGENTS)
    place = 10.0 * streams.normal(streams.stream(1, "placement", agents)[:, None], np.arange(3))
    width = _NEIGHBOURS if kind.sharing(settings).uses_neighbour_ranges else 0
    others = (agents[:, None] + np.arange(1, width + 1)) % _AGENTS
    found = []
    for step in range(1, _STEPS + 1):
        target = np.array([0.3 * step, 0.2 * step, 1.0])
        noise = _STD * streams.normal(streams.stream(1, "range noise", agents), step)
        ranges = np.linalg.norm(target - place, axis=1) + noise
        ranges[(agents + step) % 4 == 0] = np.nan
        ranges[-1] = np.nan
        if step == _STEPS // 2:
            ranges[0] = 1e4
        found.append(Measurement(place, ranges, np.full(_AGENTS, 1e-8), place[others], ranges[others], step=step))
    return found


def _through(
    one: Filter, belief: Belief, measured: Sequence[Measurement], rules: _Rules, mixed: Sequence[Floats] = ()
) -> _Course:
    """Take a batch through all steps. mixed: what averaging leaves; none: each agent's mean with the next agent's."""
    course = _Course([], [], [])
    for number, measurement in enumerate(measured):
        update = one.update(belief, measurement)
        rules.check_update(update, measurement, f"in step {number + 1}")
        payload = mixed[number] if mixed else 0.75 * update.payload + 0.25 * np.roll(update.payload, -1, axis=0)
        belief = one.conclude(payload, update)
        rules.check_belief(belief, len(payload), f"in step {number + 1}")
        course.updates.append(update)
        course.mixed.append(payload)
        course.beliefs.append(belief)
    return course


def _check_batches(one: Filter, begun: Belief, measured: Sequence[Measurement], course: _Course, rules: _Rules) -> None:
    """A row alone gives the bits that it gives among others."""
    for agent in range(_AGENTS):
        row = slice(agent, agent + 1)
        alone = _through(
            one,
            Belief(begun.state[row], begun.known_covariance[row]),
            [_measured_by(each, row) for each in measured],
            rules,
            [each[row] for each in course.mixed],
        )
        if alone.bits(slice(None)) != course.bits(row):
            raise Nonconforming(
                f"agent {agent} alone gives other bits than in a batch of {_AGENTS}; use elementwise functions "
                "and stacked products (A @ x[..., None]), and no sum or product over the agents"
            )


def _measured_by(all_: Measurement, row: slice) -> Measurement:
    return replace(
        all_,
        position=all_.position[row],
        range=all_.range[row],
        age=all_.age[row],
        neighbour_position=all_.neighbour_position[row],
        neighbour_range=all_.neighbour_range[row],
    )


def _check_mixtures(one: Filter, course: _Course, rules: _Rules) -> None:
    """Any convex combination of the agents' payloads stands for a belief."""
    key = streams.stream(1, "consensus", np.arange(_AGENTS))[:, None]
    for number, update in enumerate(course.updates, 1):
        weights = streams.uniform(key, _AGENTS * number + np.arange(_AGENTS))
        weights /= weights.sum(axis=1, keepdims=True)
        belief = one.conclude(np.einsum("ij,jk->ik", weights, update.payload), update)
        rules.check_belief(belief, _AGENTS, f"from a convex combination of the payloads of step {number}")
