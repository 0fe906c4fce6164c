"""A network that was silent for long, or has lost its target, looks for it again: with another fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.finding.drifted import drifted
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.finding.moved import moved
from zenoh_cbef.tracking.filters.finding.patience import gives_up, left_to_a_fix
from zenoh_cbef.tracking.filters.information_form import packed_size, predict, unchanged
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import pack_upper
from zenoh_cbef.tracking.ranging import Measurement
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, LOST, Status

_SQUARED, _REFINED = 1e6, 2e6
"""What agents in the two parts of a fix put where others vote: an average tells a mixture."""

_SQUARED_SHARE = 5
"""What part of a fix is on squared ranges."""

_MOST = 0.5
"""Which share of the agents has to want a fix, by the first rules."""

_WINDOWS = 2.0
"""At the end of how many windows an agent may no longer coast until it is not adrift any more."""

_ANY = 1e-9
"""More than rounding leaves of an average of zeros."""


@dataclass(frozen=True)
class Search:
    """How far an agent is with looking for its target again, arrays (n, ...).

    step: the step. begun: that after which the fix began. doing: 0 the filter, otherwise a part of a fix. vote: whether
    the network wants a fix. adrift: above 0 where the agent has coasted too far to go on. place: its estimate without
    the ranges since then, prior: what a fix starts from, fix: the latest iteration; state and covariance each.
    correction: what that one changed. positions, ages, ranges: of the last steps.
    """

    step: Floats
    begun: Floats
    doing: Floats
    vote: Floats
    adrift: Floats
    place: Floats
    place_covariance: Floats
    prior: Floats
    prior_covariance: Floats
    fix: Floats
    fix_covariance: Floats
    correction: Floats
    positions: Floats
    ages: Floats
    ranges: Floats

    @property
    def fixing(self) -> Bools:
        """Which agents are in a fix, (n,)."""
        return np.asarray(self.doing > 0.0)

    @property
    def idle(self) -> bool:
        """Whether no agent is in a fix, wants one, or is adrift."""
        return not np.count_nonzero(self.doing + self.vote + self.adrift)


@dataclass(frozen=True)
class Reacquiring(Wrapping):
    """Any filter that knows what its estimate is, and least squares on the latest ranges where that is too little.

    A filter linearises at its estimate. After a long silence that is far off, as it is when the target is lost; the
    covariance then gets too small at a wrong place, and the filter stays there. So agents keep the ranges of the last
    2 W steps, and look for the target as in a first fix, on squared ranges for W/5 steps and by Gauss-Newton for the
    rest of W, if more than half of them want to: those that have coasted too far (drifted.py) and hear ranges again,
    and those that have lost the target for long (patience.py). The former start from where they have coasted to, with
    the covariance that they have then, the latter from anywhere.

    All have to begin in the same step, or payloads of two kinds would be averaged. So a fix begins after a step that D
    divides: W, or where ranges are real as few as a decision takes. One number more in a payload agrees upon that: at
    first in every D steps the agents' wishes, 1 or -1, and 0 of those that hear no ranges, of which the greater part
    decides; in the last of them whether the decision is known, so that it spreads to all; in a fix a number that marks
    its part. An agent whose average shows that others do something else goes on by prediction in this step. By the
    first rules of the status agents vote with 1 or 0, and more than half of all have to want a fix.

    window: W. anywhere: where the target may be if nothing is known, state (1, s), covariance (1, s, s), for all alike.
    """

    settings: FilterSettings
    squares: FirstFix
    refines: FirstFix
    window: int
    anywhere: tuple[Floats, Floats]

    more = 1

    @classmethod
    def of(cls, settings: FilterSettings, around: Knowing, xi: float, payload_size: int) -> Reacquiring:
        """Around a filter that says its status. payload_size: of that filter."""
        guesses, ever = settings.guesses and (1, 1), np.iinfo(np.int64).max
        fix = FirstFix.of(settings, around, xi, payload_size)
        squares = replace(fix, steps=ever, search=settings.anywhere, guesses=guesses, squared=ever)
        if settings.anywhere is None:
            raise ValueError("a filter that looks for its target again has to know where that may be")
        return cls(around, settings, squares, replace(squares, squared=0), settings.reacquires, settings.anywhere)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, or that of a fix, and the vote."""
        inner = belief.parts[0] if belief.parts else belief
        search = Search(*belief.memory) if belief.memory else self._begun(inner)
        step = search.step + 1.0 if measurement.step is None else np.full(len(search.step), float(measurement.step))
        search, heard = replace(search, step=step), self._unbiased(belief, measurement)
        left = left_to_a_fix(self.settings, measurement, (search.adrift > 0.0) | search.fixing)
        update, known = self.filter.update(inner, left), inner.status or Status.first(len(step))
        tag = self._tag(search, known, np.isfinite(heard.range), measurement.few)
        payload, search = self._fixing(update.payload, search, heard)
        payload = np.concatenate([payload, tag[:, None]], axis=1)
        return Update(payload, update.diagnostics, tuple(vars(search).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, or the fix so far."""
        search, before = Search(*update.kept), update.parts[0]
        tag, average = update.payload[:, -1], np.where(np.isnan(payload[:, -1]), 0.0, payload[:, -1])
        apart = np.where(search.fixing, np.abs(average - tag) > _ANY * tag, np.abs(average) > 2.0)
        apart |= unchanged(payload[:, : -self.more], update.payload[:, : -self.more])
        own = payload[:, : -self.more]
        # Where others do something else nothing that was averaged is of use: as if no neighbour had been heard.
        alone = search.fixing | apart
        if np.count_nonzero(alone):
            own = np.where(alone[:, None], before.payload, own)
        inner = self.filter.conclude(np.ascontiguousarray(own), before)
        if np.count_nonzero(search.fixing):
            search = self._concluded(search, payload, update, apart)
        return self._turned(inner, search, before, average, apart)

    def _decides(self, step: Floats) -> Bools:
        """Whether this is a step in which agents tell their wishes; in the others the decision spreads."""
        cycle = self.settings.deciding or self.window
        return np.asarray((step % cycle > 0.0) & (step % cycle <= cycle - self.settings.spreading))

    def _begun(self, belief: Belief) -> Search:
        (count, size), kept = belief.state.shape, 2 * self.window
        none, nowhere = np.zeros(count), (np.zeros((count, size)), np.zeros((count, size, size)))
        return Search(
            *(none, none, none, none, none, belief.state, belief.known_covariance),
            *(*nowhere, *nowhere, nowhere[0]),
            np.zeros((count, kept, 3)),
            np.zeros((count, kept)),
            np.full((count, kept), np.nan),
        )

    def _unbiased(self, belief: Belief, measurement: Measurement) -> Measurement:
        """Without the bias of the ranges, as far as it is relied on."""
        if belief.bias is None:
            return measurement
        return replace(measurement, range=measurement.range - belief.bias.weight * belief.bias.value)

    def _tag(self, search: Search, known: Status, heard: Bools, few: Bools | None) -> Floats:
        """What agents put into their payloads beside those of the filter or the fix, (n,)."""
        counted = self.settings.judges_agents
        if search.idle and not counted and not np.count_nonzero(known.which == LOST):
            return np.zeros(len(heard))
        lately = heard | np.isfinite(search.ranges[:, -self.window :]).any(axis=1)
        wish = self._wants(search, known, lately)
        if counted:
            wish = np.where(lately, 2.0 * wish - 1.0, 0.0)
        vote = np.where(self._decides(search.step), wish, search.vote) * (1.0 if few is None else ~few)
        return np.where(search.fixing, search.doing, np.where(known.which == ACQUIRING, 0.0, vote))

    def _wants(self, search: Search, known: Status, lately: Bools) -> Floats:
        return np.where((search.adrift > 0.0) & lately | gives_up(self.settings, known, search.ranges), 1.0, 0.0)

    def _fixing(self, payload: Floats, search: Search, heard: Measurement) -> tuple[Floats, Search]:
        """The payload of those in a fix, and what that leaves; for all others the ranges of this step."""
        if not np.count_nonzero(search.fixing):
            known = search.positions, search.ages + self.settings.motion.dt, search.ranges
            new = heard.position, heard.age, heard.range
            seen = tuple(np.concatenate([one, two[:, None]], axis=1) for one, two in zip(known, new, strict=True))
        else:
            belief = self._iterate(search)
            squared, refined = self.squares.update(belief, heard), self.refines.update(belief, heard)
            payload = _pick(search.doing == _SQUARED, squared.payload, payload)
            payload = _pick(search.doing == _REFINED, refined.payload, payload)
            prior, prior_covariance, *found, predicted = refined.kept
            search = replace(search, prior=prior, prior_covariance=prior_covariance, correction=predicted)
            seen = found[0], found[1], found[2]
        return payload, replace(search, positions=seen[0], ages=seen[1], ranges=seen[2])

    def _iterate(self, search: Search) -> Belief:
        """The fix so far; for agents that are in none, whose result is not used, their estimate."""
        place = search.place, search.place_covariance
        both = (search.prior, search.prior_covariance), (search.fix, search.fix_covariance)
        (prior_state, prior_covariance), (state, covariance) = (
            tuple(_pick(search.fixing, *pair) for pair in zip(one, place, strict=True)) for one in both
        )
        seen = search.positions, search.ages, search.ranges, search.correction
        return Belief(state, covariance, memory=(prior_state, prior_covariance, *seen))

    def _concluded(self, search: Search, payload: Floats, update: Update, apart: Bools) -> Search:
        """The fix after this step; `correction` comes as what was predicted."""
        kept = search.prior, search.prior_covariance, search.positions, search.ages, search.ranges, search.correction
        square = search.doing == _SQUARED

        def concluded(fix: FirstFix, rows: Bools, size: int) -> Belief:
            # Of agents that do something else a sound payload, whose result is not used.
            sound = np.zeros(fix.payload_size)
            sound[size : packed_size(size)] = pack_upper(np.eye(size)[None])[0]
            own, mixed = (_pick(rows, one[:, : len(sound)], sound[None]) for one in (update.payload, payload))
            return fix.conclude(mixed, Update(own, update.diagnostics, kept))

        squared = concluded(self.squares, square, self.settings.space.axes + 2)
        refined = concluded(self.refines, search.doing == _REFINED, self.settings.motion.size)
        state = _pick(square, squared.state, refined.state)
        covariance = _pick(square, squared.known_covariance, refined.known_covariance)
        ahead = predict(self.settings.motion, Belief(search.fix, search.fix_covariance))
        state, covariance = _pick(apart, ahead[0], state), _pick(apart, ahead[1], covariance)
        return replace(search, fix=state, fix_covariance=covariance, correction=state - search.correction)

    def _turned(self, inner: Belief, search: Search, before: Update, average: Floats, apart: Bools) -> Belief:
        """What agents say in this step, and do from the next one on."""
        former, fixing = Status(*before.kept), search.fixing
        status = inner.status or former
        settled = ~fixing & (status.which != ACQUIRING)
        # By the eleventh rules agents that begin anew do as the others do, and a group that is too small does nothing.
        concerned = settled | (alike := self.settings.cut_off > 0)
        astray = drifted(self.settings, inner, status, search.positions[:, -1])
        if self.settings.judges_agents:
            wanted = average > _ANY
        else:
            wanted = np.abs(average) > np.where(self._decides(search.step), _MOST, _ANY)
        search = self._left_behind(search, inner)
        if search.idle and inner.status and not np.count_nonzero(concerned & (wanted | astray)):
            return replace(inner, memory=tuple(vars(search).values()), parts=(inner,))
        ends, since = search.step % (self.settings.deciding or self.window) == 0.0, search.step - search.begun
        vote = ~fixing & (concerned & ~apart & wanted | (search.vote > 0.0) & ~alike)
        begins, done = ends & vote, fixing & (since == self.window)
        search = self._started(search, begins)
        adrift = np.where(settled, np.where(astray, _WINDOWS, search.adrift), 0.0)
        # An agent that was alone in its wish has its neighbours' estimate by now.
        passed = search.step % self.window == 0.0
        adrift = np.where(begins, 0.0, adrift - (passed & ~status.coasts & (adrift > 0.0)))
        halfway = fixing & (since == self.window // _SQUARED_SHARE)
        doing = np.where(begins, _SQUARED, np.where(halfway, _REFINED, np.where(done, 0.0, search.doing)))
        search = replace(search, doing=doing, vote=np.where(vote & ~ends, 1.0, 0.0), adrift=adrift)
        if done.any():
            inner = chosen(inner, moved(self.filter, inner, Belief(search.fix, search.fix_covariance)), done)
        # Adrift: what the filter makes of the first ranges after a long silence is not to be trusted.
        status = status.anew(begins | fixing).told(adrift > 0.0, COASTING, former, self.settings.motion.dt)
        inner = replace(inner, status=status)
        state = _pick(fixing, search.fix, inner.state)
        covariance = _pick(fixing, search.fix_covariance, inner.known_covariance)
        excess = None if inner.excess is None else np.where(fixing, 0.0, inner.excess)
        return Belief(state, covariance, inner.bias, tuple(vars(search).values()), (inner,), status, excess=excess)

    def _left_behind(self, search: Search, inner: Belief) -> Search:
        """Where agents that are adrift have coasted to without the ranges since, and the ranges without the oldest."""
        adrift, place = search.adrift > 0.0, (inner.state, inner.known_covariance)
        if np.count_nonzero(adrift):
            ahead = predict(self.settings.motion, Belief(search.place, search.place_covariance))
            place = _pick(adrift, ahead[0], place[0]), _pick(adrift, ahead[1], place[1])
        return replace(
            search,
            place=place[0],
            place_covariance=place[1],
            positions=search.positions[:, 1:],
            ages=search.ages[:, 1:],
            ranges=search.ranges[:, 1:],
        )

    def _started(self, search: Search, begins: Bools) -> Search:
        """A fix from where agents have coasted to, or from anywhere, for those that begin one."""
        adrift = search.adrift > 0.0
        anywhere = (np.broadcast_to(each, (len(begins), *each.shape[1:])) for each in self.anywhere)
        pairs = zip((search.place, search.place_covariance), anywhere, strict=True)
        state, covariance = (_pick(begins & adrift, *pair) for pair in pairs)
        return replace(
            search,
            begun=np.where(begins, search.step, search.begun),
            prior=_pick(begins, state, search.prior),
            prior_covariance=_pick(begins, covariance, search.prior_covariance),
            fix=_pick(begins, state, search.fix),
            fix_covariance=_pick(begins, covariance, search.fix_covariance),
            correction=_pick(begins, np.zeros_like(state), search.correction),
        )


def _pick(rows: Bools, first: Floats, second: Floats) -> Floats:
    return np.where(rows.reshape(-1, *(1,) * (second.ndim - 1)), first, second)
