"""An agent that crashes while the network looks for its first fix joins that fix when it comes back."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters import Belief
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.tried_guess import TriedGuess
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.status import TRACKING

FAR = "filter.initial_position=[50,0,0]"


def crash(agents, since, until):
    return f"fault=[{{kind='crash',agents={agents},from={since},until={until}}}]"


def traces(*overrides, seeds=4, steps=40):
    return simulate(
        [load("tracking", [*overrides, f"steps={steps}", f"seed={1001 + i}"]).scenario for i in range(seeds)]
    )


def errors(trace):
    return np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)


@pytest.mark.parametrize("until", [0.35, 0.5, 1.5])
def test_it_finds_the_target_with_the_others_however_far_off_the_guess(until):
    for trace in traces(FAR, crash([1, 4], 0.15, until)):
        assert errors(trace)[:, 20:].max() < 0.2


def test_by_earlier_rules_nobody_made_a_fix_then():
    fault = crash([1, 4], 0.15, 1.5)
    assert Plan(load("tracking", [FAR, fault]).scenario).first_fix_steps == 20
    assert Plan(load("tracking", [FAR, fault, "filter.defaults=15"]).scenario).first_fix_steps == 0
    assert min(errors(trace)[:, 20:].max() for trace in traces(FAR, fault, "filter.defaults=15")) > 1.0


def test_agents_that_come_back_object_to_a_place_that_is_wrong():
    """One of six was alone for a second; the fix that the others join is wrong, and their ranges tell so."""
    found = traces("filter.initial_position=[-8,8,2]", crash([1, 2, 3, 4, 5], 0.5, 1.5), seeds=8, steps=50)
    lost = [errors(trace) > 3.0 for trace in found]
    assert any(one[:, 20:].any() for one in lost)
    for trace, one in zip(found, lost, strict=True):
        assert not (one & (trace.diagnostics.status == TRACKING)).any()


@pytest.mark.parametrize("kind", [FirstFix, TriedGuess])
def test_a_fix_that_forgets_says_the_same_whatever_was_measured_before(kind):
    motion, count = NearlyConstantVelocity(0.1, 0.3, 3), 2
    search = np.zeros((1, 6)), 900.0 * np.eye(6)[None]
    fix = kind(None, motion, Space(), 0.1, 0.0, count, 20, 40, xi=2.0, squared=1, search=search)
    places = np.array([[0.0, 0, 0], [9.0, 1, 2]])

    def payload(before, *, forgets):
        belief = Belief(np.ones((count, 6)), np.tile(np.eye(6), (count, 1, 1)))
        for step, length in enumerate((before, before + 0.1), 1):
            heard = Measurement(places, np.full(count, length), np.zeros(count), *no_neighbours(count), step=step)
            update = fix.update(belief, heard)
            # The same iterate, whatever was measured.
            belief = replace(fix.conclude(update.payload, update), state=belief.state, covariance=belief.covariance)
            belief = replace(belief, memory=(*belief.memory[:5], np.zeros_like(belief.state), *belief.memory[6:]))
        nothing = replace(heard, range=np.full(count, np.nan), step=3, forgets=forgets)
        return fix.update(belief, nothing).payload

    np.testing.assert_array_equal(payload(5.0, forgets=True), payload(7.0, forgets=True))
    assert (payload(5.0, forgets=False) != payload(7.0, forgets=False)).any()


def test_agents_may_begin_anew_in_all_steps_but_those_of_a_fix_that_they_cannot_join():
    assert Plan(load("tracking", [FAR]).scenario).closed_steps == 0
    assert Plan(load("tracking", [FAR, "filter.defaults=15"]).scenario).closed_steps == 20
