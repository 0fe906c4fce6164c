"""Motions that are alike are computed as rows of one batch, with the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.scenario.load import load
from zenoh_cbef.simulator import simulate
from zenoh_cbef.tracking.filters.models import abreast as module
from zenoh_cbef.tracking.filters.models.abreast import abreast
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.motion.turn import CoordinatedTurn

CALM, AGILE = NearlyConstantVelocity(0.1, 0.02), NearlyConstantVelocity(0.1, 5.0)
ROUND, KEEPS = CoordinatedTurn(0.1, 0.02), CoordinatedTurn(0.1, 0.02, keeps_speed=True)


def test_motions_that_are_alike_are_one_call_and_each_gets_its_rows():
    called = []

    def compute(motion, rows):
        called.append((motion, rows[0][:, 0].tolist()))
        return rows[0] * 2.0, rows[1]

    each = [(np.full((2, 3), float(k)), np.full(2, 10.0 * k)) for k in range(4)]
    found = abreast([CALM, ROUND, AGILE, KEEPS], each, compute)
    assert called == [(CALM, [0, 0, 2, 2]), (ROUND, [1, 1]), (KEEPS, [3, 3])]
    assert [one[0][0, 0] for one in found] == [0.0, 2.0, 4.0, 6.0]
    assert [one[1].tolist() for one in found] == [[10.0 * k] * 2 for k in range(4)]


@pytest.mark.parametrize("more", [(), ("sensor.bias_std=0.5", "sensor.outlier_probability=0.2")])
def test_runs_are_the_same_bits_however_motions_are_computed(more, monkeypatch):
    scenario = load("tracking", ["target.motion=circle", "steps=15", *more]).scenario
    traces = []
    for few in (64, 0):
        monkeypatch.setattr(module, "_FEW", few)
        traces += simulate([scenario])
    assert traces[0].estimates.tobytes() == traces[1].estimates.tobytes()
    assert traces[0].covariances.tobytes() == traces[1].covariances.tobytes()
