"""A range that was wrong is rather wrong again, and by as much: what a hypothesis makes of the step before."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.outliers import UNTOLD

_AGAIN = 0.1
"""How likely a range is wrong after a wrong one of the same agent: errors may come in bursts, or each by itself."""

_AS_MUCH = 0.5
"""How likely it is wrong by as much, then."""

_MOST = 700.0
"""The largest exponent that is no overflow."""


def judged(likely: Floats, error: Floats, there: Bools, axes: int) -> Floats:
    """What k hypotheses of each of n agents make of m ranges that they have taken in, (n, k, m, 3).

    That is how likely each was wrong, its error, m, and the variance of that, m^2. likely: (2, n, k, m), logarithms of
    how likely a range is that is right, and one that is wrong. error: (2, n, k, m), the innovation and its variance.
    there: (n, 1, m), whether there was a range. axes: of the position.

    Where the place is wrong most ranges seem to be, and the next ones, too, by as much. So a hypothesis has its say
    only if more ranges than axes were right: these prove the place without the others.
    """
    right, wrong = likely
    chance = 1.0 / (1.0 + np.exp(np.clip(right - wrong, -_MOST, _MOST)))
    suspected = there & (wrong > right)
    proved = np.count_nonzero(there & ~suspected, axis=2) > axes
    chance = np.where(suspected & proved[:, :, None], chance, 0.0)
    return np.stack([chance, np.where(there, error[0], 0.0), np.where(there, error[1], 1.0)], axis=3)


def again(likely: tuple[Floats, Floats], error: tuple[Floats, Floats], former: Floats) -> tuple[Floats, Floats]:
    """Logarithms of how likely the agent's next range is right, or wrong, (n, k), after what was judged of its last.

        p' = p + b (.1 - p)                                     b: how likely the last range was wrong
        wrong:  p' ((1 - b/2) w(z) + b/2 N(z - e; 0, S + S_e))  e, S_e: its error, and the variance of that
        right:  (1 - p') N(z; 0, S)

    Errors of radio ranges come from what stands in the way of a signal or delays it, and last as long as that does: a
    chain of two states (Gilbert, Bell System Technical Journal 39(5), 1960). likely: as without the last range, with
    p = .02 and the density w. error: z and S. former: (n, k, 3), see `judged`. Where the last range was none, or right,
    they are as they were.
    """
    (right, wrong), (innovation, variance) = likely, error
    share, (chance, last, spread) = UNTOLD[0], np.moveaxis(former, -1, 0)
    total, known = variance + spread, chance > 0.0
    alike = -0.5 * ((innovation - last) ** 2 / total + np.log(2.0 * np.pi * total))
    suspected = share + chance * (_AGAIN - share)
    part = np.where(known, chance * _AS_MUCH, 0.5)
    drawn = np.logaddexp(np.log1p(-part) + wrong - np.log(share), np.log(part) + alike)
    after = right - np.log1p(-share) + np.log1p(-suspected), np.log(suspected) + drawn
    return np.where(known, after[0], right), np.where(known, after[1], wrong)
