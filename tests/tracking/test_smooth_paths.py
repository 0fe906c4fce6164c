"""A steady filter of a target that does not use its noise claims twice the error's square, whatever the noise is."""

from __future__ import annotations

import numpy as np
import pytest

from zenoh_cbef.tracking.motion import MotionSettings, linear, make_motion


def ratios(kind: str, acceleration_std: float) -> tuple[float, float]:
    """NEES over its ideal before and after a range's update, of a filter whose target has no noise at all.

    P = (1 - K H) M, M = F P F^T + Q is what the filter claims, and X = (1 - K H) F X F^T (1 - K H)^T + K R K^T what it
    errs, each where it has come to rest.
    """
    motion = linear(make_motion(kind, MotionSettings(0.1, acceleration_std, axes=2)))
    size, noise, transition = motion.size, 0.01 * np.eye(2), motion.transition
    row = np.eye(2, size)
    claimed, erring = np.eye(size), np.eye(size)
    for _ in range(20_000):
        ahead, errs = transition @ claimed @ transition.T + motion.process_noise, transition @ erring @ transition.T
        gain = ahead @ row.T @ np.linalg.inv(row @ ahead @ row.T + noise)
        rest = np.eye(size) - gain @ row
        claimed = rest @ ahead @ rest.T + gain @ noise @ gain.T
        erring = rest @ errs @ rest.T + gain @ noise @ gain.T
    before, after = (np.trace(np.linalg.solve(*one)) / size for one in ((ahead, errs), (claimed, erring)))
    return float(before), float(after)


@pytest.mark.parametrize("acceleration_std", [0.1, 3.0, 100.0])
def test_claims_before_and_after_ranges_are_one_half_on_average(acceleration_std: float) -> None:
    before, after = ratios("ncv", acceleration_std)
    assert 0.5 * (before + after) == pytest.approx(0.5, abs=1e-6)
    assert before <= 0.5 <= after < 0.8


@pytest.mark.parametrize("kind", ["jump", "acceleration"])
def test_motions_whose_noise_comes_at_any_moment_of_a_step_claim_more(kind: str) -> None:
    for acceleration_std in (0.1, 3.0, 100.0):
        before, after = ratios(kind, acceleration_std)
        assert 0.5 * (before + after) < 0.5
        assert after < 0.7
