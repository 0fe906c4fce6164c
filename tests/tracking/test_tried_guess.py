"""A network with a guess tries it before it searches: ranges that are wrong untold do not mislead it."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.filters import Belief, FilterSettings, make_filter
from zenoh_cbef.tracking.filters.finding.first_fix import FirstFix
from zenoh_cbef.tracking.filters.finding.tried_guess import TriedGuess
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours

WRONG = "filter.initial_position=[20, 0, 0]"


def traces(*overrides, wrong=None, seeds=8, steps=40):
    """Runs of `tracking` whose ranges are off by wrong(rng, shape), without the scenario telling so."""
    runs = [load("tracking", [*overrides, f"steps={steps}", f"seed={1001 + seed}"]).scenario for seed in range(seeds)]
    heard = [heard_in(Plan(run), make_world(run)) for run in runs]
    if wrong is not None:
        errors = [
            wrong(np.random.default_rng(run.seed), one.ranges.shape) for run, one in zip(runs, heard, strict=True)
        ]
        heard = [Heard(one.positions, one.ranges + off, one.age) for one, off in zip(heard, errors, strict=True)]
    return simulate(runs, heard=heard)


def last_errors(*overrides, **how):
    """Distances from the target in the last step, the worst agent's, (seeds,), m."""
    found = traces(*overrides, **how)
    return np.array([np.linalg.norm((one.estimates[:, -1] - one.truth[-1])[:, :3], axis=1).max() for one in found])


def many(rng, shape):
    """Two of five ranges 30 m too long."""
    return 30.0 * (rng.random(shape) < 0.4)


def liar(rng, shape):
    """All ranges of one agent 5 m too long."""
    return 5.0 * (np.arange(shape[0]) == rng.integers(shape[0]))[:, None] * np.ones(shape)


def test_wrong_ranges_that_no_scenario_tells_of_do_not_mislead_the_first_fix():
    assert last_errors(wrong=many).max() < 0.5
    assert np.median(last_errors("filter.defaults=2", wrong=many)) > 5.0


def test_one_agent_whose_ranges_are_all_wrong_does_not_carry_the_others_away():
    now, before = (last_errors(more, wrong=liar) for more in ("filter.defaults=3", "filter.defaults=2"))
    assert now.max() < 0.3
    assert before.max() > 1.0


@pytest.mark.parametrize("guess", [WRONG, "filter.initial_position=[-100, 40, 0]"])
def test_a_network_whose_guess_fails_searches(guess):
    assert last_errors(guess, seeds=20).max() < 1.0


def test_a_wrong_guess_and_wrong_ranges_at_once():
    assert last_errors(WRONG, "sensor.outlier_probability=0.2", seeds=20).max() < 1.0


def test_a_runs_bits_do_not_depend_on_the_runs_beside_it():
    together, alone = traces(WRONG, seeds=3, steps=25), traces(WRONG, seeds=1, steps=25)
    np.testing.assert_array_equal(together[0].estimates, alone[0].estimates)
    np.testing.assert_array_equal(together[0].covariances, alone[0].covariances)


def settings(**other):
    motion, found = NearlyConstantVelocity(0.1, 0.1), {"first_fix": 20, "squared_fix": 1, "tries_guess": True, **other}
    search = np.zeros((1, 6)), np.diag([1e4] * 3 + [1.0] * 3)[None]
    return FilterSettings(motion, Space(), 0.1, 2.0, 6, search=search, **found)


def guessing(ranges, **other):
    """The last update, and what one of six agents at the origin believes, of a target that its guess has 10 m away."""
    filter_ = make_filter("sicf", settings(**other))
    belief = Belief(np.array([[10.0, 0, 0, 0, 0, 0]]), np.diag([1.0] * 3 + [1e-4] * 3)[None])
    for range_ in ranges:
        own = Measurement(np.zeros((1, 3)), np.array([range_]), np.zeros(1), *no_neighbours(1))
        update = filter_.update(belief, own)
        belief = filter_.conclude(update.payload, update)
    return update, belief


def asked(ranges, **other):
    """What that agent says in step 4."""
    return guessing(ranges, **other)[0].payload[0]


@pytest.mark.parametrize(("first", "forgotten"), [(np.nan, False), (10.0, False), (90.0, True)])
def test_a_guess_is_forgotten_where_ranges_deny_it_and_not_for_want_of_them(first, forgotten):
    _, belief = guessing([first] * 6)
    # Nothing is heard of what is across the line of sight: a metre by the guess, a hundred without it.
    across = np.sqrt(belief.known_covariance[0, [1, 2], [1, 2]])
    np.testing.assert_allclose(across, 100.0 if forgotten else 1.0, rtol=0.01)


def test_agents_say_whether_their_ranges_fit():
    enough = 0.5 * 3.5 / 6
    for ranges, share in (([10.0, 10.1, 9.9, 10.0], 1 - enough), ([90.0, 10, 90, 90], 1 - enough), ([np.nan] * 4, 0.0)):
        assert asked(ranges)[0] == pytest.approx(share)
        # By earlier rules they said nothing else.
        payload = asked(ranges, guesses=None)
        assert payload[0] == pytest.approx(share)
        assert not payload[1:].any()


def test_while_agents_ask_the_newest_ranges_count():
    payload = asked([10.0, 10.1, 9.9, 10.05])
    # Along x, where the target is: the precision of a range, and that times how much farther off it is.
    assert payload[4] == pytest.approx(1.0 / 0.1**2)
    assert payload[1] > 0.0
    assert not payload[[2, 3, 5, 6, 7, 8, 9]].any()
    assert not payload[10:].any()
    assert not asked([10.0, 10.1, 9.9, np.nan])[1:].any()


@pytest.mark.parametrize(
    ("xi", "tries", "kind"), [(2.0, True, TriedGuess), (2.0, False, FirstFix), (np.inf, True, FirstFix)]
)
def test_a_guess_is_tried_by_filters_that_saturate(xi, tries, kind):
    chosen = settings(tries_guess=tries)
    made = make_filter("sicf" if np.isfinite(xi) else "icf", chosen)
    assert type(made) is kind


@pytest.mark.parametrize(
    ("kept", "tries"),
    [("filter.start=auto", True), ("filter.defaults=2", False), ("filter.initial_position_std=50", False)],
)
def test_a_guess_is_tried_where_ranges_are_straight_over_its_deviation(kept, tries):
    assert Plan(load("tracking", [kept]).scenario).settings.tries_guess is tries
