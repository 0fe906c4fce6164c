"""A network that was silent for long, or has lost its target, looks for it again: with another fix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Update
from zenoh_cbef.tracking.filters.damping import corrected
from zenoh_cbef.tracking.filters.finding.drifted import drifted
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.knowing import Knowing, former_of
from zenoh_cbef.tracking.filters.finding.moved import moved
from zenoh_cbef.tracking.filters.finding.patience import gives_up, hears_again, left_to_a_fix
from zenoh_cbef.tracking.filters.finding.proving import fitting
from zenoh_cbef.tracking.filters.finding.search import Search, decides
from zenoh_cbef.tracking.filters.finding.squared_ranges import Seen
from zenoh_cbef.tracking.filters.information_form import packed_size, predict, unchanged
from zenoh_cbef.tracking.filters.rows import chosen
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.linalg import pack_upper
from zenoh_cbef.tracking.ranging import Measurement, own_range
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, Status

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
class Reacquiring(Wrapping):
    """Any filter that knows what its estimate is, and least squares on the latest ranges where that is too little.

    A filter linearises at its estimate. After a long silence that is far off, as it is when the target is lost; the
    covariance then gets too small at a wrong place, and the filter stays there. So agents keep the ranges of the last
    2 W steps, and look for the target as in a first fix, on squared ranges for W/5 steps and by Gauss-Newton for the
    rest of W, if more than half of them want to: those that have coasted too far (drifted.py) and hear ranges again,
    and those that have lost the target for long (patience.py). The former start from where they
    have coasted to, with the covariance that they have then, the latter from anywhere.

    All have to begin in the same step, or payloads of two kinds would be averaged. So a fix begins after a step that W
    divides, or where ranges are real as few as a decision takes. One number more in a payload agrees upon that: at
    first in every W steps the agents' wishes, 1 or -1, and 0 of those that hear no ranges, of which the greater part
    decides; in the last of them whether the decision is known, so that it spreads to all; in a fix a number that marks
    its part. An agent whose average shows that others do something else goes on by prediction in this step. By the
    first rules of the status agents vote with 1 or 0, and more than half of all have to want a fix.

    window: W. anywhere: where the target may be if nothing is known, state (1, s) and covariance (1, s, s), the same
    for all agents.
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
        fix = replace(FirstFix.of(settings, around, xi, payload_size), damping=None)
        squares = replace(fix, steps=ever, search=settings.anywhere, guesses=guesses, squared=ever)
        if settings.anywhere is None:
            raise ValueError("a filter that looks for its target again has to know where that may be")
        return cls(around, settings, squares, replace(squares, squared=0), settings.reacquires, settings.anywhere)

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """The filter's update, or that of a fix, and the vote."""
        inner = belief.parts[0] if belief.parts else belief
        search = Search(*belief.memory) if belief.memory else self._begun(inner)
        known, idle, heard = inner.status or Status.first(len(search.step)), search.idle, measurement
        step = search.step + 1.0
        if measurement.step is not None:
            step[:] = measurement.step
        if belief.bias is not None:
            # Without the bias of the ranges, as far as it is relied on.
            # In a fix the belief is that, and the bias is of where the filter is; by earlier rules not told apart.
            where, most = inner.state if self.settings.proves else belief.state, self.settings.most_bias
            distance, _ = own_range(self.settings.space, where, measurement.position, np.zeros(len(step)))
            heard = replace(measurement, range=belief.bias.taken_off(measurement.range, distance, most))
        if not idle:
            measurement = left_to_a_fix(self.settings, measurement, (search.adrift > 0.0) | search.fixing)
        update = self.filter.update(inner, measurement)
        tag, payload = self._tag(search, step, known, np.isfinite(heard.range), measurement.few), update.payload
        if idle or not (fixing := search.fixing).nonzero()[0].size:
            search = search.later(heard, self.settings.motion.dt, step=step)
        else:
            tag[fixing] = search.doing[fixing]
            payload, search = self._fixing(payload, replace(search, step=step), heard)
        count, size = payload.shape
        longer = np.empty((count, size + self.more))
        longer[:, :size], longer[:, size] = payload, tag
        return Update(longer, update.diagnostics, tuple(vars(search).values()), (update,))

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The filter's belief, or the fix so far."""
        search, before = Search(*update.kept), update.parts[0]
        own, average = payload[:, : -self.more], payload[:, -1].copy()
        average[np.isnan(average)] = 0.0
        apart = np.abs(average) > 2.0
        if not (idle := search.idle):
            tag = update.payload[:, -1]
            apart = np.where(search.fixing, np.abs(average - tag) > _ANY * tag, apart)
        apart |= unchanged(own, update.payload[:, : -self.more])
        # Where others do something else nothing that was averaged is of use: as if no neighbour had been heard.
        alone = apart if idle else search.fixing | apart
        if alone.nonzero()[0].size:
            own = np.where(alone[:, None], before.payload, own)
        inner = self.filter.conclude(np.ascontiguousarray(own), before)
        if self.settings.judges_agents:
            wanted = average > _ANY
        else:
            wanted = np.abs(average) > np.where(decides(self.settings, search.step), _MOST, _ANY)
        if idle and inner.status and not (wanted | inner.status.coasts).nonzero()[0].size:
            # No agent wants a fix, or has coasted too far.
            memory = vars(search) | {"place": inner.state, "place_covariance": inner.known_covariance}
            return replace(inner, memory=tuple(memory.values()), parts=(inner,))
        if search.fixing.nonzero()[0].size:
            search = self._concluded(search, payload, update, apart)
        fitted = np.where(apart, 0.0, self.settings.network_size * np.fmax(payload[:, -2], 0.0))
        return self._turned(inner, search, before, wanted, apart, fitted=fitted)

    def _begun(self, belief: Belief) -> Search:
        (count, size), kept = belief.state.shape, 2 * self.window
        none, nowhere = np.zeros(count), (np.zeros((count, size)), np.zeros((count, size, size)))
        return Search(
            *Search.nothing(count, kept),
            *(none, none, none, none, none),
            *(belief.state, belief.known_covariance),
            *(*nowhere, *nowhere, nowhere[0]),
        )

    def _tag(self, search: Search, step: Floats, known: Status, heard: Bools, few: Bools | None) -> Floats:
        """What agents that are in no fix put into their payloads beside those of the filter, (n,)."""
        counted, lately = self.settings.judges_agents, heard
        if (~heard).nonzero()[0].size:
            lately = heard | np.isfinite(search.ranges[:, -self.window :]).any(axis=1)
        gone = gives_up(self.settings, known, search.ranges)
        back = lately & hears_again(self.settings, known, search.ranges, heard)
        wish = ((search.adrift > 0.0) & back | gone).astype(np.float64)
        if counted:
            wish += wish - 1.0
            wish[~lately] = 0.0
        spreads = ~decides(self.settings, step)
        wish[spreads] = search.vote[spreads]
        if few is not None:
            wish *= ~few
        wish[known.which == ACQUIRING] = 0.0
        return wish

    def _fixing(self, payload: Floats, search: Search, heard: Measurement) -> tuple[Floats, Search]:
        """The payload of those in a fix, and what that leaves."""
        belief = self._iterate(search)
        squared, refined = self.squares.update(belief, heard), self.refines.update(belief, heard)
        payload = _pick(search.doing == _SQUARED, squared.payload, payload)
        payload = _pick(refines := search.doing == _REFINED, refined.payload, payload)
        prior, covariance, positions, ages, ranges, predicted = refined.kept
        if self.settings.proves:
            # Where the filter's payload ends there is room beside a fix on the ranges themselves.
            payload[refines, -1] = fitting(self.refines, predicted, Seen(positions, ages, ranges))[refines]
        search = replace(search, prior=prior, prior_covariance=covariance, correction=predicted)
        # The oldest was for this fix alone: however agents of one batch go on, they keep as many.
        return payload, replace(search, positions=positions[:, 1:], ages=ages[:, 1:], ranges=ranges[:, 1:])

    def _iterate(self, search: Search) -> Belief:
        """The fix so far; for agents that are in none, whose result is not used, their estimate."""
        place = search.place, search.place_covariance
        prior, fix = (search.prior, search.prior_covariance), (search.fix, search.fix_covariance)
        (prior_state, prior_covariance), (state, covariance) = (
            tuple(_pick(search.fixing, *pair) for pair in zip(one, place, strict=True)) for one in (prior, fix)
        )
        seen = search.positions, search.ages, search.ranges
        return Belief(state, covariance, memory=(prior_state, prior_covariance, *seen, search.correction))

    def _concluded(self, search: Search, payload: Floats, update: Update, apart: Bools) -> Search:
        """The fix after this step; `correction` comes as what was predicted."""
        of_the_fix = np.pad(search.ranges, ((0, 0), (1, 0)))
        kept = search.prior, search.prior_covariance, search.positions, search.ages, of_the_fix, search.correction
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
        passes = search.step - search.begun - self.window // _SQUARED_SHARE
        state, correction = corrected(self.settings.damping, search.correction, state, passes)
        correction = _pick(apart, ahead[0] - search.correction, correction)
        state, covariance = _pick(apart, ahead[0], state), _pick(apart, ahead[1], covariance)
        return replace(search, fix=state, fix_covariance=covariance, correction=correction)

    def _turned(
        self, inner: Belief, search: Search, before: Update, wanted: Bools, apart: Bools, *, fitted: Floats
    ) -> Belief:
        """What agents say in this step, and do from the next one on. fitted: how many ranges fit a fix, (n,)."""
        former, fixing = former_of(before), search.fixing
        status = inner.status or former
        settled = ~fixing & (status.which != ACQUIRING)
        # By the eleventh rules agents that begin anew do as the others do, and a group that is too small does nothing.
        concerned = settled | (alike := self.settings.cut_off > 0)
        astray = drifted(self.settings, inner, status, search)
        search = self._left_behind(search, inner)
        if search.idle and inner.status and not (wanted | astray).nonzero()[0].size:
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
        proved = np.where(done, fitted, 0.0) if self.settings.proves else None
        status = status.anew(begins | fixing, fitted=proved)
        status = status.told(adrift > 0.0, COASTING, former, self.settings.motion.dt)
        inner = replace(inner, status=status)
        state = _pick(fixing, search.fix, inner.state)
        covariance = _pick(fixing, search.fix_covariance, inner.known_covariance)
        excess = None if inner.excess is None else np.where(fixing, 0.0, inner.excess)
        return Belief(state, covariance, inner.bias, tuple(vars(search).values()), (inner,), status, excess=excess)

    def _left_behind(self, search: Search, inner: Belief) -> Search:
        """Where agents that are adrift have coasted to without the ranges since."""
        adrift, place = search.adrift > 0.0, (inner.state, inner.known_covariance)
        if adrift.nonzero()[0].size:
            ahead = predict(self.settings.motion, Belief(search.place, search.place_covariance))
            place = _pick(adrift, ahead[0], place[0]), _pick(adrift, ahead[1], place[1])
        return replace(search, place=place[0], place_covariance=place[1])

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
