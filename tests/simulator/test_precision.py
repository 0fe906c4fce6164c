"""Runs whose payloads travel in few bits: nearly the same errors, honest covariances, the network's sum kept."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tests import unaided
from tests.log.made import made_log
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.prove.verify import verify
from zenoh_cbef.log.read.decoding import Decoder
from zenoh_cbef.log.read.header import read_header
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.check import check as check_log
from zenoh_cbef.log.tools.selection import Selection
from zenoh_cbef.log.tools.show import lines
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.compact import PRECISIONS, Compact
from zenoh_cbef.tracking.consensus import Average, Chebyshev, Consensus, RunningSums
from zenoh_cbef.tracking.graph import make_edges, neighbours
from zenoh_cbef.tracking.weights import metropolis_weights

FEWER = PRECISIONS[1:]
LOSS = 'fault=[{kind="loss", probability=0.3}]'
LIAR = 'fault=[{kind="byzantine", agents=[1], mode="constant", magnitude=1.0}]'


def errors(*overrides):
    scenario = load("tracking", ["steps=60", *overrides]).scenario
    found = unaided.errors(simulate([scenario.changed(seed=seed) for seed in range(1, 5)]))
    return np.array([[unaided.position_rmse(one), unaided.nees(one) / 6.0] for one in found])


FAST = "consensus.acceleration='chebyshev'"
PLAIN = "consensus.scheme='average'"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("overrides", "precisions"),
    [([], FEWER), ([LOSS, PLAIN], ["int12"]), ([FAST], ["int12"])],
    ids=["clean", "loss", "fast"],
)
def test_few_bits_cost_less_than_a_hundredth_of_the_error(overrides, precisions):
    plain = errors(*overrides)
    for precision in precisions:
        found = errors(f"consensus.precision='{precision}'", *overrides)
        assert np.median(found[:, 0] / plain[:, 0]) < 1.01, precision
        assert np.mean(found[:, 1] / plain[:, 1]) < 1.02, precision


@pytest.mark.parametrize("scheme", ["average", "chebyshev", "running-sums"])
def test_rounding_keeps_the_sum_of_the_network(scheme):
    lists = neighbours(7, make_edges("erdos-renyi", np.zeros((7, 3)), seed=2, probability=0.4, radius=1.0))
    weights = metropolis_weights(lists)
    rounded = Compact(5 + (scheme == "running-sums"), (), "float32").rounded
    stages: dict[str, Consensus] = {
        "average": Average(weights, rounded=rounded),
        "chebyshev": Chebyshev(weights, np.full((7, 1), -0.3), np.full((7, 1), 0.8), rounded=rounded),
        "running-sums": RunningSums(lists.present, rounded),
    }
    stage = stages[scheme]
    payload = np.random.default_rng(3).normal(size=(7, 5))
    message = stage.start(payload)
    for _ in range(300):
        message = stage.mix(message[lists.index], None)
    # Each agent is off by its own rounding, which is 6e-8 of what it sends; their sum by that of float64.
    np.testing.assert_allclose(stage.result(), np.tile(payload.mean(axis=0), (7, 1)), rtol=0, atol=1e-4)
    if scheme != "running-sums":
        np.testing.assert_allclose(stage.result().sum(axis=0), payload.sum(axis=0), rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("precision", "overrides"),
    [
        ("int12", []),
        ("int8", [LOSS]),
        ("float32", [LIAR]),
        ("int16", [LIAR]),
        ("float32", ["filter.kind='kcf'"]),
        ("float64", [LOSS, "consensus.trigger=0.3"]),
    ],
    ids=["int12", "loss", "liar", "liar16", "states", "silent"],
)
def test_a_log_is_short_sound_equal_bit_for_bit_and_can_be_read(tmp_path, precision, overrides):
    setting = f"consensus.precision='{precision}'"
    log = open_log(made_log(tmp_path / "run.mcap", "steps=20", "agents.count=5", setting, *overrides))
    assert verify(log.path).result == "equal"
    assert not check_log(log).wrong
    header = read_header(log)
    decoder = Decoder(header, kinds={"round"})
    decoder.take_all(log)
    assert decoder.tally.recorded == 20 * 5 * header.plan.rounds
    shown = list(lines(log, Selection(include=(re.compile(".*/agent/3/round"),))))
    assert len(shown) == 20 * header.plan.rounds
    spoken = sum('"payload":[' in one for one in shown)
    assert spoken == len(shown) if header.scenario.consensus.trigger == 0.0 else 20 < spoken < len(shown)
    assert spoken + sum('"payload":null' in one for one in shown) == len(shown)


def test_where_integers_are_unsound_a_sentence_names_the_remedy():
    for overrides in (["filter.kind='hcmci'"], ["filter.kind='diffusion'"], ["target.motion='maneuver'"]):
        try:
            plan = load("tracking", ["consensus.precision='int12'", *overrides]).plan
        except UserError:
            continue
        if plan.sharing.blocks:
            continue
        with pytest.raises(UserError, match=r"set consensus\.precision = 'float32'"):
            check(plan)
    check(load("tracking", ["consensus.precision='float32'", "filter.kind='diffusion'"]).plan)
