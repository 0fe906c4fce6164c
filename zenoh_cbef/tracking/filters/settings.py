"""The settings from which a filter is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.filters.damping import Damping
from zenoh_cbef.tracking.linalg import BY_LIBRARY, Inversion
from zenoh_cbef.tracking.mirroring import Plane
from zenoh_cbef.tracking.motion import BesideConstants, Motion
from zenoh_cbef.tracking.outliers import Errors
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.switching import Switching

UNLIKELY = 4.0
"""How many of its prior standard deviations a bias is off that explains nothing."""


@dataclass(frozen=True)
class FilterSettings:
    """What any filter may need to know: network, motion, ranges, biases, the first fix, and what the estimate is."""

    motion: Motion
    space: Space
    range_std: float
    """Noise of ranges, m; where agents learn it, what they begin with."""
    xi: float
    """Where ranges saturate, in the units of the filter's kind."""

    # The network, and the filter's kind.
    network_size: int
    """How many agents there are; 1 where they exchange nothing."""
    omega: float | None = None
    """What `hcmci` multiplies averaged measurements by; None: network_size."""
    rounds: int = 0
    """Of a step."""
    differenced: bool = False
    """Whether `ci` and `local` take in differences of ranges in place of the agent's own range."""
    options: Mapping[str, object] = field(default_factory=dict)
    """Of a kind of another package, `filter.options`."""
    inversion: Inversion = BY_LIBRARY
    """How `sicf` and a first fix invert matrices."""
    returns: bool = False
    """Whether an agent's range counts less after a step in which it heard no neighbour."""
    curves: bool = False
    """Whether what linearising a range leaves out counts with its noise (see `Curving`)."""
    cut_off: int = 0
    """The rounds of a step, where agents may be cut off from others and tell who is there; 0: they do not."""
    tells_ranges: bool = False
    """Whether agents tell each other their ranges, and each takes in all."""
    squares: bool = False
    """Whether agents share squared ranges, and linearise what averaging leaves."""
    middle: tuple[float, ...] = (0.0, 0.0, 0.0)
    """A point near all agents, the same for all, m."""
    plane: Plane | None = None
    """A point of the plane that agents are near, and its normal; None: near none, or mirror images are no matter."""
    crosses: bool = False
    """Whether target and mirror image are told apart anew where the target crosses that plane, and by more ranges."""
    blends: bool = False
    """Whether a mirror image that ranges deny begins anew, and one place that may be two is their mixture."""

    # How the target moves.
    models: tuple[Motion, ...] = ()
    """The motions between which the target switches, the most agile one last; none: it moves by `motion` alone."""
    leaving: tuple[float, ...] = (0.0,)
    """Probabilities, of which ranges choose, that the target leaves its motion in a step."""
    noises: tuple[Motion, ...] = ()
    """The motion with the noises of which ranges choose; none: its noise is not in doubt."""
    nearer: bool = False
    """Whether a noise rather changes a little."""
    unseen: bool = False
    """Whether what agents claim allows for a turn that ranges do not show yet."""
    ties: bool = False
    """Whether steps may be so long that a target which turns is anywhere after one (see tying.py)."""
    exact: bool = False
    """Whether agents that tell each other their ranges count errors of wrong ones from the distance (see branching.py).
    """
    adds: bool = False
    """Whether they count biases as what these add to distances, not to their squares (see branching.py)."""
    persists: bool = False
    """Whether they take a range that was wrong for rather wrong again, and by as much (see persisting.py)."""
    agrees: bool = False
    """Whether agents that tell each other their ranges agree on their guesses before they predict them."""
    fits: bool = False
    """Whether a range that the network's estimate denies makes the next one count for less, see `Fitting`."""
    splits: int = 0
    """How agents that tell their ranges split hypotheses, of which they keep several of each motion (see splitting.py);
    0: they do not."""
    settled: bool = False
    """Whether an axis decides which way they are split of several directions in which as little is known."""

    # Errors of ranges.
    power: int = 1
    """Of the saturation."""
    widens: float = 0.0
    """How far a saturated range widens its whole innovation, not its noise alone: from 0 to 1."""
    least: float = -np.inf
    """A range below it, m, is none where ranges are squared, as its square is another one's."""
    outliers: tuple[float, float] | None = None
    """What share of the ranges are too long, and by how much (m) on average, where the scenario tells so."""
    weighed: Errors | None = None
    """The same, where these decide what a range counts for, in place of the saturation."""
    distrusts: bool = False
    """Whether agents give their own implausible ranges less weight."""
    recovers: float = 0.0
    """From which share of implausible innovations on the network widens its covariances; 0: never."""
    sudden: int = 0
    """In how many steps each agent has a range, where most innovations show that the target suddenly moves otherwise
    (see `Sudden`); 0: they are not asked."""
    learns_noise: bool = False
    """Whether agents learn the noise of ranges."""
    wrong_share: float = 0.0
    """Of what share of the ranges they do not, as these are outliers."""
    doubts_noise: bool = False
    """Whether range_std may be wrong by a factor of two."""
    counts_ranges: bool = False
    """Whether the network counts the ranges that say so, and weighs lasting errors with all that an estimate keeps."""
    lasting: bool = False
    """Whether errors of successive ranges may be alike."""
    recorded: bool = False
    """Whether such errors widen what agents claim, and not the noise by which they weigh ranges, and a bias is believed
    also for the share of the misfit that it explains."""

    # Biases of ranges.
    bias: str = "none"
    """`none`, `estimate` or `auto`."""
    joint_biases: bool = False
    """Whether agents estimate all biases together."""
    common_bias_std: float = 0.0
    """Prior of what all biases have in common, m."""
    own_bias_std: float = 0.0
    """Prior of an agent's own part, m."""
    scale_std: float = 0.0
    """Prior of the share by which all ranges may be too long, besides joint biases; 0: they are not."""
    told_biases: bool = False
    """Whether biases are constant, and as large as told: a first fix says what it knows of them, and none fades."""
    whole_biases: bool = False
    """Whether a first fix tells of common biases beside the state, and a wider state is no tie to biases."""
    likelihoods: bool = True
    """Whether `auto` weighs a bias by these, or by the NIS."""
    weighs_lasting: bool = False
    """Whether `auto` asks for more, the less alike successive errors are."""
    weighs_shares: bool = False
    """Whether it weighs a share by which all ranges are too long so, too."""
    presumes_biases: bool = False
    """Whether it presumes a bias where errors do not last, and believes what these cannot gain (see `Evidence`)."""
    opens_biases: bool = False
    """Whether it claims a mixture of both until it is known whether errors last."""
    most_bias: float = np.inf
    """From what size on a bias is beyond belief, m, so that another fix forgets all."""

    # The first fix, by least squares on the first ranges.
    first_fix: int = 0
    """Over how many steps it improves the initial estimate, a guess; 0: there is none."""
    joins_fix: bool = False
    """Whether an agent that begins anew joins a fix that is under way, and a group counts the ranges of one once."""
    squared_fix: int = 0
    """How many of these steps are on squared ranges."""
    search: tuple[Floats, Floats] | None = None
    """Where squared ranges look for the target, state (1, s) and covariance (1, s, s); None: around the guess."""
    tries_guess: bool = False
    """Whether the guess is tried before the network searches."""
    guesses: tuple[int, int] | None = (1, 1)
    """How many of the agents' guesses of position, and of velocity, are independent; None: by rules before the
    fourth, see first_fix.py."""
    guessed: tuple[float, float] | None = None
    """What the mean of all guesses is worth: standard deviations, m and m/s; None: a side need not be proved."""

    # What the estimate is, and other fixes.
    says_status: bool = False
    """Whether agents say if they acquire, track, coast, or have lost the target."""
    judges_agents: bool = True
    """Whether that counts agents that do not fit, or ranges, and only those that hear ranges vote for another fix."""
    alone_bend: float | None = None
    """How many times the variance of its bend an agent's range has more while no other hears the agent; few agents that
    coast do not track again then. None: it is like one of few, and these may track."""
    presumes: bool = True
    """Whether agents presume that ranges fit and that all others are there until they know better."""
    proves: bool = False
    """Whether ranges that fit another fix prove it, and a target that was lost needs proof as one never found."""
    hearing: int = 0
    """For how many steps after a range an agent counts as one that hears the target; 0: agents do not count those."""
    calls_roll: bool = True
    """Whether they count them by a number for each, or by one alone."""
    hearers_count: bool = False
    """Whether those alone make up a plane and judge a place, and ranges count less where they are too few."""
    compares: bool = False
    """Whether agents that tell each other their ranges track only where they predict what the others do."""
    undetermined: bool = False
    """Whether the agents' places leave open where the target is, so that they never say that they track it."""
    sides: bool = False
    """Whether agents say so when they do not know on which side of them the target is."""
    drifts: bool = True
    """Whether agents that have coasted too far begin another fix."""
    awaits: bool = False
    """Whether another fix after coasting waits for ranges that came meanwhile."""
    bends: bool = False
    """Whether agents coast no further than ranges are straight lines. Not where the target turns among ranges that may
    be wrong: an estimate is unsure there for some steps, though no range is missing.
    """
    damping: Damping | None = None
    """Of the corrections of a fix; None: they are as large as ranges ask for."""
    reacquires: int = 0
    """How many steps another fix takes; 0: there is none."""
    anywhere: tuple[Floats, Floats] | None = None
    """Where another fix looks for the target, as `search`."""
    spreading: int = 1
    """In how many steps all agents know a decision."""
    deciding: int = 0
    """Every how many steps agents decide whether another fix begins; 0: as many as it takes."""
    prompt: bool = False
    """Whether another fix begins soon after the target is lost, and has the first ranges after a silence to itself."""
    seeks: bool = False
    """Whether agents that tell their ranges look for the target elsewhere while these deny the place."""
    supposes: bool = False
    """Whether all tell each other what they measured where ranges of one do not fit."""
    rejoins: bool = True
    """Whether one that is wrong takes part again after two ranges that fit, or after many."""

    @property
    def switching(self) -> Switching:
        """Between which motions the target switches, or noises, and how."""
        motions = self.models or self.noises or (self.motion,)
        if self.models and self.joint_biases:
            biases = self.network_size, self.own_bias_std, self.common_bias_std
            motions = tuple(BesideConstants(one, *biases) for one in motions)
        return Switching(motions, self.leaving, nearer=self.nearer, unseen=self.unseen)

    @property
    def silence(self) -> int:
        """After how many steps without a range an agent no longer hears the target: three intervals; 0: never."""
        return 3 * self.sudden

    @property
    def proves_sides(self) -> bool:
        """Whether the side of a plane has to be proved, by guesses at first and by ranges later."""
        return self.guessed is not None

    @property
    def constants(self) -> int:
        """How many states there are beside those of the motion: biases, or a square."""
        if self.bias != "estimate":
            return int(self.squares)
        return self.network_size if self.joint_biases else 1
