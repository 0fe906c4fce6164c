"""Loss in bursts."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import model_validator

from zenoh_cbef.arrays import Bools
from zenoh_cbef.faults.base import Effect, LinkFault, Messages
from zenoh_cbef.quantities import Chance, Probability
from zenoh_cbef.streams import Keys, uniform

_LEAST = 1e-3
_WIDEST = 256


class BurstLoss(LinkFault):
    """Gilbert-Elliott loss: a link is good or bad, and changes from one message to the next (Elliott, BSTJ 42, 1963).

    A good link turns bad with probability `good_to_bad`, a bad one good with `bad_to_good`; a message is lost with
    `loss_in_good` or `loss_in_bad`. The share of bad messages is good_to_bad/(good_to_bad + bad_to_good), and a bad
    time lasts 1/bad_to_good messages on average. Links start in the stationary distribution.
    """

    kind: Literal["burst-loss"]
    good_to_bad: Chance
    bad_to_good: Chance
    loss_in_good: Probability = 0.0
    loss_in_bad: Probability = 1.0

    @model_validator(mode="after")
    def _mixes(self) -> Self:
        total = self.good_to_bad + self.bad_to_good
        if not _LEAST <= total <= 2.0 - _LEAST:
            raise ValueError(
                f"fault.good_to_bad + fault.bad_to_good must lie between {_LEAST} and {2.0 - _LEAST}, not at "
                f"{total:g}: the link would remember its state for too long; change one of them"
            )
        return self

    def effect(self, messages: Messages, index: int) -> Effect:
        """Lost with the probability of the link's state."""
        bad = self._bad(messages, index)
        chance = np.where(bad, self.loss_in_bad, self.loss_in_good)
        return Effect(lost=messages.uniform(f"burst-loss/{index}") < chance)

    def _bad(self, messages: Messages, index: int) -> Bools:
        """Which links (e,) are in their bad state.

        The states at the latest message asked for are kept, as they save draws; without them the result is the same.
        """
        name, number = f"burst-loss/{index}/state", messages.number
        latest, states = messages.streams.states.get(name, (None, None))
        known = None if latest is None or states is None or latest > number else (number - latest, states)
        bad = self._drawn(messages.streams.key(name), number, known)
        messages.streams.states[name] = number, bad
        return bad

    def _drawn(self, key: Keys, number: int, known: tuple[int, Bools] | None) -> Bools:
        """The states (e,) at a message, exactly. known: states (e,) at an earlier message, and how many messages ago.

        One uniform draw per message moves both states at once: below the smaller of good_to_bad and 1 - bad_to_good
        either becomes bad, above the larger either becomes good, and between them both stay (or, where good_to_bad is
        the larger, both change). So the latest draw outside that band tells the state, whatever came before it:
        coupling from the past (Propp, Wilson, Random Structures and Algorithms 9, 1996).
        """
        low, high = sorted((self.good_to_bad, 1.0 - self.bad_to_good))
        changes = self.good_to_bad > 1.0 - self.bad_to_good
        bad = np.zeros(len(key), dtype=bool)
        open_ = np.arange(len(key))
        width, past = 8, 0
        while open_.size:
            if known is not None:
                width = min(width, known[0] - past)
                if width == 0:
                    bad[open_] ^= known[1][open_]
                    break
            draws = uniform(key[open_, None], number - past - np.arange(width))
            decided = (draws < low) | (draws >= high)
            found, first = decided.any(axis=1), decided.argmax(axis=1)
            between = np.where(found, first, width)
            bad[open_] ^= changes & (between % 2 == 1)
            bad[open_[found]] ^= (draws < low)[found, first[found]]
            open_ = open_[~found]
            past, width = past + width, min(2 * width, _WIDEST)
        return bad
