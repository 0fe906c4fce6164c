"""Averaging payloads with neighbours: the only stage that mixes agents, and it knows nothing of filters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import neighbour_sum
from zenoh_cbef.tracking.links import Links

Rounding = Callable[[Floats], Floats]
"""What receivers take messages (n, d) to be that travel in few bits."""


class Consensus(Protocol):
    """An averaging scheme. `start` and `mix` return the messages that the agents send next."""

    def start(self, payload: Floats) -> Floats:
        """Begin a step with payloads (n, d); returns the first message (n, d)."""

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """Take in one round, messages (n, m, d) of which some were delivered (n, m), None for all.

        Returns the next message. A stage that has the links of its batch takes what all agents sent, (N, d), instead.
        """

    def result(self) -> Floats:
        """The mixed payload (n, d)."""


class Workspace:
    """Room for the terms of one part of a large batch, which its parts use in turn: it stays in a core's cache."""

    def __init__(self) -> None:
        self._room = np.empty(0)

    def of(self, rows: int, width: int, length: int) -> Floats:
        """An array (n, m, d) of any content, laid out neighbour by neighbour as messages are."""
        size = rows * width * length
        if self._room.size < size:
            self._room = np.empty(size)
        return self._room[:size].reshape(width, rows, length).swapaxes(0, 1)


@dataclass
class Average:
    """y(l) = W y(l-1): with uniform weights the paper's x - epsilon sum_j (x - x_j).

    Where messages q(l) of y(l) are rounded, an agent adds sum_j w_ij (q_j - q_i) to its own y_i, which is not. What
    rounding adds at one end of a link it takes at the other, so the network's sum is kept (Frasca, Carli, Fagnani,
    Zampieri, Int. J. Robust Nonlinear Control 19(16), 2009).

    weights: (n, m), zero where padded. rounded: None where messages are as they are. workspace: of a batch in parts.
    links: of a batch that takes what all agents sent.
    """

    weights: Floats
    rounded: Rounding | None = field(default=None, kw_only=True)
    workspace: Workspace | None = field(default=None, kw_only=True)
    links: Links | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        self._terms = np.empty((*self.weights.shape, 0))

    def start(self, payload: Floats) -> Floats:
        """The payload itself is sent."""
        return self._tell(payload)

    def _tell(self, value: Floats) -> Floats:
        """Keep the agents' values; returns the messages that they send of them."""
        self._value = value
        self._told = value if self.rounded is None else self.rounded(value)
        return self._told

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """One multiplication by W; delivered: (n, m), or (n, m, d) where only components of messages count."""
        # The own value stands in for a missing one, so its term is zero and the rows of W always sum to one. The sum
        # is never -0.0, which padding in a larger batch would turn into 0.0.
        if self.links is None:
            terms = self._terms if self._terms.shape == received.shape else self._room(received)
            np.subtract(received, self._told[:, None, :], out=terms)  # w_ij (q_j - q_i), (n, m, d)
            terms *= self._factors
            if delivered is not None and not delivered.all():
                terms[~delivered] = 0.0
            total = neighbour_sum(terms)
        else:
            total = self._over(self.links, received, delivered)
        total += self._value
        return self._tell(total)

    def _over(self, links: Links, sent: Floats, delivered: Bools | None) -> Floats:
        """The same sum of what all agents sent, link by link."""
        own, terms = self._told.take(links.order, axis=0), sent.take(links.source, axis=0)
        if self._terms.ndim == 3:
            self._terms = self._factors = links.of(self.weights)[:, None]
            if self.workspace is None:  # A factor for each number takes less time, but of many parts much memory.
                self._terms = self._factors = np.repeat(self._factors, terms.shape[1], axis=1)
        for block in links.blocks:
            part = terms[block]
            part -= own[: len(part)]
            part *= self._factors[block]
        if len(missed := links.missed(delivered)):
            terms[missed] = 0.0
        return links.summed(terms)

    def _room(self, received: Floats) -> Floats:
        """Where the terms of messages go, (n, m, d); with it the factors are found."""
        if self.workspace is not None:
            self._factors = self.weights[:, :, None]
            return self.workspace.of(*received.shape)
        # Once, laid out as the messages are: a factor for each of their numbers halves a large batch's time.
        self._terms, self._factors = np.empty_like(received), np.empty_like(received)
        self._factors[...] = self.weights[:, :, None]
        return self._terms

    def result(self) -> Floats:
        """The value after the last round."""
        return self._value


@dataclass
class Chebyshev(Average):
    """Chebyshev-accelerated averaging (Montijano, Montijano, Sagues, IEEE TSP 61(3), 2013).

    With a(x) = (2x - high - low)/(high - low) and T_l the Chebyshev polynomials,
    y(l) = T_l(a(W)) y(0) / T_l(a(1)), written as a three-term recurrence in ratios that cannot overflow.

    weights: (n, m). low, high: (n, 1), bounds of the eigenvalues of W other than 1.
    """

    low: Floats
    high: Floats

    def __post_init__(self) -> None:
        super().__post_init__()
        # Equal bounds (a complete graph) would divide by zero; a narrow band around them is as good.
        middle, half = 0.5 * (self.high + self.low), np.maximum(0.5 * (self.high - self.low), 1e-3)
        self._middle, self._gap = middle, 1.0 - middle
        self._ratio = half / self._gap

    def start(self, payload: Floats) -> Floats:
        """The payload itself is sent."""
        self._previous = payload
        self._omega = np.ones_like(self._ratio)
        self._rounds = 0
        return super()._tell(payload)

    def _tell(self, value: Floats) -> Floats:
        """One step of the recurrence y(l+1) = y(l-1) + omega (a(W)/a(1) y(l) - y(l-1)); value: W y(l)."""
        own = self._value
        scaled = (value - self._middle * own) / self._gap
        if self._rounds == 1:
            self._omega = 1.0 / (1.0 - 0.5 * self._ratio**2)
        elif self._rounds > 1:
            self._omega = 1.0 / (1.0 - 0.25 * self._ratio**2 * self._omega)
        following = self._previous + self._omega * (scaled - self._previous)
        self._previous = own
        self._rounds += 1
        return super()._tell(following)


@dataclass
class RunningSums:
    """Ratio consensus with running sums (Hadjicostis, Vaidya, Dominguez-Garcia, IEEE TAC 61(6), 2016, 1492-1507).

    Every agent holds y_i = (payload, 1) and shares it equally with its d_i neighbours, D_i = d_i + 1 shares. It
    sends not the share but the sum of all its shares in this step, so the next packet repairs a lost one:

        sigma_i <- sigma_i + y_i/D_i                                  sent every round
        y_i     <- y_i/D_i + sum_j (sigma_j - rho_ij),  rho_ij <- sigma_j     over the neighbours j that were delivered
        result:  payload part of y_i / last component of y_i

    rho_ij is what i last heard of sigma_j. Only shares that are still on their way are missing, and they are missing in
    both parts of y: the ratio stays a convex combination of the payloads, and tends to their average. No weights.

    Where messages are rounded, a share is what the rounded sum has grown by, and the agent keeps the rest: no mass is
    made or lost.

    present: (n, m), False where padded. Messages are one number longer than payloads, (n, d + 1). rounded: None where
    messages are as they are. links: of a batch that takes what all agents sent.
    """

    present: Bools
    rounded: Rounding | None = None
    links: Links | None = None

    def __post_init__(self) -> None:
        self._shares: Floats = self.present.sum(axis=1)[:, None] + 1.0
        self._others: Floats = self._shares - 1.0

    def start(self, payload: Floats) -> Floats:
        """Begin again, with nothing heard from any neighbour; the first sum is y/D."""
        self._mass: Floats = np.concatenate([payload, np.ones((len(payload), 1))], axis=1)
        self._sent = np.zeros_like(self._mass)
        count = self.present.size if self.links is None else len(self.links.source)
        self._heard = np.zeros((count, self._mass.shape[1]))
        return self._give()

    def _give(self) -> Floats:
        """Share what the agents hold; returns their sums of all shares."""
        self._share: Floats = self._mass / self._shares
        # A new array: the caller may still hold the message of the round before.
        following = self._sent + self._share
        if self.rounded is not None:
            following = self.rounded(following)
            self._share = self._mass - self._others * (following - self._sent)
        self._sent = following
        return self._sent

    def mix(self, received: Floats, delivered: Bools | None) -> Floats:
        """Keep one share, take in what neighbours have sent since they were last heard."""
        news = self._news(received, delivered) if self.links is None else self._over(self.links, received, delivered)
        self._mass = self._share + news
        return self._give()

    def _news(self, received: Floats, delivered: Bools | None) -> Floats:
        """The sum of what neighbours have sent since, (n, d + 1)."""
        arrived = self.present if delivered is None else delivered & self.present
        # One neighbour after the other, for all agents of the batch at once: that order uses memory best.
        flags = arrived.T.ravel()
        (came,), (missed,) = flags.nonzero(), (~flags).nonzero()
        messages = np.ascontiguousarray(received.swapaxes(0, 1)).reshape(self._heard.shape)
        news = messages - self._heard
        news[missed] = 0.0
        total = neighbour_sum(news.reshape(*self.present.T.shape, news.shape[1]).swapaxes(0, 1))
        self._heard[came] = messages.take(came, axis=0)
        return total

    def _over(self, links: Links, sent: Floats, delivered: Bools | None) -> Floats:
        """The same sum of what all agents sent, link by link."""
        messages, missed = sent.take(links.source, axis=0), links.missed(delivered)
        messages[missed] = self._heard.take(missed, axis=0)
        news = np.subtract(messages, self._heard, out=self._heard)
        news[missed] = 0.0
        self._heard = messages
        return links.summed(news)

    def result(self) -> Floats:
        """The ratio; its divisor is positive, as an agent always keeps a share."""
        return np.asarray(self._mass[:, :-1] / self._mass[:, -1:])
