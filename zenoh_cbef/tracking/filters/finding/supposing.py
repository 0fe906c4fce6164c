"""A network whose ranges do not all fit supposes of each receiver in turn that it is wrong, and goes by the best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ints
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.finding.doubts import SLOT, Doubts
from zenoh_cbef.tracking.filters.finding.hypotheses import Hypotheses, Told, belief_at, speed_of
from zenoh_cbef.tracking.filters.finding.moved import moved
from zenoh_cbef.tracking.filters.finding.own_line import OwnLine
from zenoh_cbef.tracking.filters.finding.remembered_ranges import Wandering
from zenoh_cbef.tracking.filters.finding.search import Search, decides
from zenoh_cbef.tracking.filters.information_form import predict, unchanged, variance_of
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion import begun
from zenoh_cbef.tracking.ranging import Measurement, own_range
from zenoh_cbef.tracking.status import CUT, Status

_MARK = 1e6
"""What agents that tell put where others wish: an average tells a mixture."""

_ANY = 1e-9
"""More than rounding leaves of an average of zeros."""

_MARGIN = 13.5
"""By how much twice the log likelihood has to gain, in units of the misfit that is left."""

_UNIQUE = 6.0
"""By how much it has to be better than with the next receiver left out."""

_REST = 5
"""For how many windows the network does not ask again."""

_MEMORY = 15.0
"""How many of its own ranges an agent remembers that is left out, by the thirteenth rules."""

_FADES = 3.0
"""By what a misfit is divided with the next range: CUT is below PLAUSIBLE after two that fit."""

_PLAUSIBLE = 2.0
"""The misfit of these from which on it takes part again."""

_UNEXPLAINED = 10.0
"""The cost over the spare numbers from which on no hypothesis explains the ranges."""


@dataclass(frozen=True)
class Supposing(Wrapping):
    """Any filter that knows what its estimate is, and supposes that a receiver is wrong where ranges do not all fit.

    A receiver with an error of its own pulls the estimate, and saturation then leaves out those that are right. Where
    the estimate stands the ranges of most agents fit, so none of them can tell. Only all ranges together can: without
    the wrong receiver there is a place where they all fit. A network of a few agents is small enough for each of them
    to know all. An agent puts a line through its ranges of the last 2 W steps (own_line.py). It tells its position,
    range and rate, and three numbers of their covariance. When the ranges of one agent do not fit (Status.wrong),
    agents put these numbers into their payloads in place of the filter's, each at a place of its own, and zeros
    elsewhere. That takes as many steps as all need; meanwhile the filter predicts. Averaging multiplies what agent j
    told and the 1 beside it by the same weight, so their ratio is exactly what it told, by whatever way it came. Then
    each agent computes the same (hypotheses.py):

        J_0, J_1 to J_n       least costs with all agents, and without each; a: the least of J_1 to J_n, b: the next
        g = max(1, J/spare)   the least misfit per number left over: where sigma is understated, all costs are large
        J_0 - J_a > 13.5 g    agent a is wrong, if also J_b - J_a > 6 g; otherwise ranges do not tell which one is
        J(estimate) - J > 13.5 g   the filter moves to that place, with the covariance that the lines give there
        J > 10 spare          nothing explains the ranges: agents say that the target is lost

    An agent tells zeros where one in four or more of its ranges is not on the line. An agent that is wrong leaves out
    its ranges until two in a row fit: until e <- max(min(NIS, 9), e/3), at first 9, is below 2. Single ranges that are
    wrong are for the saturation. By the thirteenth rules the mean of min(NIS, 9) of the last 15 or so had to be. Agents
    agree on when to tell as they do on another fix (Reacquiring). One agent that wishes it is enough, and then none may
    for five windows.

    hypotheses, line: see there. payload_size: the filter's. window: W.
    """

    settings: FilterSettings
    hypotheses: Hypotheses
    line: OwnLine
    payload_size: int
    window: int

    more = 1

    @classmethod
    def of(cls, settings: FilterSettings, around: Filter, payload_size: int) -> Supposing:
        """Around a filter that says its status. payload_size: of that filter."""
        if settings.anywhere is None:
            raise ValueError("a filter that looks for its target again has to know where that may be")
        size, motion = 2 * settings.space.axes, settings.motion
        middle, wide = (part[0] for part in settings.anywhere)
        anywhere = middle[:size], np.diagonal(wide)[:size].copy()
        share = max(1.0, settings.network_size / settings.space.axes)
        wandering = Wandering(motion.acceleration_std**2 * motion.dt, share)
        far = 1e3 * float(np.sqrt(anywhere[1][0]))
        line = OwnLine(settings.range_std, wandering, far)
        return cls(around, settings, Hypotheses(settings.space, anywhere), line, payload_size, settings.reacquires)

    @property
    def _each(self) -> int:
        """How many agents tell in a step."""
        return self.payload_size // SLOT

    @property
    def _steps(self) -> int:
        """In how many steps all agents have told."""
        return -(-self.settings.network_size // self._each)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, without the ranges of an agent that leaves them out, or what the agent tells."""
        inner = belief.parts[0] if belief.parts else belief
        doubts = Doubts(*belief.memory) if belief.memory else self._begun(belief)
        step, agent = doubts.step + 1.0, doubts.agent if measurement.agent is None else measurement.agent.astype(float)
        if measurement.step is not None:
            step[:] = measurement.step
        doubts = doubts.later(measurement, self.settings.motion.dt, step=step, agent=agent)
        left, tells, heard = doubts.left > 0.0, doubts.doing > 0.0, measurement
        if leaves := left.nonzero()[0].size:
            heard = replace(measurement, range=np.where(left, np.nan, measurement.range))
            doubts = replace(doubts, own=self._own(doubts.own, inner, measurement))
        update, status = self.filter.update(inner, heard), inner.status or Status.first(len(left))
        tag, spreads = (status.wrong & ~left).astype(np.float64), ~decides(self.settings, doubts.step)
        tag[spreads] = doubts.vote[spreads]
        payload, diagnostics = update.payload, update.diagnostics
        if tells.nonzero()[0].size:
            doubts = self._slot(doubts, inner, measurement)
            payload = np.where(tells[:, None], self._told(doubts), payload)
            tag[tells] = _MARK
        if leaves:
            diagnostics = replace(diagnostics, distrust=np.where(left, 1.0, diagnostics.distrust))
        count, size = payload.shape
        longer = np.empty((count, size + self.more))
        longer[:, :size], longer[:, size] = payload, tag
        return Update(longer, diagnostics, tuple(vars(doubts).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, or where what all told says that the target is."""
        doubts, before = Doubts(*update.kept), update.parts[0]
        tells, own, average = doubts.doing > 0.0, payload[:, :-1], payload[:, -1].copy()
        average[np.isnan(average)] = 0.0
        apart = np.abs(average) > 2.0
        if tells.nonzero()[0].size:
            tag = update.payload[:, -1]
            apart = np.where(tells, np.abs(average - tag) > _ANY * tag, apart)
        alone = tells | apart
        if alone.nonzero()[0].size:
            own = np.where(alone[:, None], before.payload, own)
        inner = self.filter.conclude(np.ascontiguousarray(own), before)
        if doubts.none and inner.status and not (average > _ANY).nonzero()[0].size:
            memory = tuple(vars(doubts.saying(inner.status)).values())
            return Belief(inner.state, inner.covariance, inner.bias, memory, (inner,), inner.status)
        apart |= unchanged(payload[:, :-1], update.payload[:, :-1])
        if tells.nonzero()[0].size:
            doubts, inner = self._compared(doubts, inner, payload, apart)
        return self._turned(doubts, inner, average, apart)

    def _begun(self, belief: Belief) -> Doubts:
        return Doubts.first(len(belief.state), self.settings.network_size, 2 * self.window)

    def _own(self, own: Floats, inner: Belief, new: Measurement) -> Floats:
        """How badly the ranges of an agent fit that leaves them out."""
        state, covariance = predict(self.settings.motion, Belief(inner.state, inner.known_covariance))
        expected, row = own_range(self.settings.space, state, new.position, new.age)
        spread = np.add.reduce(row * (covariance @ row[:, :, None])[:, :, 0], axis=1)
        nis = (new.range - expected) ** 2 / (spread + variance_of(new, self.settings.range_std))
        latest = np.minimum(nis, CUT)
        misfit = np.maximum(latest, own / _FADES) if self.settings.rejoins else own + (latest - own) / _MEMORY
        return np.where(np.isfinite(nis), misfit, own)

    def _slot(self, doubts: Doubts, inner: Belief, new: Measurement) -> Doubts:
        """What an agent that begins to tell says of its ranges of the last steps."""
        line, covariance, good = self.line.fitted(doubts, speed_of(inner, self.settings.space.axes))
        flat = covariance.reshape(-1, 4)[:, [0, 1, 3]]
        slot = np.concatenate([np.ones((len(line), 1)), new.position, line, flat], axis=1) * good[:, None]
        first = doubts.doing == 1.0
        return replace(
            doubts,
            slot=np.where(first[:, None], slot, doubts.slot),
            table=np.where(first[:, None, None], 0.0, doubts.table),
        )

    def _told(self, doubts: Doubts) -> Floats:
        """The payload of an agent that tells, or listens: zeros but for its own numbers at its own place."""
        if np.count_nonzero(doubts.agent < 0.0):
            raise ValueError("agents that tell what they measured need to know which they are")
        block, place = np.divmod(doubts.agent.astype(np.int64), self._each)
        speaks = doubts.doing == block + 1.0
        told = np.zeros((len(place), self._each, SLOT))
        told[range(len(place)), place] = np.where(speaks[:, None], doubts.slot, 0.0)
        return np.pad(told.reshape(len(place), -1), ((0, 0), (0, self.payload_size - self._each * SLOT)))

    def _compared(self, doubts: Doubts, inner: Belief, payload: Floats, apart: Bools) -> tuple[Doubts, Belief]:
        """With what was told in this step; after the last of these, with what follows from all."""
        count, agents = len(doubts.step), self.settings.network_size
        slots = payload[:, : self._each * SLOT].reshape(count, self._each, SLOT)
        share = slots[:, :, :1]
        usable = np.abs(share) > _ANY
        # Whatever the weight with which averaging brought an agent's numbers here, it brought its 1 with the same.
        slots = np.where(usable, slots / np.where(usable, share, 1.0), 0.0)
        table = np.pad(doubts.table, ((0, 0), (0, self._steps * self._each - agents), (0, 0)))
        for step in range(self._steps):
            rows = (doubts.doing == step + 1.0) & ~apart
            part = slice(step * self._each, (step + 1) * self._each)
            table[:, part] = np.where(rows[:, None, None], slots, table[:, part])
        doubts = replace(doubts, table=table[:, :agents])
        done = np.flatnonzero(doubts.doing == self._steps)
        return self._judged(doubts, inner, done) if len(done) else (doubts, inner)

    def _judged(self, doubts: Doubts, inner: Belief, done: Ints) -> tuple[Doubts, Belief]:
        """With what follows for those (d,) whom all have told."""
        axes, table = self.settings.space.axes, doubts.table[done]
        known = table[:, :, 0] > _ANY
        covariance = table[:, :, [6, 7, 7, 8]].reshape(*known.shape, 2, 2)
        covariance = np.where(known[:, :, None, None], covariance, np.eye(2))
        # By now the estimate is some steps later than what was told.
        late = (self._steps - 1) * self.settings.motion.dt
        here = inner.state[done, : 2 * axes].copy()
        here[:, :axes] -= late * here[:, axes:]
        found = self.hypotheses.all(
            Told(known.astype(np.float64), table[:, :, 1:4], table[:, :, 4:6], covariance), here
        )
        rows, cost = np.arange(len(done)), found.cost
        best = 1 + np.argmin(cost[:, 1:], axis=1)
        scale = np.maximum(np.min(cost / found.spare, axis=1), 1.0)
        second = np.partition(cost[:, 1:], 1, axis=1)[:, 1]
        wrong = cost[:, 0] - cost[rows, best] > _MARGIN * scale
        which = np.where(wrong, best, 0)
        sure = ~wrong | (second - cost[rows, best] > _UNIQUE * scale)
        explained = cost[rows, which] < _UNEXPLAINED * found.spare[rows, which]
        proved = known.sum(axis=1) > axes + 1
        sound = proved & sure & explained
        moves = np.zeros(len(doubts.step), dtype=bool)
        moves[done] = sound & (found.at[rows, which] - cost[rows, which] > _MARGIN * scale)
        left = sound & (which == doubts.agent[done] + 1)
        again = np.where(left, CUT, 0.0)
        values = {"left": left, "own": again, "open": proved & ~sound, "rest": float(_REST * self.window)}
        changed = {name: getattr(doubts, name).copy() for name in values}
        for name, value in values.items():
            changed[name][done] = value
        if moves.any():
            inner = self._moved(inner, belief_at(found, which), done, moves)
        return replace(doubts, **changed), inner

    def _moved(self, inner: Belief, place: Belief, done: Ints, moves: Bools) -> Belief:
        """The filter's belief, of those who move at what was found."""
        motion = self.settings.motion
        there = Belief(*begun(motion, place.state, place.known_covariance))
        for _ in range(self._steps - 1):
            there = Belief(*predict(motion, there))
        state, covariance = inner.state.copy(), inner.known_covariance.copy()
        state[done], covariance[done] = there.state, there.known_covariance
        inner = chosen(inner, moved(self.filter, inner, Belief(state, covariance)), moves)
        if inner.status is None:
            return inner
        status, (known,) = inner.status.anew(moves), inner.parts
        return replace(inner, status=status, parts=(replace(known, status=status),))

    def _turned(self, doubts: Doubts, inner: Belief, average: Floats, apart: Bools) -> Belief:
        """What agents say in this step, and do from the next one on."""
        status = inner.status or Status.first(len(doubts.step))
        tells = doubts.doing > 0.0
        wanted = ~tells & ~apart & (average > _ANY)
        vote = ~tells & (wanted | (doubts.vote > 0.0))
        ends = doubts.step % self.window == 0.0
        rest = np.maximum(doubts.rest - 1.0, 0.0)
        begins = ends & vote & (rest == 0.0) & ~self._searches(inner)
        doing = np.where(tells, (doubts.doing + 1.0) % (self._steps + 1.0), np.where(begins, 1.0, 0.0))
        left = np.where(doubts.own > _PLAUSIBLE, doubts.left, 0.0)
        undecided = np.where(ends & ~vote & (rest < (_REST - 1) * self.window), 0.0, doubts.open)
        doubts = replace(
            doubts,
            doing=doing,
            vote=np.where(vote & ~ends, 1.0, 0.0),
            rest=rest,
            left=left,
            open=undecided,
        )
        status = doubts.told(status, self.settings.motion.dt)
        memory = tuple(vars(doubts.saying(status)).values())
        return Belief(inner.state, inner.covariance, inner.bias, memory, (inner,), status)

    def _searches(self, inner: Belief) -> Bools:
        """Which agents look for the target in another way."""
        search = Search(*inner.memory) if inner.memory else None
        return np.zeros(len(inner.state), dtype=bool) if search is None else search.fixing
