"""What a network says of its estimates: silence makes it coast, ranges that do not fit tell it that it is lost."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.diagnostics import Diagnostics
from zenoh_cbef.tracking.filters import Belief, Update, make_filter
from zenoh_cbef.tracking.filters.base import Bias
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Measurement, Space, no_neighbours
from zenoh_cbef.tracking.status import ACQUIRING, COASTING, LOST, STATUSES, TRACKING, Status, most_misfit, status_name

HERE = "filter.reacquire=false"
SILENT = 'fault=[{kind="sensor-dropout",probability=1.0,from=5.0,until=9.0}]'


@cache
def runs(*keys: str, seeds: int = 5):
    one = load("tracking", ["steps=150", HERE, *keys]).scenario
    return simulate([one.changed(seed=1 + more) for more in range(seeds)])


def said(*keys: str):
    """What all agents of all runs said, (rows, K)."""
    return np.concatenate([trace.diagnostics.status for trace in runs(*keys)])


def test_a_silence_makes_a_network_coast_and_ranges_end_it():
    status = said(SILENT)
    # Without a first fix a place is proved by seven ranges of each agent.
    assert (status[:, :6] == ACQUIRING).all()
    assert (status[:, 6:49] == TRACKING).all()
    # The covariance has to grow first, and a range has to come back.
    assert (status[:, 60:89] == COASTING).all()
    assert (status[:, 100:] == TRACKING).all()
    for trace in runs(SILENT):
        seconds = trace.diagnostics.status_seconds[:, 60:89]
        np.testing.assert_allclose(np.diff(seconds, axis=1), trace.scenario.dt)
        assert (seconds[:, 0] < 1.0).all()


@pytest.mark.parametrize(
    "keys",
    [
        ("sensor.outlier_probability=0.3", "sensor.outlier_scale=5.0"),
        ("filter.range_std=0.05",),
        ("sensor.dropout_probability=0.7",),
        ("dt=0.02",),
        ("target.velocity=[3.0,0.0,0.0]",),
    ],
)
def test_bad_ranges_and_few_of_them_are_no_reason_to_despair(keys):
    settled = said(*keys)[:, 60:]
    assert np.mean(settled == TRACKING) > 0.98


def test_a_network_that_holds_on_to_a_wrong_place_says_that_it_is_lost():
    wrong = "filter.start=given", "filter.initial_position=[30,-30,10]", "filter.acceleration_std=0.01"
    far_ones = 0
    for trace in runs(*wrong):
        errors = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2)
        far = errors[:, 20:] > 2.0
        far_ones += int(far.sum())
        assert (trace.diagnostics.status[:, 20:][far] == LOST).all()
    assert far_ones > 100


@pytest.mark.slow
def test_where_too_few_agents_fit_to_prove_a_place_it_is_not_tracked():
    """One receiver of five is 3 m too long: some networks follow it, so that two others do not fit."""
    one_biased = 'fault=[{kind="sensor-bias",bias=3.0,agents=[1]}]', "agents.count=5"

    def surely_wrong(rules: int) -> float:
        wrong = []
        for trace in runs(*one_biased, f"filter.status_rules={rules}", seeds=30):
            errors = np.linalg.norm((trace.estimates - trace.truth)[:, 90:, :3], axis=2)
            wrong.append((errors > 1.0) & (trace.diagnostics.status[:, 90:] == TRACKING))
        return float(np.mean(wrong))

    before = surely_wrong(1)
    assert before > 0.15
    assert surely_wrong(2) < 0.5 * before


def test_how_many_agents_have_to_fit():
    def lost(agents: int, wrong: int, unknowns: int = 3) -> bool:
        return bool(9.0 * wrong / agents > most_misfit(unknowns, agents))

    assert [lost(agents, 1) for agents in (3, 4, 5)] == [False, True, False], "three agents never prove a place"
    assert [lost(agents, 2) for agents in (5, 6, 7)] == [True, False, False]
    assert lost(5, 1, unknowns=4), "a bias in common is one unknown more"
    assert [lost(20, wrong) for wrong in (11, 13)] == [False, True]


def test_an_agent_that_hears_no_neighbour_coasts():
    [trace] = runs('fault=[{kind="partition",links="agent:0",from=5.0,until=9.0}]', seeds=1)
    assert (trace.diagnostics.status[0, 65:89] == COASTING).all()
    assert (trace.diagnostics.status[1:, 65:89] == TRACKING).all()
    assert (trace.diagnostics.status[:, 100:] == TRACKING).all()


@pytest.mark.parametrize("kind", ["sicf", "icf", "hcmci", "ci"])
def test_agents_agree_and_metrics_are_told_apart(kind):
    [trace] = runs(f"filter.kind={kind}", SILENT, seeds=1)
    status = trace.diagnostics.status
    assert (status == status[0]).all(axis=0).mean() > 0.97
    [analysis] = analyze([trace])
    told = analysis.metrics.status
    assert told is not None
    assert list(told) == list(STATUSES)
    assert sum(one.share for one in told.values()) == pytest.approx(1.0)
    now = status == COASTING
    assert told["coasting"].share == pytest.approx(now.mean())
    assert told["coasting"].position_rmse == pytest.approx(np.sqrt(np.mean(analysis.position_error[now] ** 2)))
    assert told["coasting"].nees == pytest.approx(np.mean(analysis.nees[now]))
    assert told["lost"].position_rmse is None


class Biased:
    """A filter whose ranges all fit, as it explains them by a bias."""

    def __init__(self, bias: float, weight: float) -> None:
        self._bias = Bias(np.array([bias]), np.array([0.1]), np.array([weight]), np.zeros(1))

    def update(self, belief: Belief, measurement: Measurement) -> Update:  # noqa: ARG002 - it fits, whatever it is
        fits = Diagnostics.where(np.array([True]), nis=np.ones(1), nis_degrees=np.ones(1, dtype=np.int64))
        return Update(np.zeros((1, 1)), fits, (belief.state, belief.known_covariance))

    def conclude(self, payload: Floats, update: Update) -> Belief:  # noqa: ARG002 - there is nothing to learn
        state, covariance = update.kept
        return Belief(state, covariance, self._bias)


@pytest.mark.parametrize(
    ("bias", "weight", "wrong"),
    [(0.0, 1.0, False), (1.9, 1.0, False), (2.1, 1.0, True), (-2.1, 1.0, True), (2.7, 0.5, False), (2.9, 0.5, True)],
)
def test_ranges_do_not_fit_that_are_explained_by_a_bias_four_deviations_off(bias, weight, wrong):
    settings = FilterSettings(
        NearlyConstantVelocity(0.1, 0.5), Space(), 0.1, 2.0, 4, common_bias_std=0.3, own_bias_std=0.4
    )
    knowing, belief = Knowing(Biased(bias, weight), settings), Belief(np.zeros((1, 6)), np.eye(6)[None])
    heard = Measurement(np.zeros((1, 3)), np.ones(1), np.zeros(1), *no_neighbours(1))
    for _ in range(20):
        update = knowing.update(belief, heard)
        belief = knowing.conclude(update.payload, update)
    assert update.payload[0].tolist() == [0.0, 1.0, 9.0 if wrong else 0.0]


@pytest.mark.parametrize("keys", [("filter.kind=kcf",), ("filter.kind=cbef",), ("filter.status=false",)])
def test_other_filters_say_nothing(keys):
    [trace] = runs(*keys, seeds=1)
    assert np.isnan(trace.diagnostics.status).all()
    assert analyze([trace])[0].metrics.status is None


def step(status: Status, heard: float, nis: float, spread: float, count: int = 1) -> Status:
    for _ in range(count):
        status = status.after(
            heard=np.array([heard]), misfit=np.array([heard * nis]), spread=np.array([spread]), axes=3, fix=4, dt=0.5
        )
    return status


def test_the_ways_from_status_to_status():
    start = step(Status.first(1), heard=6.0, nis=9.0, spread=1.0, count=4)
    assert start.which[0] == ACQUIRING, "a first fix does not count"
    assert step(start, 6.0, 1.0, 1.0, count=4).which[0] == ACQUIRING
    tracking = step(start, 6.0, 1.0, 1.0, count=5)
    assert (tracking.which[0], tracking.seconds[0]) == (TRACKING, 0.0)
    silent = step(step(tracking, 0.0, 0.0, 1.9), 0.0, 0.0, 2.1, count=3)
    assert (silent.which[0], silent.seconds[0]) == (COASTING, 1.0)
    # One agent's ranges do not end it while the claimed error grows, and six agents' soon do.
    assert step(silent, 1.0, 1.0, 5.0, count=10).which[0] == COASTING
    assert step(silent, 6.0, 1.0, 2.1).which[0] == TRACKING
    wrong = step(tracking, 6.0, 9.0, 1.0, count=40)
    assert wrong.which[0] == LOST
    assert step(wrong, 6.0, 1.0, 1.0, count=40).which[0] == TRACKING
    assert step(tracking, 6.0, 4.0, 1.0, count=200).which[0] == TRACKING


@pytest.mark.parametrize("forged", [np.inf, -np.inf, np.nan, 1e60, -1e60])
def test_forged_numbers_make_no_number_that_is_none(forged):
    plan = load("tracking", ["filter.start=given", HERE]).plan
    made, belief = plan.filter, plan.initial_belief
    for _ in range(10):
        update = made.update(belief, Measurement(np.zeros((6, 3)), np.full(6, 2.0), np.zeros(6), *no_neighbours(6)))
        mixed = np.tile(update.payload.mean(axis=0), (6, 1))
        mixed[:, -2:] = forged
        belief = made.conclude(mixed, update)
        assert belief.status is not None
        assert all(np.isfinite(values).all() for values in vars(belief.status).values())


def test_several_ranges_that_are_as_good_as_usual_fit():
    """Five differences of ranges, each off by 1.5 standard deviations: together far above the NIS of one."""
    motion = NearlyConstantVelocity(0.1, 0.3)
    settings = FilterSettings(motion, Space(), 0.1, np.inf, 6, differenced=True, says_status=True, judges_agents=False)
    places = np.array([[-8.0, 3, 1], [7, -6, 4], [2, 9, -5], [-3, -7, -8], [9, 5, 7], [-6, 1, 9]])
    belief = Belief(np.array([[1.0, -2.0, 0.5, 0.4, 0.3, -0.2]]), 1e-6 * np.eye(6)[None])
    ahead = motion.predict_state(belief.state)[0, :3]
    ranges = np.linalg.norm(ahead - places, axis=1) + 0.15 * np.array([1.0, -1, 1, -1, 1, -1])
    told = Measurement(places[:1], ranges[:1], np.zeros(1), places[None, 1:], ranges[None, 1:])
    heard, misfit = make_filter("ci", settings).update(belief, told).payload[0, -2:]
    assert heard == 1.0
    assert 1.0 < misfit < 4.0


def test_names_of_numbers_from_elsewhere():
    assert [status_name(number) for number in (0.0, 3.0, 4.0, -1.0, 1.5, None)] == [
        "acquiring",
        "lost",
        None,
        None,
        None,
        None,
    ]


@pytest.mark.parametrize(("rules", "sure"), [(11, True), (12, False)])
def test_a_place_has_to_fit_the_ranges_of_every_agent_before_a_network_tracks(rules, sure):
    """The guess is 12 m off and believed within 1 m, and what it leads to fits the ranges of five agents of six."""
    keys = "dt=0.02", "steps=45", "seed=1024", "filter.initial_position=[-8,8,2]", f"filter.defaults={rules}"
    (trace,) = simulate([load("tracking", keys).scenario])
    off = np.linalg.norm((trace.estimates - trace.truth)[:, :, :3], axis=2) > 1.0
    tracks = trace.diagnostics.status == TRACKING
    assert (off & tracks).any() == sure
    assert tracks[:, -1].all()
    assert not off[:, -1].any()


def test_a_step_that_too_many_agents_deny_proves_nothing():
    """One of four is too many: three fit any place."""
    said = Status.first(1)

    def fitted(misfit: float, *, whole: bool) -> float:
        four, none = np.array([4.0]), np.array([misfit])
        known = most_misfit(3, 4)
        after = said.after(heard=four, misfit=none, spread=np.ones(1), axes=3, fix=0, dt=0.1, most=known, whole=whole)
        return float(after.heard[0])

    assert [fitted(0.0, whole=True), fitted(9.0, whole=True), fitted(9.0, whole=False)] == [4.0, 0.0, 3.0]


@pytest.mark.slow
@pytest.mark.parametrize(("rules", "sure"), [(18, True), (19, False)])
def test_agents_that_come_back_do_not_track_where_they_do_not_agree(rules, sure):
    """Two of five hold on to a place that fits three ranges, and take the two others, 4 and 6 m off, for wrong."""
    crash = 'fault=[{kind="crash",agents=[1,2],from=5.0,until=9.0}]'
    corners = "target.waypoints=[[-9,0,0],[0,9,2],[9,0,0],[0,-9,2],[-9,0,0]]"
    keys = "agents.count=5", crash, "target.motion=waypoints", "target.speed=8", corners, f"filter.defaults={rules}"
    (trace,) = simulate([load("tracking", [*keys, "seed=1015", "steps=125"]).scenario])
    said, off = trace.diagnostics.status[:, 88:], np.linalg.norm((trace.estimates - trace.truth)[:, 88:, :3], axis=2)
    assert (said[off > 5.0] == TRACKING).any() == sure
    # They agree in the end, and then track again.
    assert off[:, 15:].max() < 0.5
    assert (said[:, -5:] == TRACKING).all()
