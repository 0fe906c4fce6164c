"""What a run's trace holds and what it lacks, in stretches of steps and in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zenoh_cbef.arrays import Bools
from zenoh_cbef.trace import Trace


def stretches(there: Bools) -> list[list[int]]:
    """First and last step of each stretch in which something is there, (K,), steps from 1."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], there, [False]]).astype(np.int8)))
    return [[int(first) + 1, int(last)] for first, last in zip(edges[::2], edges[1::2], strict=True)]


def estimated_steps(trace: Trace) -> Bools:
    """Steps of which some agent's estimate is there, (K,)."""
    return np.asarray(np.isfinite(trace.estimates).all(axis=2).any(axis=0))


def truth_steps(trace: Trace) -> Bools:
    """Steps of which the truth is known, (K,)."""
    return np.asarray(np.isfinite(trace.truth).all(axis=1))


def lacks(trace: Trace) -> list[str]:
    """Sentences that say what the trace lacks of its run, and what is therefore not scored; none for a whole run.

    Data that the run itself did not have does not count: of an agent that the scenario has away, or a silent receiver.
    """
    return [
        said for said in (_agents(trace), _steps(trace), _truth(trace), _measurements(trace), _events(trace)) if said
    ]


def why_no_nees(trace: Trace) -> str:
    """Why a run has no NEES."""
    if not np.isfinite(trace.covariances).any():
        return "the filter has no covariance"
    scored = np.isfinite(trace.estimates).all(axis=2) & truth_steps(trace)
    return "no scored step" if scored.any() else "the truth is not known"


def why_no_nis(trace: Trace) -> str:
    """Why a run has no NIS."""
    if not np.isfinite(trace.covariances).any():
        return "the filter has no covariance"
    return "no scored step" if np.isfinite(trace.diagnostics.nis).any() else "nothing was measured"


def _agents(trace: Trace) -> str:
    silent = np.flatnonzero(~np.isfinite(trace.estimates).any(axis=(1, 2))).tolist()
    if not silent:
        return ""
    who = "it is" if len(silent) == 1 else "they are"
    return f"no estimate of {_named('agent', silent)} is there: {who} not scored"


def _steps(trace: Trace) -> str:
    missing = ~estimated_steps(trace)
    return f"no estimate of {spelt(stretches(missing))} is there: they are not scored" if missing.any() else ""


def _truth(trace: Trace) -> str:
    known = truth_steps(trace)
    needed = estimated_steps(trace) & ~known
    if not needed.any():
        return ""
    if not known.any():
        return "the truth is not known: there are no errors, no NEES and no bound"
    return f"the truth is not known in {spelt(stretches(needed))}: errors, NEES and bound are those of the other steps"


def _measurements(trace: Trace) -> str:
    if trace.unlogged is None or not trace.unlogged.any():
        return ""
    agents = np.flatnonzero(trace.unlogged.any(axis=1)).tolist()
    of = "" if len(agents) == len(trace.unlogged) else f" of {_named('agent', agents)}"
    steps = np.asarray(trace.unlogged.any(axis=0))
    said = f"beacons{of} in {spelt(stretches(steps))} are not in the log, so there is no centralised filter"
    return f"{said} and no bound" + (f" beyond step {trace.measured_steps}" if trace.measured_steps else "")


def _events(trace: Trace) -> str:
    if trace.told:
        return ""
    return "no event is in the log: what processes reported, as of slowness or silence, is not known"


def _named(what: str, numbers: Sequence[int]) -> str:
    return f"{what}{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"


def spelt(found: Sequence[Sequence[int]]) -> str:
    """Stretches of steps in words, the first few of many."""
    parts = [f"{first}" if first == last else f"{first} to {last}" for first, last in found[:3]]
    more = f" and {len(found) - 3} more stretches" if len(found) > 3 else ""
    single = len(found) == 1 and found[0][0] == found[0][1]
    return f"{'step' if single else 'steps'} {', '.join(parts)}{more}"


def unseen_note(unseen: Sequence[Sequence[int]]) -> str:
    """A note for the reader on steps in which ranges did not determine the position; empty where there are none."""
    why = "ranges did not determine the position, as too few agents had any, or all were on a line"
    return f"in {spelt(unseen)} {why}: estimates there are guesses" if unseen else ""
