"""The centralised interacting multiple model filter, offline: the yardstick of a network with several motions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.base import Belief
from zenoh_cbef.tracking.motion import constants_of, turned
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.reference import Ranges, Taken, taken_in
from zenoh_cbef.tracking.switching import Switching, misfit


@dataclass(frozen=True)
class CentralModels:
    """One filter that sees every range at once, for each of several motions, and what weighs them.

    xi: saturation level in standard deviations, infinite for none. power: of the saturation. widens: see
    `saturated_precision`. outliers: in place of all three.
    """

    switching: Switching
    space: Space
    xi: float
    power: int = 1
    widens: float = 0.0
    outliers: Errors | None = None

    def step(self, belief: Belief, seen: Ranges) -> tuple[Belief, Taken]:
        """The belief after one step's ranges, and what the likeliest motion says of them.

        belief: the initial one, (r, s), or what the last step returned.
        """
        if belief.chance is None:
            chance, beliefs = self.switching.begun(belief.state, belief.known_covariance)
        else:
            chance, beliefs = belief.chance, [(one.state, one.known_covariance) for one in belief.parts]
        ahead, mixtures = self.switching.mixed(chance, beliefs)
        taken = [
            taken_in(
                *(Belief(*mixture), motion, self.space, seen),
                xi=self.xi,
                power=self.power,
                widens=self.widens,
                outliers=self.outliers,
                biases=2 * motion.axes if constants_of(motion) else None,
            )
            for motion, mixture in zip(self.switching.motions, mixtures, strict=True)
        ]
        misfits = [misfit(one.cost, one.prior[1], one.posterior[1]) for one in taken]
        chance = self.switching.weighed(ahead, np.stack(misfits, axis=1))
        parts = [
            turned(motion, one.prior, one.posterior) for motion, one in zip(self.switching.motions, taken, strict=True)
        ]
        mixture = self.switching.claimed(chance, parts)
        joined = Belief(*mixture, chance=chance, parts=tuple(Belief(*one) for one in parts))
        return joined, _likeliest(taken, self.switching.of_models(ahead))


def _likeliest(taken: list[Taken], ahead: Floats) -> Taken:
    """What is said of the innovations by the motion that is likeliest before the step; of equal ones by the last."""
    last = len(taken) - 1
    chosen, runs = last - ahead[:, ::-1].argmax(axis=1), np.arange(len(ahead))
    innovation, spread = (
        np.stack([getattr(one, part) for one in taken])[chosen, runs] for part in ("innovation", "spread")
    )
    return replace(taken[0], innovation=np.abs(innovation), spread=spread)


def centralized_models(initial: Belief, models: CentralModels, steps: Iterable[Ranges]) -> Iterator[Belief]:
    """The filter's beliefs of K steps, for r runs. initial: (r, s), (r, s, s)."""
    belief = initial
    for seen in steps:
        belief, _ = models.step(belief, seen)
        yield belief
