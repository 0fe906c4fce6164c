"""Two sites with a router each: links, and a cut between the sites, as the benchmark `sites` measures them."""

import numpy as np

from benchmarks.sites import CALM_STEPS, REALTIME, SETTINGS, beyond, figures, observe

CLOSE = 1.0
"""m: ten times the position error of undisturbed runs."""


def test_each_site_goes_on_while_they_are_cut_apart_and_they_agree_again(tmp_path):
    seen = observe([*SETTINGS, *REALTIME], tmp_path, cut=True)
    assert set(beyond(seen.links).values()) == {1}  # to the router; none to an agent of the other site
    found = figures(seen)
    end = slice(found.healed - CALM_STEPS, found.healed)
    assert np.median(found.error[0, found.cut : found.healed]) < CLOSE
    # Site 2 has no ranges meanwhile: it predicts, and its agents agree the better for it.
    assert np.median(found.within[1, end]) < 0.1 * CLOSE
    assert np.median(found.apart[end]) > np.median(found.apart[-CALM_STEPS:])
    assert found.agreed is not None
    assert np.median(found.apart[-CALM_STEPS:]) < CLOSE
    assert np.median(found.error[1, -CALM_STEPS:]) < CLOSE
