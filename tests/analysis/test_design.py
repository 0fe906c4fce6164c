"""What is predicted before a run is what simulations and independent derivations give."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.analysis.design import cannot, design, sight_of
from zenoh_cbef.analysis.metrics import analyze
from zenoh_cbef.analysis.mixing import SCHEMES, contraction, mixing
from zenoh_cbef.analysis.observability import observability
from zenoh_cbef.analysis.prediction import Clipping, Sight, propagate
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.scenario import network
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.world import make_world
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space
from zenoh_cbef.tracking.reference import posterior_bound
from zenoh_cbef.tracking.weights import weight_matrix

MOTION = NearlyConstantVelocity(0.1, 0.3)
LOSS = "fault=[{kind='loss', probability=0.3}]"


def tracking(*overrides):
    return load("tracking", overrides).scenario


def random_sight(agents, steps):
    rows = np.zeros((steps, agents, 6))
    rows[:, :, :3] = np.random.default_rng(1).normal(size=(steps, agents, 3))
    rows /= np.linalg.norm(rows, axis=2, keepdims=True)
    return Sight(rows, 0.1)


@pytest.mark.parametrize("xi", [0.3, 1.0, 1.5, 4.0])
def test_the_moments_of_a_clipped_normal_are_those_of_its_density(xi):
    edges = np.linspace(-12.0, 12.0, 240_001)
    values = 0.5 * (edges[1:] + edges[:-1])
    density = np.exp(-0.5 * values**2)
    weights = np.minimum(1.0, xi / np.abs(values))

    def mean(of):
        return pytest.approx(np.average(of, weights=density), abs=1e-6)

    found = Clipping.at(xi)
    assert found.gain == mean(weights * values**2)
    assert found.power == mean((weights * values) ** 2)
    assert found.weight == mean(weights)
    assert found.square == mean(weights**2)


def test_a_single_agent_is_predicted_at_the_posterior_bound():
    scenario = tracking("agents.count=1", "filter.kind=icf", "steps=60", "network.edges=[]")
    world, initial = make_world(scenario), np.diag([1.0] * 3 + [0.25] * 3)
    bound = posterior_bound(
        initial[None],
        Plan(scenario).plain_motion,
        Space(),
        truth=world.truth[None],
        positions=world.positions[None],
        measured=np.ones((1, 1, 60), dtype=bool),
        age=np.zeros((1, 1, 60)),
        range_std=0.1,
    )[0]
    expected = propagate(
        initial,
        Plan(scenario).plain_motion,
        sight_of(Plan(scenario)),
        np.ones((1, 1, 1, 1)),
        weight=np.ones((1, 1)),
        clipping=Clipping.at(np.inf),
    )
    np.testing.assert_allclose(expected.position[0], np.trace(bound[:, :3, :3], axis1=1, axis2=2), rtol=1e-6)
    np.testing.assert_allclose(expected.nees[0], 6.0, rtol=1e-6)


@pytest.mark.parametrize("xi", [np.inf, 1.5])
def test_the_predicted_error_is_that_of_the_recursion_drawn_many_times(xi):
    # Linear measurements, so the prediction is exact without saturation; three agents in a row, one round, icf.
    agents, steps, draws = 3, 12, 2500
    sight, how = random_sight(agents, steps), np.array([[2, 1, 0], [1, 1, 1], [0, 1, 2]]) / 3.0
    random = np.random.default_rng(2)
    truth = np.zeros((draws, 6))
    state = random.normal(size=(draws, agents, 6))
    claimed = np.tile(np.eye(6), (draws, agents, 1, 1))
    found = np.empty(steps)
    for k in range(steps):
        noise = MOTION.acceleration_std * random.normal(size=(draws, 3))
        truth = truth @ MOTION.transition.T + np.hstack([0.005 * noise, 0.1 * noise])
        state, claimed = state @ MOTION.transition.T, MOTION.predict_covariance(claimed)
        vectors, matrices = np.empty_like(state), np.empty_like(claimed)
        for agent in range(agents):
            row, prior = sight.rows[k, agent], np.linalg.inv(claimed[:, agent])
            z = truth @ row + 0.1 * random.normal(size=draws) - state[:, agent] @ row
            spread = np.sqrt(np.einsum("i,dij,j->d", row, claimed[:, agent], row) + 0.01)
            gain = np.minimum(1.0, xi * spread / np.abs(z)) * agents / 0.01
            vectors[:, agent] = np.einsum("dij,dj->di", prior, state[:, agent])
            vectors[:, agent] += (gain * (z + state[:, agent] @ row))[:, None] * row
            matrices[:, agent] = prior + gain[:, None, None] * np.outer(row, row)
        claimed = np.linalg.inv(np.einsum("ij,djab->diab", how, matrices))
        state = np.einsum("diab,dib->dia", claimed, np.einsum("ij,djb->dib", how, vectors))
        found[k] = np.mean(np.sum((state - truth[:, None])[:, :, :3] ** 2, axis=2))
    clipping = Clipping.at(xi)
    expected = propagate(np.eye(6), MOTION, sight, how[None, None], weight=np.full((1, 3), 3.0), clipping=clipping)
    # Saturation is accounted for to second order only, and worst in the first steps.
    start, tolerance = (0, 0.06) if xi == np.inf else (6, 0.15)
    np.testing.assert_allclose(found[start:], expected.position[0, start:], rtol=tolerance)


def foretold(scenarios):
    found = [design(Plan(one), search=False).configured.expected for one in scenarios]
    return [one for one in found if one is not None]


@pytest.mark.slow
@pytest.mark.parametrize(
    "overrides",
    [
        ("consensus.rounds=1",),
        ("consensus.rounds=3",),
        ("consensus.rounds=2", "consensus.acceleration=chebyshev"),
        ("consensus.rounds=3", "filter.kind=icf"),
        ("consensus.rounds=3", "filter.kind=ci"),
        ("agents.count=20", "network.graph=path", "consensus.rounds=6"),
    ],
)
def test_predictions_agree_with_simulations_over_seeds(overrides):
    scenarios = [tracking(f"seed={seed}", "steps=150", *overrides) for seed in range(1, 11)]
    before, after = foretold(scenarios), [one.metrics for one in analyze(simulate(scenarios))]

    def both(name):
        return np.array([getattr(one, name) for one in before]), np.array([pick(one, name) for one in after])

    for name in ("position_rmse", "velocity_rmse"):
        predicted, simulated = (np.sqrt(np.mean(one**2)) for one in both(name))
        assert predicted == pytest.approx(simulated, rel=0.08), name
    predicted, simulated = (np.median(one) for one in both("ratio_to_centralized"))
    assert predicted - 1.0 == pytest.approx(simulated - 1.0, rel=0.35, abs=0.004)
    claimed = np.mean([pick(one, "nees.average") for one in after])
    assert np.mean([one.nees or np.nan for one in before]) == pytest.approx(claimed, rel=0.1)


@pytest.mark.slow
def test_under_loss_the_error_is_predicted_and_its_small_excess_to_a_factor_of_two():
    scenarios = [tracking(f"seed={seed}", "consensus.rounds=4", LOSS, "steps=80") for seed in range(1, 19)]
    before, after = foretold(scenarios), [one.metrics for one in analyze(simulate(scenarios))]
    predicted = np.sqrt(np.mean([one.position_rmse**2 for one in before]))
    assert predicted == pytest.approx(np.sqrt(np.mean([pick(one, "position_rmse") ** 2 for one in after])), rel=0.08)
    excess = np.median([one.ratio_to_centralized for one in before]) - 1.0
    assert 0.5 < excess / (np.median([pick(one, "ratio_to_centralized") for one in after]) - 1.0) < 2.0


def test_mixing_is_the_power_of_the_weights_and_its_rows_sum_to_one_under_loss():
    scenario = tracking("steps=5")
    lists = graph.neighbours(6, network.edges(scenario))
    weights = weight_matrix(lists, Plan(scenario).weights)
    found = mixing(Plan(scenario), "average", 4)
    np.testing.assert_allclose(found[3, 0], np.linalg.matrix_power(weights, 4), atol=1e-12)
    for scheme in SCHEMES:
        lossy = mixing(Plan(tracking("steps=5", LOSS)), scheme, 4)
        assert lossy.shape == (4, 5, 6, 6)
        np.testing.assert_allclose(lossy.sum(axis=3), 1.0, atol=1e-12)
        assert (lossy[0, 0] != lossy[0, 1]).any()


@pytest.mark.parametrize(
    "overrides",
    [
        ["consensus.isolate=true"],
        ['fault=[{kind="byzantine", agents=[5]}]'],
        ["filter.kind=ci", "consensus.isolate=true"],
        ["filter.kind=ci", "consensus.lag=2"],
    ],
)
def test_stages_that_read_messages_mix_as_the_plain_average(overrides):
    plan = Plan(tracking("steps=5", *overrides))
    found = mixing(plan, "average", 2)
    np.testing.assert_allclose(found, np.broadcast_to(mixing(Plan(tracking("steps=5")), "average", 2), found.shape))
    told = design(plan, search=False)
    assert told.configured.expected is not None


@pytest.mark.parametrize("scheme", SCHEMES)
def test_disagreement_shrinks_by_the_contraction(scheme):
    scenario = tracking("network.graph=ring", "agents.count=9")
    apart = np.linalg.norm(mixing(Plan(scenario), scheme, 40)[:, 0] - 1.0 / 9.0, axis=(1, 2))
    rate = (apart[35] / apart[15]) ** (1.0 / 20.0)
    assert rate == pytest.approx(contraction(Plan(scenario), scheme), rel=0.03)


def test_the_smallest_number_of_rounds_is_the_smallest():
    told = design(Plan(tracking("network.graph=path", "steps=120")), within=0.01)
    rows = {(scheme, row.rounds): found for row in told.rounds for scheme, found in row.schemes.items()}
    smallest = {scheme: rounds for scheme, rounds in told.smallest.items() if rounds is not None}
    for scheme in SCHEMES:
        enough = smallest[scheme]
        assert rows[scheme, enough].ratio_to_centralized <= 1.01
        assert rows[scheme, enough - 1].ratio_to_centralized > 1.01
    assert smallest["chebyshev"] < smallest["average"]


def test_what_cannot_be_reached_is_not_promised():
    # Covariance intersection stays worse than the centralised filter however many rounds there are.
    told = design(Plan(tracking("filter.kind=ci", "steps=60")), within=0.01)
    assert set(told.smallest.values()) == {None}
    assert min(row.schemes["average"].ratio_to_centralized for row in told.rounds if "average" in row.schemes) > 1.05


def test_observability_tells_what_agents_on_a_line_cannot_see():
    def seen(places):
        world = [
            "agents.count=4",
            f"agents.positions={places}",
            "target.position=[3, 2, 1]",
            "target.acceleration_std=0.0",
        ]
        scenario = tracking(*world, "target.velocity=[0, 0, 0]", "steps=100", "filter.acceleration_std=0.3")
        return observability(np.eye(6), Plan(scenario).plain_motion, sight_of(Plan(scenario)), 25)

    line = seen([[0, 0, 0], [4, 0, 0], [8, 0, 0], [12, 0, 0]])
    spread = seen([[0, 0, 0], [10, 0, 0], [0, 10, 0], [0, 0, 10]])
    # A target at rest: one direction per agent, two on a line (around it nothing changes), three in space.
    assert [one.rank for one in line.agents] == [2] * 4
    assert line.network.rank == 4
    assert line.network.condition is None
    assert spread.network.rank == spread.dimension == 6
    assert spread.network.bound < 0.3 * line.network.bound


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["filter.kind=kcf"], "kcf is not predicted"),
        (["filter.kind=ci", "filter.measurement=difference"], "differenced"),
        (["sensor.outlier_probability=0.1"], "Outliers"),
        (["sensor.bias_std=0.2"], "biases"),
        (["agents.count=60"], "more than 40 agents"),
    ],
)
def test_what_is_left_out_is_said(overrides, words):
    assert any(words in sentence for sentence in cannot(Plan(tracking(*overrides))))
    assert cannot(Plan(tracking())) == []


def test_a_filter_that_is_not_predicted_still_gets_geometry_and_bytes():
    told = design(Plan(tracking("filter.kind=kcf", "steps=20")))
    assert told.centralized is None
    assert told.rounds == []
    assert told.observability.network.rank == 6
    assert told.configured.bytes_per_step > 0


@pytest.mark.parametrize("off", [0.0, 0.1])
def test_no_nees_is_predicted_for_agents_on_a_line_or_nearly(off):
    positions = [[-10, 0, 0], [-4, off, 0], [3, 0, off], [10, 0, 0]]
    told = design(load("tracking", ["agents.count=4", f"agents.positions={positions}", "steps=60"]).plan, search=False)
    assert told.configured.expected is not None
    assert told.configured.expected.nees is None
    assert any("NEES is not predicted" in said for said in told.cannot)
