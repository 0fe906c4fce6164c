"""Where what ranges leave open is a curve, or several places, agents tell each other their ranges and follow it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.tracking.test_splitting import STD, heard_of
from zenoh_cbef.scenario.load import load
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.models.mixtures import alike
from zenoh_cbef.tracking.filters.models.splitting import CLOSELY, ROUGHLY, split
from zenoh_cbef.tracking.motion.jump import Jump
from zenoh_cbef.tracking.status import TRACKING

CORRIDOR = ("agents.low=[-20,-1,-1]", "agents.high=[20,1,1]", "filter.initial_position=[-8,8,2]")
REACH = ("sensor.reach=9",)
SILENT = ('fault=[{kind="sensor-dropout",agents=[0,1,2,3],from=8.0}]',)
IMM = ("filter.motion=imm",)
SMALL = (*IMM, "agents.low=-2", "agents.high=2", "sensor.range_std=1")
SLOW = ("dt=3", "target.motion=lemniscate", "target.period=40", "target.radius=9")


def plan_of(*sets, rules=15):
    return Plan(load("tracking", [*sets, f"filter.defaults={rules}"]).scenario)


@pytest.mark.parametrize("sets", [CORRIDOR, (*CORRIDOR, "filter.acceleration_std=0.3"), REACH, SILENT, SMALL, SLOW])
def test_agents_tell_ranges_that_leave_a_curve_or_several_places(sets):
    for rules, tells in ((14, False), (15, True)):
        plan = plan_of(*sets, rules=rules)
        assert plan.tells_ranges is tells
        assert plan.settings.splits == (CLOSELY if tells else 0)


@pytest.mark.parametrize(
    "sets",
    [
        (),
        ("agents.low=[-20,-3,-3]", "agents.high=[20,3,3]"),
        ("agents.low=[-20,-20,0]", "agents.high=[20,20,0]"),
        ("agents.low=[-20,-20,-0.1]", "agents.high=[20,20,0.1]"),
        (*IMM, "sensor.range_std=0.3"),
        (*IMM, "sensor.outlier_probability=0.3", "sensor.outlier_scale=20"),
        (*SLOW, "dt=0.5"),
        (*REACH, "agents.count=13"),
        (*REACH, "filter.saturation=bounded"),
        (*REACH, "sensor.bias_std=0.5"),
        (*REACH, "filter.range_std=0.2"),
        (*REACH, "consensus.rounds=4"),
    ],
)
def test_elsewhere_they_share_information(sets):
    assert not plan_of(*sets).tells_ranges


@pytest.mark.parametrize(("dt", "std", "agile"), [(0.1, 0.5, 100.0), (3.0, 0.5, 1 / 3), (3.0, 2.0, 4 / 3)])
def test_the_most_agile_motion_may_turn_round_in_a_step(dt, std, agile):
    sets = (*SLOW, f"dt={dt}", f"filter.initial_velocity_std={std}")
    jump = plan_of(*sets).models[-1]
    assert isinstance(jump, Jump)
    assert jump.acceleration_std == pytest.approx(agile)
    before = plan_of(*sets, rules=14).models[-1]
    assert isinstance(before, Jump)
    assert before.acceleration_std == pytest.approx(1.0 / dt**2)


def test_a_hypothesis_is_split_by_what_it_knows_of_a_range():
    """Along a sphere of which it knows the radius well it is split, though each range bends by less than its noise."""
    heard = heard_of(np.zeros((1, 3)))
    far = heard.place[0, 0] / np.linalg.norm(heard.place[0, 0])
    across = np.linalg.svd(far[None])[2][1]
    for radial, parts in ((0.02, 6), (1.0, 2)):
        place = 0.9**2 * np.outer(across, across) + radial**2 * np.outer(far, far) + 0.02**2 * np.eye(3)
        covariance = np.eye(6)
        covariance[:3, :3] = place
        priors = alike(np.zeros((1, 6)), covariance[None], 2)
        only = heard_of(np.zeros((1, 3)))
        only.range[:, 1:] = np.nan
        assert 0.5 * 0.9**2 / np.linalg.norm(heard.place[0, 0]) < STD
        assert split(priors, only, CLOSELY)[0].shape[1] == parts
        assert split(priors, only, ROUGHLY)[0].shape[1] == 2
        assert split(priors, only, 0) is priors


@pytest.mark.parametrize(
    ("sets", "seed"),
    [
        pytest.param((*CORRIDOR, "steps=60"), 1015, id="corridor"),
        pytest.param((*REACH, "steps=120"), 1047, id="reach", marks=pytest.mark.slow),
        pytest.param((*SLOW, "steps=100"), 1002, id="slow", marks=pytest.mark.slow),
    ],
)
def test_an_estimate_is_worth_what_it_claims_where_it_was_not(sets, seed):
    worth = []
    for rules in (14, 15):
        scenario = load("tracking", [*sets, f"filter.defaults={rules}"]).scenario.model_copy(update={"seed": seed})
        with np.errstate(all="ignore"):
            trace = simulate([scenario])[0]
        error = trace.estimates - trace.truth
        nees = np.einsum("nki,nki->nk", error, np.linalg.solve(trace.covariances, error[..., None])[..., 0]) / 6.0
        said = trace.diagnostics.status == TRACKING
        worth.append(float(nees[said].mean()))
    assert worth[0] > 10.0
    assert worth[1] < 3.0


def test_an_agent_that_learns_its_noise_tells_its_ranges_too():
    learns = *CORRIDOR, "filter.range_std=auto"
    assert not plan_of(*learns).tells_ranges
    assert plan_of(*learns, rules=16).tells_ranges
