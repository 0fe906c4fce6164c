"""Leaving out neighbours whose messages no honest agent sends, for a step or for good."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zenoh_cbef.arrays import Bools, Floats, Ids
from zenoh_cbef.tracking.consensus import Consensus
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.linalg import inverse, matvec
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.status import CUT, DOUBT, WRONG

Claims = Callable[[Floats], tuple[Floats, Floats]]
"""Information vectors and matrices of messages (n, d)."""

IMPLAUSIBLE = 15.0
"""Test statistic from which on a message is left out; honest ones have about half the number of states."""

EXAGGERATED = 2.0
"""How many times the most that honest agents can know, on average over the states, a message may claim to know."""

ENOUGH = 5.0
"""Score at which a neighbour is isolated: after as many implausible steps in a row."""

FORGIVEN = 0.5
"""What a plausible step takes from a score."""


class Isolating:
    """Any averaging of information, without the messages that the own prediction rules out.

    Detection and isolation by innovations, as Ghods and Doostmohammadian have it for this network (Signals 6(3):44,
    2025), here on what neighbours send. Whatever share of the network's information a message (V, O) is, it says that
    the target is at O^-1 V. An agent compares that with its own prediction x, P of this step:

        T = (O^-1 V - x)^T P^-1 (O^-1 V - x)/2

    The two are honest guesses of one state, each no worse than P, so T is about half a chi-squared number. That says
    nothing of how certain the message is of it. So an agent also compares O with the most that all agents' ranges can
    tell, B (knowable.py), of which a message is the n-th part, or the whole, depending on the filter:

        tr(O most^-1)/s,  most = B/n or B,  for s states

    A message with T above 15, or of more than twice that certainty, is taken as lost, and so are its sender's other
    ones of the same step. A step with one adds 1 to the sender's score, another one takes 1/2 from it; a neighbour that
    reaches 5 is isolated for good. All this an agent decides by itself, from what it received alone.

    An agent whose own prediction is wrong finds all its neighbours implausible. So it isolates no more than half of
    them, and while it leaves out others, it goes on by prediction, until that is uncertain enough to fit again. With
    one neighbour its own ranges decide which of the two is wrong: it isolates that one while they fit the prediction,

        e <- e + (min(NIS, 9) - e)/5 <= 3.6,  at first e = 2

    NIS: of the agent's range at its own prediction. Such an agent goes on by prediction for good.

    inner: the averaging, whose missing messages return their weight to the own value. motion: the filter's. claims:
    what messages say, see InformationPayloads. most: (s, s); None: any certainty is believed. present: (n, m), False
    where padded. names: (n, m), the neighbours'. only: whether the only neighbour may be isolated.
    """

    def __init__(
        self,
        inner: Consensus,
        motion: Motion,
        claims: Claims,
        present: Bools,
        names: Ids,
        *,
        most: Floats | None = None,
        only: bool = True,
    ) -> None:
        self.inner, self.motion, self.claims, self.names = inner, motion, claims, names
        self._limit = None if most is None else np.linalg.inv(most).ravel() / (EXAGGERATED * len(most))
        degree = present.sum(axis=1)
        self._most, self._lone = degree // 2, (degree == 1) & only
        self._score = np.zeros(present.shape)
        self._isolated, self._out = np.zeros_like(present), np.zeros_like(present)
        self._latest: Floats = np.full(len(present), np.nan)
        self._misfit: Floats = np.full(len(present), DOUBT)

    def look(self, belief: Belief, fresh: Bools, nis: Floats) -> None:
        """Begin a step with the belief that the last one left; fresh: (n,), agents that begin without a memory.

        nis: (n,), of the agents' own ranges, NaN without one.
        """
        self._state = self.motion.predict_state(belief.state)
        self._information = inverse(self.motion.predict_covariance(belief.known_covariance, belief.state))
        self._score[fresh], self._isolated[fresh], self._latest[fresh] = 0.0, False, np.nan
        misfit = np.where(fresh, DOUBT, self._misfit)
        self._misfit = np.where(np.isfinite(nis), misfit + (np.minimum(nis, CUT) - misfit) / ENOUGH, misfit)

    def start(self, payload: Floats) -> Floats:
        """The inner averaging's first message."""
        self._out = self._isolated.copy()
        return self.inner.start(payload)

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """One round, with the messages that are plausible."""
        arrived = np.ones_like(self._out) if delivered is None else delivered
        self._out |= arrived & self._implausible(received)
        return self.inner.mix(received, arrived & ~self._out)

    def result(self) -> Floats:
        """The mixed payload."""
        return self.inner.result()

    def judge(self) -> Floats:
        """End the step: count scores; returns the neighbour that each agent isolated last, (n,), NaN for none."""
        self._score = np.maximum(self._score + np.where(self._out, 1.0, -FORGIVEN), 0.0)
        guilty = self._isolated | (self._score >= ENOUGH)
        most = np.where(self._lone & (self._misfit <= WRONG), 1, self._most)
        guilty &= (guilty.sum(axis=1) <= most)[:, None] | self._isolated
        new = guilty & ~self._isolated
        if new.any():
            first = np.take_along_axis(self.names, new.argmax(axis=1)[:, None], axis=1)[:, 0]
            self._latest = np.where(new.any(axis=1), first, self._latest)
        self._isolated = guilty
        return self._latest

    def _implausible(self, received: Floats) -> Bools:
        count, width, length = received.shape
        with np.errstate(all="ignore"):  # messages can be forged
            vector, matrix = self.claims(received.reshape(-1, length))
            sound = np.linalg.det(matrix) > 0.0
            if self._limit is not None:
                # The trace of a product is the sum of its factors' products, as both are symmetric.
                sound &= np.sum(matrix.reshape(len(matrix), -1) * self._limit, axis=1) <= 1.0
            matrix = np.where(sound[:, None, None], matrix, np.eye(matrix.shape[1]))
            apart = matvec(inverse(matrix), vector) - np.repeat(self._state, width, axis=0)
            told = np.sum(apart * matvec(np.repeat(self._information, width, axis=0), apart), axis=1)
        return np.asarray(~(sound & (0.5 * told <= IMPLAUSIBLE)).reshape(count, width))
