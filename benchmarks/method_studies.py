"""The experiments behind docs/method.md: where the literal filter works, where it fails, and what sicf does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy import consistency, position_mse
from benchmarks.common import analyses
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.arrays import Floats
from zenoh_cbef.scenario import network, paths
from zenoh_cbef.scenario.model import Scenario
from zenoh_cbef.tracking import graph
from zenoh_cbef.tracking.weights import weight_matrix

SIDES = (0.4, 0.6, 0.8, 1.0, 1.25, 1.6, 2.0, 3.0, 5.0, 10.0, 30.0, 100.0)
ROUNDS = (1, 2, 3, 5, 10)
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8)
# The paper's scenario with the recommended filter in place of the literal one, all else equal.
SICF = ("filter.kind=sicf", "filter.xi=1.5", "consensus.weights=metropolis", "filter.start=given")
NO_SATURATION = "filter.xi=1e12"
# Long enough for a wrong velocity to show: 20 s.
LONG = ("steps=2000", "filter.initial_velocity_std=0.5")


@dataclass(frozen=True)
class Scale:
    """What one size of cube does, per seed.

    side: m. cbef, sicf, icf, sicf_near: position MSE (m^2) of the three filters from the same start, and of sicf
    from a start known to 0.3 m. eigenvalue: the largest of any agent's H^T H. radius: see error_radius.
    """

    side: float
    cbef: Floats
    sicf: Floats
    icf: Floats
    sicf_near: Floats
    eigenvalue: Floats
    radius: Floats


@dataclass(frozen=True)
class Spread:
    """Ratio to the centralised filter per seed at one setting, infinite for a seed that broke, and mean NEES."""

    setting: float
    ratios: Floats
    nees: float

    @property
    def broken(self) -> int:
        """Number of seeds in which some agent's estimate or covariance became meaningless."""
        return int(np.isinf(self.ratios).sum())


def paper() -> list[Analysis]:
    return analyses("paper")


def scale(side: float) -> Scale:
    """Put the paper's scenario into a cube of another size, the target in its middle."""
    middle = side / 2.0
    placed = (f"agents.high={side}", f"target.position=[{middle}, {middle}, {middle}]")
    literal = analyses("paper", placed)
    scenarios = [run.trace.scenario for run in literal]
    return Scale(
        side,
        position_mse(literal),
        position_mse(analyses("paper", [*placed, *SICF])),
        position_mse(analyses("paper", [*placed, *SICF, "filter.kind=icf"])),
        position_mse(analyses("paper", [*placed, *SICF, "filter.initial_position_std=0.3"])),
        np.array([largest_eigenvalue(one) for one in scenarios]),
        np.array([error_radius(one) for one in scenarios]),
    )


def _grams(scenario: Scenario) -> tuple[graph.Neighbours, Floats]:
    """Each agent's H^T H over the position, (n, 3, 3)."""
    neighbours = graph.neighbours(scenario.count, network.edges(scenario))
    positions = paths.placement(scenario)
    rows = np.where(neighbours.present[:, :, None], positions[neighbours.index] - positions[:, None, :], 0.0)
    return neighbours, np.asarray(np.swapaxes(rows, 1, 2) @ rows)


def largest_eigenvalue(scenario: Scenario) -> float:
    """Find the largest eigenvalue of H_i^T H_i of any agent, m^2."""
    return float(np.linalg.eigvalsh(_grams(scenario)[1]).max())


def error_radius(scenario: Scenario) -> float:
    """Find the spectral radius of (W^L x I) blockdiag(I - H_i^T H_i).

    The matrix carries the position errors of one step into the next as long as nothing saturates.
    """
    neighbours, grams = _grams(scenario)
    count = scenario.count
    update = np.zeros((3 * count, 3 * count))
    for agent, gram in enumerate(grams):
        block = slice(3 * agent, 3 * agent + 3)
        update[block, block] = np.eye(3) - gram
    weights = weight_matrix(neighbours, network.consensus_weights(scenario, neighbours))
    mixing = np.kron(np.linalg.matrix_power(weights, scenario.consensus.rounds), np.eye(3))
    return float(np.abs(np.linalg.eigvals(mixing @ update)).max())


def network_rmse(runs: Sequence[Analysis], part: str) -> Floats:
    """Root mean square over the agents of position_error or velocity_error, (seeds, K)."""
    return np.stack([np.sqrt((getattr(run, part) ** 2).mean(axis=0)) for run in runs])


def velocity() -> dict[str, list[Analysis]]:
    """Run the paper's scenario for longer, from a poor velocity guess."""
    return {"cbef": analyses("paper", LONG), "sicf": analyses("paper", [*LONG, *SICF])}


def carried_velocity(run: Analysis) -> Floats:
    """Predict cbef's velocity error without running it: the mean initial guess against the truth, (K,)."""
    guess = run.trace.initial[:, 3:].mean(axis=0)
    return np.asarray(np.linalg.norm(guess - run.trace.truth[:, 3:], axis=1))


def saturation() -> dict[str, tuple[list[Analysis], list[Analysis]]]:
    """Run the paper's scenario with and without saturation: clean, and with outliers."""
    dirty = ("sensor.outlier_probability=0.1", "sensor.outlier_scale=5.0")
    return {
        "xi = 1": (analyses("paper"), analyses("paper", dirty)),
        "no saturation": (analyses("paper", [NO_SATURATION]), analyses("paper", [NO_SATURATION, *dirty])),
    }


def innovations(runs: Sequence[Analysis]) -> Floats:
    """Mean over the agents of the innovation's norm, (seeds, K), m^2."""
    return np.stack([run.trace.diagnostics.innovation.mean(axis=0) for run in runs])


def rounds(acceleration: str) -> list[Spread]:
    """Compare tracking with the centralised filter for every number of consensus rounds."""
    return [_spread(count, [f"consensus.rounds={count}", f"consensus.acceleration={acceleration}"]) for count in ROUNDS]


def losses(scheme: str, acceleration: str) -> list[Spread]:
    """Compare tracking at L = 10 with the centralised filter for every loss probability."""
    return [
        _spread(
            probability,
            [
                f'fault=[{{kind="loss", probability={probability}}}]',
                f"consensus.scheme={scheme}",
                f"consensus.acceleration={acceleration}",
            ],
        )
        for probability in LOSSES
    ]


def _spread(setting: float, overrides: Sequence[str]) -> Spread:
    with np.errstate(all="ignore"):  # What breaks is counted.
        runs = analyses("tracking", overrides)
        kept = [run for run in runs if not broken(run)]
        found = np.array([np.inf if broken(run) else run.metrics.ratio_to_centralized for run in runs])
    return Spread(setting, found, consistency(kept).mean if kept else np.nan)


def broken(run: Analysis) -> bool:
    """Tell whether some estimate is not finite, or some covariance not positive definite."""
    states, covariances = run.trace.estimates, run.trace.covariances
    if not (np.isfinite(states).all() and np.isfinite(covariances).all()):
        return True
    return bool((np.linalg.eigvalsh(covariances) <= 0.0).any())


FILTERS = {
    "sicf": (),
    "icf": ("filter.kind=icf",),
    "local": ("filter.kind=local",),
    "cbef": ("filter.kind=cbef", "filter.xi=1.0", "consensus.weights=uniform"),
}


def filters(name: str) -> dict[str, list[Analysis]]:
    """Run every filter on one scenario."""
    return {kind: analyses(name, overrides) for kind, overrides in FILTERS.items()}
