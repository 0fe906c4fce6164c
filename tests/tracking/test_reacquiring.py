"""A network that was silent, or holds on to a wrong place, finds its target again within seconds of ranges."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.build import batch_tracker
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import Heard, heard_in, simulate
from zenoh_cbef.tracking.ranging import Measurement, no_neighbours
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, TRACKING


def runs(*keys: str, seeds: int = 6, steps: int = 400):
    one = load("tracking", [f"steps={steps}", *keys]).scenario
    return simulate([one.changed(seed=1001 + more) for more in range(seeds)])


def errors(trace):
    """Root mean square of the agents' position errors by step, (K,)."""
    return np.sqrt(np.mean(np.sum((trace.estimates - trace.truth)[:, :, :3] ** 2, axis=2), axis=0))


def silence(since: float, until: float) -> str:
    return f'fault=[{{kind="sensor-dropout",probability=1.0,from={since},until={until}}}]'


ALONE = "filter.linearise=before"
"""Agents do not tell each other their ranges, as few do where receivers may fall silent: these need no other fix."""


@pytest.mark.slow
def test_after_a_long_silence_the_target_is_tracked_within_seconds_of_ranges():
    quiet = silence(4.0, 20.0)
    keys = (), (ALONE,), (ALONE, "filter.reacquire=false")
    told, found, before = (runs(quiet, *more, steps=250) for more in keys)
    for trace in told:
        status = trace.diagnostics.status
        assert (status[:, 100:199] == COASTING).all()
        assert (status[:, 230:] == TRACKING).all(), "within 3 s"
        assert errors(trace)[230:].max() < 1.0
    for trace in found:
        assert (trace.diagnostics.status[:, 235:] == TRACKING).all(), "within 3.5 s"
    # The filter alone takes its first ranges at a wrong place.
    late = [np.max([errors(trace)[230:].max() for trace in traces]) for traces in (told, found, before)]
    assert max(late[:2]) < 0.5 * late[2]


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, 13])
def test_in_a_silence_a_target_that_turns_is_predicted_by_its_motions_and_no_fix_forgets_them(count):
    keys = "target.motion=circle", "target.radius=5", "target.period=8", silence(8.0, 13.0), f"agents.count={count}"
    before, now = (runs(*keys, f"filter.defaults={rules}", seeds=1, steps=160) for rules in (15, 16))
    for old, new in zip(before, now, strict=True):
        assert errors(new)[80:130].max() < min(4.0, 0.5 * errors(old)[80:130].max())
        assert (new.diagnostics.status[:, 90:130] == COASTING).all()
        # A first fix takes two seconds, and no agent says that it tracks while it is off.
        assert errors(new)[152:].max() < 0.5
        assert (new.diagnostics.status[0, 80:][errors(new)[80:] > 1.0] != TRACKING).all()


@pytest.mark.slow
def test_a_network_that_holds_on_to_a_wrong_place_begins_again():
    # By later rules ranges show that the acceleration is wrong, too.
    start = "filter.start=given", "filter.initial_position=[30,-30,10]"
    wrong = *start, "filter.acceleration_std=0.01", "filter.defaults=12"
    held, found = runs(*wrong, "filter.reacquire=false", steps=150), runs(*wrong, steps=150)
    assert np.median([errors(trace)[100] for trace in held]) > 1.0
    for trace in found:
        far = errors(trace) > 5.0
        assert (trace.diagnostics.status[0, far] != TRACKING).all(), "it has not been proved"
        assert trace.diagnostics.status[0, 100] == TRACKING
        assert errors(trace)[85:100].max() < 1.0


@pytest.mark.slow
def test_only_agents_that_hear_ranges_vote():
    deaf = 'fault=[{kind="sensor-dropout",probability=1.0,agents=[4,5,6,7,8,9]},'
    quiet = deaf + '{kind="sensor-dropout",probability=1.0,from=8.0,until=28.0}]'
    # By later rules few hearers are `acquiring` for as long as they may be on either side of their plane, too.
    keys = quiet, "agents.count=10", "dt=0.2", ALONE, "filter.defaults=15"
    found, before = (runs(*keys, f"filter.status_rules={rules}", seeds=3, steps=185) for rules in (2, 1))
    for trace in found:
        assert (trace.diagnostics.status[:, 140:180] == ACQUIRING).any(axis=1).all()
    for trace in before:
        assert (trace.diagnostics.status[:, 60:] != ACQUIRING).all(), "four of ten are no majority"


@pytest.mark.slow
def test_a_silence_that_the_filter_bridges_is_no_reason_for_another_fix():
    brief = silence(5.0, 7.0), ALONE
    for one, other in zip(runs(*brief, steps=100), runs(*brief, "filter.reacquire=false", steps=100), strict=True):
        assert (one.diagnostics.status[:, 50:] != ACQUIRING).all()
        np.testing.assert_allclose(one.estimates, other.estimates, atol=1e-9)


def test_an_agent_that_was_cut_off_does_not_make_the_others_begin_again():
    [trace] = runs('fault=[{kind="partition",links="agent:0",from=5.0,until=25.0}]', seeds=1, steps=300)
    status = trace.diagnostics.status
    assert (status[1:, 30:] == TRACKING).all()
    assert (status[0, 100:249] == COASTING).all()
    assert (status[0, 280:] == TRACKING).all()


BIASED = ("sensor.bias=0.3", "filter.bias=estimate")


def test_steps_that_no_caller_tells_are_counted():
    """Of ten silences each begins at another place of the window of ten steps, after which agents decide."""
    one = load("tracking", ["steps=70", "agents.count=4", "dt=0.2", "filter.initial_position_std=3.0"]).scenario
    plans = [Plan(one.changed(seed=seed)) for seed in range(1, 11)]
    heard = [heard_in(plan, make_world(plan.scenario)) for plan in plans]
    for run, each in enumerate(heard):
        each.ranges[:, 20 + run : 60] = np.nan
    positions, ranges, age = (np.concatenate([getattr(each, name) for each in heard]) for name in vars(heard[0]))

    def payloads(steps):
        tracker, neighbours = batch_tracker(plans)
        for k, step in enumerate(steps):
            seen = positions[:, k], ranges[:, k], age[:, k], *no_neighbours(40)
            sent = tracker.measure(Measurement(*seen, step=step, agent=np.tile(np.arange(4), 10)))
            yield sent
            for _ in range(plans[0].rounds):
                sent = tracker.exchange(sent[neighbours.index], neighbours.present)
            tracker.conclude()

    for told, counted in zip(payloads(range(1, 71)), payloads([None] * 70), strict=True):
        np.testing.assert_array_equal(told, counted)


@pytest.mark.slow
def test_biases_are_still_known_after_another_fix():
    for trace in runs(silence(12.0, 26.0), *BIASED, steps=290, seeds=3):
        bias = trace.diagnostics.bias
        assert (trace.diagnostics.status[:, 270] == ACQUIRING).any()
        np.testing.assert_allclose(bias[:, 285], bias[:, 115], atol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize(
    "keys",
    [
        (),
        BIASED,
        ("sensor.bias=0.3", "filter.bias=auto", "filter.recovery=true", "filter.distrust=true"),
        ("filter.motion=imm", "filter.range_std=auto"),
        ("filter.planar_height=0.0", "target.velocity=[0.5,0.3,0.0]", "filter.start=given"),
        ("consensus.acceleration=chebyshev", "consensus.rounds=4"),
        ("consensus.scheme=running-sums",),
    ],
)
def test_whatever_stands_around_the_filter_a_batch_and_each_run_alone_give_the_same_bits(keys):
    """Runs of one batch search at different times: one is lost from the start, both are silent later."""
    both = silence(6.0, 18.0), *keys
    wide = ["dt=0.2", "steps=125", "filter.initial_position_std=3.0", *both]
    scenarios = [load("tracking", [*wide, f"seed={seed}"]).scenario for seed in (1001, 1007)]
    heard = []
    for number, one in enumerate(scenarios):
        plan = Plan(one)
        told = heard_in(plan, make_world(one))
        ranges = told.ranges.copy()
        ranges[:, 50 : 80 + 10 * number] = np.nan if number else ranges[:, 50:80]
        heard.append(Heard(told.positions, ranges, told.age))
    together = simulate(scenarios, heard=heard, keep_payloads=True)
    for one, told, expected in zip(scenarios, heard, together, strict=True):
        [alone] = simulate([one], heard=[told], keep_payloads=True)
        assert alone.estimates.tobytes() == expected.estimates.tobytes()
        assert alone.payloads is not None
        assert expected.payloads is not None
        assert alone.payloads.tobytes() == expected.payloads.tobytes()
        assert alone.diagnostics.status.tobytes() == expected.diagnostics.status.tobytes()
        # Agents that tell each other their ranges make no other fix.
        assert Plan(one).tells_ranges or (expected.diagnostics.status[:, 90:] == ACQUIRING).any(axis=1).all()
        assert np.isfinite(expected.estimates).all()


def test_where_agents_lie_or_keep_to_themselves_there_is_no_other_fix():
    lying = 'fault=[{kind="byzantine",mode="constant",magnitude=5.0,agents=[3]}]'
    for keys in ([lying], ["consensus.rounds=0"], ["agents.count=1"], ["filter.kind=ci"], ["filter.status=false"]):
        assert load("tracking", keys).plan.settings.reacquires == 0
    assert load("tracking").plan.settings.reacquires == 10
    assert load("tracking", ["consensus.rounds=1", "agents.count=5"]).plan.settings.spreading == 5


@pytest.mark.slow
def test_a_network_that_tracks_among_forty_percent_of_wrong_ranges_does_not_begin_again():
    scenarios = [load("tracking", ["steps=250", f"seed={seed}"]).scenario for seed in (5001, 5011, 5012, 5019)]
    heard = []
    for one in scenarios:
        told, chance = heard_in(Plan(one), make_world(one)), np.random.default_rng(one.seed)
        heard.append(Heard(told.positions, told.ranges + 30.0 * (chance.random(told.ranges.shape) < 0.4), told.age))
    for trace in simulate(scenarios, heard=heard):
        assert (trace.diagnostics.status[:, 30:] == TRACKING).all()
        assert errors(trace)[30:].max() < 1.0


def test_agents_that_come_back_while_others_are_in_a_fix_go_on() -> None:
    # In step 91 two of five agents begin with their neighbours' estimates, and one of those is in a fix.
    away = 'fault=[{kind="crash",agents=[1,2],from=5.0,until=9.0}]'
    corners = "target.waypoints=[[-9,0,0],[0,9,2],[9,0,0],[0,-9,2],[-9,0,0]]"
    keys = "agents.count=5", away, "target.motion=waypoints", "target.speed=8", corners, "steps=93", "seed=1031"
    [trace] = simulate([load("tracking", keys).scenario])
    assert np.isfinite(trace.estimates[:, 90:]).all()
