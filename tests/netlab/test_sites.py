"""Two sites with a router each: links, and a cut between the sites, as the benchmark `sites` measures them."""

import numpy as np

from benchmarks.sites import CALM_STEPS, REALTIME, SETTINGS, SITES, beyond, figures, observe
from zenoh_cbef.log.read.trace import read_trace
from zenoh_cbef.protocol.slow import SLOW
from zenoh_cbef.trace import Trace

CLOSE = 1.0
"""m: ten times the position error of undisturbed runs."""
LONGER = "dt=0.4"
"""A busy machine needs the half, and the run lasts until long after the cut's end."""


def came_between_sites(trace: Trace, steps: slice) -> list[int]:
    """How many messages came over each link between the sites in these steps, in time or late."""
    between = [
        (one in SITES[0]) != (two in SITES[0])
        for one, two in zip(trace.links.source, trace.links.destination, strict=True)
    ]
    assert trace.passing is not None
    inside = np.isin(trace.passing.until, np.arange(trace.estimates.shape[1])[steps])
    counts = trace.passing.counts[between][:, inside]
    return [int(one) for one in np.nansum(counts[:, :, [0, 2]], axis=(1, 2))]


def test_each_site_goes_on_while_they_are_cut_apart_and_they_agree_again(tmp_path):
    seen = observe([*SETTINGS, *REALTIME, LONGER], tmp_path, cut=True)
    assert set(beyond(seen.links).values()) == {1}  # to the router; none to an agent of the other site
    found, trace = figures(seen), read_trace(seen.log)
    end = slice(found.healed - CALM_STEPS // 2, found.healed)
    assert max(came_between_sites(trace, end)) == 0
    assert min(came_between_sites(trace, slice(-CALM_STEPS, None))) > 0
    if any(event["kind"] == SLOW for event in trace.events):
        return  # where rounds come too late sites are meters apart without a cut, too
    assert np.median(found.error[0, found.cut : found.healed]) < CLOSE
    # Site 2 has no ranges meanwhile: it predicts, and its agents agree the better for it.
    assert np.median(found.within[1, end]) < 0.1 * CLOSE
    assert np.median(found.apart[end]) > np.median(found.apart[-CALM_STEPS:])
    assert found.agreed is not None
    assert np.median(found.apart[-CALM_STEPS:]) < CLOSE
    assert np.median(found.error[1, -CALM_STEPS:]) < CLOSE
