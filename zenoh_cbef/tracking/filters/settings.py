"""The settings from which a filter is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import BY_LIBRARY, Inversion
from zenoh_cbef.tracking.motion import Motion
from zenoh_cbef.tracking.ranging import Space


@dataclass(frozen=True)
class FilterSettings:
    """What any filter may need to know.

    range_std: m; learns_noise: it is where learning it begins. lasting: whether errors of
    successive ranges may be alike. recorded: whether such errors widen what agents claim, and not
    the noise by which they weigh ranges, and a bias is believed also for the share of the misfit that it explains.
    doubts_noise: whether range_std may be wrong by a factor of two; counts_ranges: whether the network counts the
    ranges that say so, and lasting errors are weighed with all that an estimate keeps of them.
    xi, omega: see the filter; omega None: network_size. network_size: number of agents.
    differenced: whether ci and local take in differences of ranges in place of the
    agent's own range. power: of the saturation. widens: whether
    a saturated range widens its whole innovation, not its noise alone. recovers: from which share of implausible
    innovations on the network widens its covariances, 0: never. distrusts:
    whether agents give their own implausible ranges less weight. returns: whether an
    agent's range counts less after a step in which it heard no neighbour. says_status: whether they say
    if they acquire, track, coast, or have lost the target; judges_agents: whether that counts agents that do not
    fit, or ranges, and whether only those that hear ranges vote for another fix. hearing: for
    how many steps after a range an agent counts as one that hears the target; 0: agents do not count those.
    calls_roll: whether they count by a number for each, or by one alone.
    rounds: of a step. reacquires: how many steps another fix takes, 0 for none; spreading: in how many steps all
    agents know a decision; anywhere: where that fix looks
    for the target, like search. bends: whether agents coast no further than ranges are straight lines. prompt: whether
    another fix begins soon after the target is lost, and has the first ranges after a silence to itself; deciding:
    every how many steps agents decide whether one begins, 0: as many as it takes. supposes:
    whether all tell each other what they measured where ranges of one do not fit; rejoins: one
    that is wrong takes part again after two ranges that fit, or after many. cut_off: how many
    rounds a step has, where agents may be cut off from others and tell who is there; 0: they do not. presumes: whether
    agents presume that ranges fit and that all others are there until they know better. proves:
    whether another fix has the ranges of its time for itself, knows what is known of biases, and is proved by the
    ranges that fit it, and a target that was lost needs proof as one that was never found. undetermined: whether their
    places leave open where the target is, so that they never say that they track it. sides: whether they say so
    when they do not know on which side of them the target is. bias: none,
    estimate or auto; likelihoods: whether auto weighs it by these, or by the NIS; weighs_lasting:
    whether the more, the less alike errors are, and weighs_shares: a share of all ranges, too;
    common_bias_std, own_bias_std: its prior, m. scale_std: prior of the share by which all ranges may be too long,
    besides joint biases; 0: by none. told_biases: whether they are constant, and as large as told: a first fix says
    what it knows of them, and none is forgotten. joint_biases: whether agents estimate all biases together, which
    have no common part then. first_fix: over how many steps the initial estimate, a guess, is improved by least
    squares on the first ranges; 0: it is none. squared_fix: how many of these steps are on squared ranges.
    tries_guess: whether the guess is tried before the network searches. search: where squared ranges look for the
    target, state (1, s) and covariance (1, s, s); None: around the guess. models: the
    motions between which the target switches, the most agile one last; none: it moves by `motion` alone. leaving: the
    probability that it leaves its motion in a step. middle: a point near all agents, the same for all, m. squares:
    whether agents share squared ranges, and linearise what averaging leaves. tells_ranges:
    whether they tell each other their ranges, and each takes in all; seeks: and, while these deny the place, looks for
    the target elsewhere; splits: how it splits hypotheses, of which it keeps several of each motion then (see
    splitting.py), 0: it does not. plane: that they are near, a point of it and its normal; None: near none, or mirror
    images are no matter. outliers: what share of the ranges are too long, and by how much (m) on average, where the
    scenario tells so and a first fix takes it into account.
    options: of a kind of another package, `filter.options`. inversion: how sicf and a first fix invert matrices.
    least: a range below it, m, is none where ranges are squared, as its square is another one's.
    guesses: how many of the agents' guesses of position, and of velocity, are independent; None: a first fix by
    rules before the fourth, see there.
    """

    motion: Motion
    space: Space
    range_std: float
    xi: float
    network_size: int
    omega: float | None = None
    differenced: bool = False
    power: int = 1
    widens: bool = False
    recovers: float = 0.0
    distrusts: bool = False
    returns: bool = False
    says_status: bool = False
    judges_agents: bool = True
    hearing: int = 0
    calls_roll: bool = True
    rounds: int = 0
    reacquires: int = 0
    spreading: int = 1
    bends: bool = False
    prompt: bool = False
    deciding: int = 0
    supposes: bool = False
    rejoins: bool = True
    cut_off: int = 0
    presumes: bool = True
    proves: bool = False
    undetermined: bool = False
    sides: bool = False
    anywhere: tuple[Floats, Floats] | None = None
    bias: str = "none"
    likelihoods: bool = True
    weighs_lasting: bool = False
    weighs_shares: bool = False
    common_bias_std: float = 0.0
    own_bias_std: float = 0.0
    scale_std: float = 0.0
    told_biases: bool = False
    joint_biases: bool = False
    learns_noise: bool = False
    lasting: bool = False
    recorded: bool = False
    doubts_noise: bool = False
    counts_ranges: bool = False
    first_fix: int = 0
    squared_fix: int = 0
    tries_guess: bool = False
    search: tuple[Floats, Floats] | None = None
    models: tuple[Motion, ...] = ()
    leaving: tuple[float, ...] = (0.0,)
    noises: tuple[Motion, ...] = ()
    middle: tuple[float, ...] = (0.0, 0.0, 0.0)
    squares: bool = False
    tells_ranges: bool = False
    seeks: bool = False
    ties: bool = False
    splits: int = 0
    plane: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    outliers: tuple[float, float] | None = None
    guesses: tuple[int, int] | None = (1, 1)
    least: float = -np.inf
    options: Mapping[str, object] = field(default_factory=dict)
    inversion: Inversion = BY_LIBRARY

    @property
    def constants(self) -> int:
        """How many states there are beside those of the motion: biases, or a square."""
        if self.bias != "estimate":
            return int(self.squares)
        return self.network_size if self.joint_biases else 1
