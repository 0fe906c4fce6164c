"""What an estimate is worth, decided without the truth: from ranges that were heard, their fit, and the covariance."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.copying import replace

STATUSES = ("acquiring", "tracking", "coasting", "lost")
"""What a status is called, by the number that travels and that logs hold."""

ACQUIRING, TRACKING, COASTING, LOST = map(float, range(4))

CUT = 9.0
"""Where a NIS is cut off, so that a single outlier does not decide: three standard deviations."""


FAINT = 0.4


def strokes(status: Floats, seconds: Floats, fix: float) -> Floats:
    """How strongly the path of estimates is drawn, (...): 0 before the first fix, FAINT while it is proved, then 1.

    status, seconds: (...), what agents say, NaN of a filter that does not say. fix: how long the first fix takes, s; 0
    where it begins with a guess that was given.
    """
    fixed = seconds >= fix * (1.0 - 1e-9)
    return np.where(status == ACQUIRING, np.where(fixed, FAINT, 0.0), 1.0)


_MEMORY = 120.0
"""How many of the network's ranges the mean NIS remembers."""

_BEGUN = 30.0
"""As if so many ranges had fitted before the first one, so that the first few do not decide."""

_MOST = 0.6 * CUT
"""The mean cut NIS of a lost target: as if six of ten ranges were outliers.

Four of ten make it 4.2, give or take 0.3, of a network that tracks well and must not begin again.
"""

WRONG = 3.6
"""The mean of the smaller of two cut NIS of an agent whose ranges do not fit: as if six of ten were outliers."""


def wrong_among(outliers: float) -> float:
    """WRONG where the scenario tells of a share of outliers: as if six of ten of the other ranges were some, too."""
    return WRONG * (1.0 + outliers * 2.0 / 3.0) ** 2


DOUBT = 2.0
"""What that mean begins with: with some doubt, as a network that has found a wrong place has to notice soon."""

_OWN_MEMORY = 15.0
"""How many of its own ranges an agent remembers."""

_SPARE = 0.6
"""How much of an agent has to be left, on average, beyond as many agents as there are unknowns.

Any place that is fitted to as few agents as there are unknowns fits: only one more proves it.
"""

_COASTS = 2.0
"""By what factor the claimed error has grown, for want of ranges, when the network only coasts."""

_ADRIFT = 20.0
"""By what factor it has grown when a filter may no longer linearise at its estimate."""

_LEARNED = 0.1
"""By how much the claimed error may grow with as many ranges as there are axes: then geometry grows it, not silence."""

_FIRST = 10
"""How many ranges for each axis, five for each unknown, the network hears before it tracks."""

_SCARCE = 5.0
"""After so many steps without enough agents that hear the target the network coasts: it may tell something else in one.
"""

_PROOF = 7
"""How many of each agent: of one whose ranges do not fit, six in a row take its mean from DOUBT to beyond WRONG."""


@dataclass(frozen=True)
class Status:
    """An agent's opinion of its estimate, arrays (n,), and what it rests on.

    which: a number as in STATUSES. seconds: how long it has been so, s. steps: since the start. heard: the network's
    ranges that fitted since the end of the first fix, by the first rules all. misfit, weight: fading sums of how badly
    ranges fit, and of their number. spread: the claimed position error, m. reference: what that was when ranges were
    last enough. own: the agent's own fading mean, and latest: its latest range's cut NIS. unheard: steps since it heard
    the target, and scarce: since enough agents had heard it lately, where agents count those.

        e_i <- fading mean of min(NIS_i, NIS_i of its range before, 9) over the agent's last 15 ranges or so
        A <- fading mean of 9 [e_i > 3.6] over the network's last 120 ranges or so
        r <- min(s, r exp(0.1 (ranges of this step)/axes))       s: root of the trace of the position's covariance

    lost: A > 9 min(0.6, 1 - (unknowns + 0.6)/n), where the agents whose ranges fit are so few that these would fit a
    wrong place, too. coasting: s > 2 r: the covariance has grown, and ranges that would explain it are missing; or for
    some steps fewer agents have heard the target than it has axes; then until as many ranges have fitted as prove a
    first place. Both r and A have no unit of time, so neither dt nor
    how often agents range matters. By the first rules A was the fading mean of min(NIS_i, 9) itself, and the limit
    always 5.4.
    """

    which: Floats
    seconds: Floats
    steps: Floats
    heard: Floats
    misfit: Floats
    weight: Floats
    reference: Floats
    spread: Floats
    own: Floats
    latest: Floats
    unheard: Floats
    scarce: Floats

    @classmethod
    def first(cls, count: int, steps: int = 0, *, proves: bool = False) -> Self:
        """Before the first step of so many agents. steps: how many the network has had without them.

        proves: whether it is of ranges that fit, and not of doubtful ones: few agents have lost by so little doubt.
        """
        none = np.zeros(count)
        known = {"misfit": np.full(count, _BEGUN * (not proves)), "weight": np.full(count, _BEGUN)}
        known |= {"steps": none + steps}
        known |= {"reference": np.full(count, np.inf), "own": np.full(count, DOUBT)}
        return cls(**{one.name: known.get(one.name, none) for one in fields(cls)})

    @property
    def coasts(self) -> Bools:
        """Whether ranges that would explain the claimed error are missing, (n,)."""
        return np.asarray(self.spread > _COASTS * self.reference)

    @property
    def adrift(self) -> Bools:
        """Whether the claimed error has grown so far that a filter may no longer linearise at its estimate, (n,)."""
        return np.asarray(self.spread > _ADRIFT * self.reference)

    def anew(self, rows: Bools, *, fitted: Floats | None = None) -> Self:
        """The same, but that some agents (n,) acquire their target again; ranges that did not fit have to fit first.

        fitted: (n,), so many ranges fit the place where they begin, which counts; None: none do, by earlier rules.
        """
        begun = vars(type(self).first(len(rows), proves=fitted is not None)) | {"own": np.minimum(self.own, WRONG)}
        if fitted is not None:
            begun |= {"heard": fitted, "own": np.full(len(rows), WRONG)}
        kept = {name: getattr(self, name) for name in ("seconds", "steps", "spread", "latest", "unheard", "scarce")}
        return type(self)(**{name: np.where(rows, (begun | kept)[name], values) for name, values in vars(self).items()})

    def judging(self, misfit: Floats, heard: Bools) -> Self:
        """The same, with how badly the ranges of this step fit (n,), cut, where one was heard (n,).

        Of two ranges in a row the one that fits better counts: outliers come singly, a wrong receiver stays wrong.
        """
        own, latest = self.own + (np.minimum(misfit, self.latest) - self.own) / _OWN_MEMORY, misfit
        if (~heard).nonzero()[0].size:
            own, latest = np.where(heard, own, self.own), np.where(heard, latest, self.latest)
        return replace(self, own=own, latest=latest)

    def hearing(self, heard: Bools) -> Self:
        """The same, of agents (n,) that hear the target in this step or do not."""
        return replace(self, unheard=np.where(heard, 0.0, self.unheard + 1.0))

    @property
    def scarcely_heard(self) -> Bools:
        """Whether too few agents have heard the target for so long that it is no longer tracked, (n,)."""
        return np.asarray(self.scarce >= _SCARCE)

    @property
    def wrong(self) -> Bools:
        """Whether an agent's own ranges do not fit, (n,)."""
        return np.asarray(self.own > WRONG)

    def told(self, rows: Bools, which: float | Floats, former: Self, dt: float) -> Self:
        """The same, but that some agents (n,) say something else. former: the status a step of dt (s) ago."""
        said = np.where(rows, which, self.which)
        return replace(self, which=said, seconds=np.where(said == former.which, former.seconds + dt, 0.0))

    def after(
        self,
        *,
        heard: Floats,
        misfit: Floats,
        spread: Floats,
        axes: int,
        fix: int,
        dt: float,
        most: float | Floats | None = None,
        agents: int = 0,
        enough: Bools | None = None,
        whole: bool = False,
        proves: bool = False,
    ) -> Self:
        """A step of dt (s) later.

        heard, misfit: (n,), how many ranges the network had, and the sum of what tells how badly each fits. spread:
        (n,), m, the claimed position error. fix: how many steps the first fix takes. most: the mean misfit, (n,), of a
        network that has lost its target; None: by the first rules, where misfit is of ranges and not of agents.
        agents: how many have to prove the place, each with ranges of its own; 0: any ranges do.
        enough: (n,), whether enough agents have heard the target lately; None: agents do not count them.
        whole: whether ranges of a step prove nothing of which as many do not fit as those of a lost target.
        proves: whether a place that was lost before it was proved has to be proved, too.
        """
        reference = np.minimum(spread, self.reference * np.exp(_LEARNED * heard / axes))
        steps = self.steps + 1.0
        early = steps <= fix
        heard = np.where(early, 0.0, heard)
        fades = np.exp(heard / -_MEMORY)
        fitted, scarce = self.heard + _fits(heard, misfit, most, whole=whole), self.scarce
        if enough is not None:
            scarce = np.where(enough, 0.0, scarce + 1.0)
            fitted = np.where(scarce < _SCARCE, fitted, 0.0)
        sums = fades * self.misfit + np.minimum(misfit, CUT * heard), fades * self.weight + heard
        lost = sums[0] > (_MOST if most is None else most) * sums[1]
        which, seconds = np.array([TRACKING]).repeat(len(heard)), self.seconds + dt
        proved = fitted >= proof(axes, agents)
        which[spread > _COASTS * reference] = COASTING
        if enough is not None:
            which[(scarce >= _SCARCE) | (self.which == COASTING) & ~proved] = COASTING
        which[lost] = LOST
        begins = (self.which == ACQUIRING) | (proves & (self.which == LOST))
        which[begins & ~proved & ((most is None) | ~lost) | early] = ACQUIRING
        seconds[which != self.which] = 0.0
        return type(self)(
            *(which, seconds, steps, fitted, *sums, reference, spread),
            *(self.own, self.latest, self.unheard, scarce),
        )


def _fits(heard: Floats, misfit: Floats, most: float | Floats | None, *, whole: bool) -> Floats:
    """How many ranges of a step fit, (n,); see `Status.after`."""
    if most is None:
        return heard
    fits = heard - np.minimum(misfit / CUT, heard)
    return np.where(misfit > most * heard, 0.0, fits) if whole else fits


def proof(axes: int, agents: int) -> int:
    """How many ranges have to fit that prove a place, of so many agents; 0: of any."""
    return max(_FIRST * axes, _PROOF * agents)


def most_misfit(unknowns: int, agents: float | Floats) -> Floats:
    """The mean misfit of a network that has lost its target, where agents tell whether their ranges fit.

    unknowns: what is fitted to the ranges of a moment: coordinates, and a bias that all ranges share.
    """
    spare = np.minimum(_MOST, CUT * (1.0 - (unknowns + _SPARE) / np.maximum(agents, 1.0)))
    return np.where(unknowns < np.asarray(agents), spare, _MOST)


def status_name(number: float | None) -> str | None:
    """What a status is called that came from another process; None where it is none."""
    return dict(enumerate(STATUSES)).get(-1 if number is None or not number.is_integer() else int(number))
