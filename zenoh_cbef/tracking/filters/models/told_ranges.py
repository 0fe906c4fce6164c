"""A few agents that tell each other their ranges, from which each of them computes the same estimate."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters.base import Belief, Sharing, Update
from zenoh_cbef.tracking.filters.information_form import packed_size, unchanged
from zenoh_cbef.tracking.filters.models.abreast import Arrays, abreast
from zenoh_cbef.tracking.filters.models.beginning import Beginning
from zenoh_cbef.tracking.filters.models.branching import MOST, Branches, Heard, conditioned, judged_by
from zenoh_cbef.tracking.filters.models.contending import Contest, apart, share, uncounted
from zenoh_cbef.tracking.filters.models.imaging import with_images
from zenoh_cbef.tracking.filters.models.mixtures import Priors, alike, elsewhere, mixture, predicted
from zenoh_cbef.tracking.filters.models.own_range import about_target, said_of
from zenoh_cbef.tracking.filters.models.slots import SLOT, Slots
from zenoh_cbef.tracking.filters.models.splitting import MANY, STAY, begun_with, split, staying
from zenoh_cbef.tracking.filters.models.tying import tied
from zenoh_cbef.tracking.filters.rows import Rows, picked
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.mirroring import Plane, seen_from
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Measurement, Space
from zenoh_cbef.tracking.switching import Switching


@dataclass(frozen=True)
class ToldRanges:
    """A network of a few agents in which each agent knows all ranges of a step, and takes them in together.

    Where steps are long for the motion, or ranges few, or the target turns as it likes, priors are wide against a
    range's curvature and against outliers. A range alone then says neither where to linearise it nor whether it is
    right; together they do. So an agent's payload has its range in place of information, at a place of its own:

        y_i = (x_i, 0 ... 0, 1, p_i, r_i, t_i, sigma_i, 0 ... 0)

    Averaging weighs what agent j told by some w_j, and so the 1 beside it: their ratio is exactly what it told, by
    whatever way. Each then computes the same: squared ranges, and which of them are wrong (branching.py), for each
    of the motions between which the target switches, weighed by the likelihood of all ranges (switching.py). An agent
    that missed some of them differs a little, until later ranges count for more.

    The estimate begins with the mean of the agents' guesses x_i, which is worth as much as there are independent ones,
    or anywhere: a second prior, unlikely beforehand, about which ranges decide: of one motion in as many steps as that
    takes, as what is not decided yet is carried on, of several in the first. Where it seeks, the network looks for a
    target of one motion wherever else it may be, too, while its ranges deny the place (contending.py).

    range_std: sigma (m). network_size: n. middle: the point from which positions are counted, m. guesses: how many of
    position and of velocity are independent. outliers: see branching.py. own_std: of constant biases, m, which are all
    estimated beside position and velocity; 0: there are none. anywhere: where the target may be if the guesses are
    wrong, state (1, s) and covariance (1, s, s). plane: that agents are near, so that guesses do not tell a target from
    its mirror image, or None. splits: how hypotheses are split over which ranges bend, of which several stay then; 0:
    none. least: ranges below it, m, are none. agrees: whether agents agree on the mean of their guesses before they
    predict it: a motion that is not linear leaves each of them another covariance otherwise. settled, ties, exact and
    adds, compares, persists: see splitting, tying, branching, contending, persisting.py.
    """

    motions: tuple[Motion, ...]
    switching: Switching
    space: Space
    range_std: float
    network_size: int
    middle: tuple[float, ...]
    guesses: tuple[int, int]
    outliers: tuple[float, float] | None = None
    own_std: float = 0.0
    anywhere: tuple[Floats, Floats] | None = None
    plane: Plane | None = None
    seeks: bool = False
    splits: int = 0
    settled: bool = False
    least: float = -np.inf
    ties: bool = False
    exact: bool = False
    adds: bool = False
    agrees: bool = False
    compares: bool = False
    persists: bool = False

    @classmethod
    def sharing(cls, settings: FilterSettings) -> Sharing:
        """A mean, and a place for each agent; as long as a fix needs at least."""
        return Sharing(cls.of(settings).size)

    @classmethod
    def of(cls, settings: FilterSettings) -> Self:
        """The filter of these settings."""
        alike = {one.name: getattr(settings, one.name) for one in fields(cls) if hasattr(settings, one.name)}
        others = {
            "motions": settings.switching.motions,
            "guesses": settings.guesses or (1, 1),
            "own_std": settings.own_bias_std if settings.joint_biases else 0.0,
        }
        return cls(**alike | others)

    @property
    def size(self) -> int:
        """Numbers in a payload."""
        return max(self._told + self.network_size * SLOT, packed_size(2 * self.space.axes))

    @property
    def _more(self) -> int:
        """How many biases a state holds."""
        return self.network_size if self.own_std else 0

    @property
    def _told(self) -> int:
        """How many numbers of a payload are the mean of position and velocity."""
        return 2 * self.space.axes

    def update(self, belief: Belief, measurement: Measurement) -> Update:
        """What the agent tells: its prior's mean, and its range."""
        begins = np.full(len(belief.state), float(belief.chance is None and not belief.memory))
        counts = belief.memory[3] if self.seeks and belief.memory else uncounted(len(belief.state))
        ahead, begun = self._begun(belief)
        priors, former = self._predicted(begun), self._former(begun, belief)
        own, count = self._slots.of(measurement), len(ahead)
        slots = np.zeros((count, self.network_size, SLOT))
        slots[np.arange(count), own] = self._slots.told(measurement)
        guess, spread = belief.state[:, : self._told], belief.known_covariance[:, : self._told, : self._told]
        mean = guess if self.agrees and begins.any() else priors[0][0][:, 0, : self._told]
        told = np.concatenate([mean, slots.reshape(count, -1)], axis=1)
        payload = np.pad(told, ((0, 0), (0, self.size - told.shape[1])))
        known = ahead, own.astype(np.float64), begins, counts, guess, spread
        kept = *known, *former, *(part for prior in priors for part in prior)
        said = self._diagnosed(ahead, priors, measurement, own, share(counts) if self.seeks else None)
        return Update(payload, said, kept)

    def conclude(self, payload: Floats, update: Update) -> Belief:
        """The estimate from all ranges that came; of an agent that heard no neighbour, its prior."""
        ahead, own, begins, counts, guess, spread, *parts = update.kept
        former, parts = parts[: len(self.motions)], parts[len(self.motions) :]
        alone = unchanged(payload, update.payload) if self.network_size > 1 else np.zeros(len(ahead), dtype=bool)
        away = (payload - update.payload)[:, : self._told]
        guessed = away * (begins * ~alone)[:, None]
        off = apart(away, spread, self.space.axes) & self.compares
        if self.agrees and begins.any():
            agreed = self._predicted(self._begun(Belief(guess + guessed, spread))[1])
            known = [part for prior in agreed for part in prior]
            parts = [picked(old, new, begins > 0.0) for new, old in zip(known, parts, strict=True)]
            guessed = np.zeros_like(guessed)
        averages = payload[:, self._told :][:, : self.network_size * SLOT]
        # An agent of many hypotheses may take in its range alone: they follow the bend of that.
        heard = self._slots.heard(averages, alone & (not self.splits))
        each = []
        for state, covariance, likely, was in zip(parts[::3], parts[1::3], parts[2::3], former, strict=True):
            centred = self._centred(state)
            centred[:, 0, : self._told] += guessed
            each.append((centred, covariance, likely, was, counts, off.astype(np.float64), *vars(heard).values()))
        found, misfits, stays = [], [], []
        for after, spread, likelihood, *later in abreast(self.motions, each, self._after):
            found.append((self._centred(after, -1.0), spread))
            misfits.append(-2.0 * likelihood)
            stays.append((self._centred(later[0], -1.0), *later[1:]) if later else ())
        which = own.astype(np.intp) if self._more else None
        if len(self.motions) == 1:
            return replace(about_target(*found[0], self._begin, which), memory=stays[0])
        chance = self.switching.weighed(ahead, np.stack(misfits, axis=1))
        parts_of = tuple(Belief(*one, memory=later) for one, later in zip(found, stays, strict=True))
        claimed = about_target(*self.switching.claimed(chance, found), self._begin, which)
        return replace(claimed, chance=chance, parts=parts_of, memory=self._kept(heard, claimed.state))

    def _after(self, motion: Motion, rows: Arrays) -> Arrays:
        """State, covariance and likelihood after the ranges, and what the next step begins with, if hypotheses stay."""
        state, covariance, likely, former, counts, off, *told = rows
        prior, heard = (state, covariance, likely), Heard(*told)
        known = self.space.axes, self._biases, share(counts) if self.seeks else None, motion
        halves = self._contest.halves(prior) if self.seeks else (prior,)
        parts = (split(with_images(one, self._near), heard, self.splits, settled=self.settled) for one in halves)
        before = [Branches.of(one, *known, ties=self.ties, exact=self.exact, adds=self.adds) for one in parts]
        if self.seeks:
            place, *rest = self._beginning.elsewhere(len(counts))
            where = self._centred(place), rest[0], rest[1]
            whole, stay = self._contest.after(before[0], before[1], where, heard, counts, off=off > 0.0)
            return *whole.merged(), *stay
        many = MANY if self.splits else MOST
        whole = tied(conditioned(before[0].with_former(former), heard, self.outliers, many), heard)
        if not self.splits and len(self.motions) > 1:
            return whole.merged()
        return *whole.merged(), *(staying(whole) if self.splits else whole.distinct())

    def resumed(self, belief: Belief) -> Belief:
        """A belief of another filter, as this one carries it from step to step: it is no guess."""
        return self.moved(belief, belief)

    def moved(self, belief: Belief, place: Belief) -> Belief:
        """A belief of this filter at another place; biases stay as they are, and motions are as likely as at first."""
        state, covariance = place.state, place.known_covariance
        there = replace(belief, state=state, covariance=covariance)
        if len(self.motions) > 1:
            if belief.chance is not None and self._more:
                known = [(one.state, one.known_covariance) for one in belief.parts]
                state, covariance = elsewhere(self.switching.combined(belief.known_chance, known), place)
            chance, parts = self.switching.begun(state, covariance)
            found = tuple(Belief(*one, memory=alike(*one, STAY) if self.splits else ()) for one in parts)
            return replace(there, chance=chance, parts=found, memory=self._kept(self._slots.nothing(state), state))
        whole, spread = self._beginning.of(state, covariance)
        if belief.memory:
            size, (states, covariances) = self.motions[0].size, belief.memory[:2]
            whole[:, size:], spread[:, size:, size:] = states[:, 0, size:], covariances[:, 0, size:, size:]
        kept = alike(whole, spread, self._contest.stay * (1 + self.seeks))
        counts = (uncounted(len(state)),) if self.seeks else ()
        return replace(there, memory=(*kept, *counts))

    def denied(self, belief: Belief) -> Bools:
        """Of which agents (n,) ranges deny the place."""
        return self._contest.denied(belief.memory[3])

    @cached_property
    def _slots(self) -> Slots:
        return Slots(self.space, self.range_std, self.middle, self.network_size, self.least)

    @cached_property
    def _near(self) -> Plane | None:
        return seen_from(self.plane, self.middle)

    @cached_property
    def _contest(self) -> Contest:
        return Contest(self.space.axes, self.outliers, splits=self.splits > 0)

    @property
    def _begin(self) -> int:
        """Where biases begin: after a single motion's state, or after what all motions have in common."""
        return self.motions[0].size if len(self.motions) == 1 else self._told

    @property
    def _biases(self) -> int | None:
        return self._begin if self.own_std else None

    def _begun(self, belief: Belief) -> tuple[Floats, list[Priors]]:
        """How likely each motion is in the step, (n, M), and what the step begins with if it is."""
        begins = belief.chance is None and not belief.memory
        if begins:
            axes, scale = self.space.axes, np.ones(belief.state.shape[1])
            scale[:axes], scale[axes : 2 * axes] = (number**-0.5 for number in self.guesses)
            belief = self.moved(belief, Belief(belief.state, belief.known_covariance * np.outer(scale, scale)))
        if len(self.motions) == 1:
            ahead, priors = np.ones((len(belief.state), 1)), [(belief.memory[0], belief.memory[1], belief.memory[2])]
        elif self.splits:
            ahead, priors = begun_with(self.switching, belief)
        else:
            parts = [(one.state, one.known_covariance) for one in belief.parts]
            ahead, mixed = self.switching.mixed(belief.known_chance, parts)
            priors = [alike(*one, 1 + begins) for one in mixed]
        if begins:
            priors = [self._beginning.elsewhere_too(*one) for one in zip(self.motions, priors, strict=True)]
        return ahead, priors

    def _predicted(self, priors: list[Priors]) -> list[Priors]:
        """With each motion what may be, a step later."""
        beside = self._more if len(self.motions) == 1 else 0
        return [predicted(motion, one, beside) for motion, one in zip(self.motions, priors, strict=True)]

    def _kept(self, heard: Heard, state: Floats) -> tuple[Floats, ...]:
        """What a network of several motions keeps of a step's ranges for the next. state: (n, s), what it found."""
        return tuple(vars(self._slots.doubtful(heard, self._centred(state))).values()) if self.persists else ()

    def _former(self, priors: list[Priors], belief: Belief) -> list[Floats]:
        """What hypotheses with which a step begins make of the ranges before it, (n, k, m, 3); zeros: nothing."""
        heard = Heard(*belief.memory) if len(self.motions) > 1 and belief.memory else None
        if heard is None or np.isnan(heard.range).all():
            return [np.zeros((*one[0].shape[:2], self.network_size, 3)) for one in priors]
        centred = [(self._centred(state), covariance, likely) for state, covariance, likely in priors]
        return judged_by(self.motions, centred, heard, self.space.axes, self._biases, adds=self.adds)

    @cached_property
    def _beginning(self) -> Beginning:
        return Beginning(self.motions, self._more, self.own_std, self.anywhere, self.plane)

    def _diagnosed(
        self, ahead: Floats, priors: list[Priors], new: Measurement, own: Rows, share_: Floats | None
    ) -> Diagnostics:
        """What is said of the own range, by the likeliest motion before it was heard; weight: whether it is right."""
        heard, said = self._slots.own(new), list[Diagnostics]()
        likely = self.switching.of_models(ahead)
        likeliest = likely >= np.maximum.reduce(likely, axis=1)[:, None]
        for motion, (state, covariance, likelihood) in enumerate(priors):
            if said and not likeliest[:, motion].any():
                continue
            alone = mixture(state, covariance, likelihood)[:2] if self.splits else (state[:, 0], covariance[:, 0])
            first = self._centred(alone[0])[:, None], alone[1][:, None], np.zeros((len(state), 1))
            prior = Branches.of(first, self.space.axes, self._biases, share_, exact=self.exact, adds=self.adds)
            one = said_of(prior, heard, own, self.outliers)
            said = [said[0].chosen(likeliest[:, motion], one) if said else one]
        return replace(said[0], maneuver=likely[:, -1].copy()) if len(self.motions) > 1 else said[0]

    def _centred(self, state: Floats, sign: float = 1.0) -> Floats:
        """States (..., s) with the position counted from the middle, or with sign -1 back."""
        centred = np.array(state)
        centred[..., : self.space.axes] -= sign * np.array(self.middle)
        return centred
