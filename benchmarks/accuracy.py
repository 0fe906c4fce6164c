"""How close the network comes to one filter that sees everything, over many seeds, in simulation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.common import SEEDS, Row, analyses, at_least, below, results
from zenoh_cbef.analysis.consistency import chi2_band
from zenoh_cbef.analysis.metrics import Analysis
from zenoh_cbef.analysis.summary import pick
from zenoh_cbef.arrays import Floats
from zenoh_cbef.numbers import number


@dataclass(frozen=True)
class Consistency:
    """A statistic averaged over s seeds, per agent and step.

    averaged: (n, K). band: where it lies with 95 % probability if the covariances are right. mean: over agents
    and the scored window. inside, under, over: shares of (agent, step) pairs of that window.
    """

    averaged: Floats
    band: tuple[float, float]
    mean: float
    inside: float
    under: float
    over: float


def over_seeds(values: Floats, degrees: float, first: int) -> Consistency:
    """Compare a statistic of independent runs, (s, n, K), with the chi-squared distribution of s x degrees.

    Agents that agree are not independent of one another, so the average is over seeds only. first: index of the
    first step of the scored window.
    """
    band = chi2_band(degrees, len(values))
    averaged = values.mean(axis=0)
    scored = averaged[:, first:]
    under, over = float((scored < band[0]).mean()), float((scored > band[1]).mean())
    return Consistency(averaged, band, float(scored.mean()), 1.0 - under - over, under, over)


def ratios(runs: Sequence[Analysis]) -> Floats:
    """Position RMSE over that of the centralised filter, per seed; NaN where no estimate was finite."""
    return np.array([run.metrics.ratio_to_centralized or np.nan for run in runs])


def position_mse(runs: Sequence[Analysis]) -> Floats:
    """Mean square position error over agents and the scored window, per seed, m^2."""
    return np.array([(run.metrics.position_rmse or np.nan) ** 2 for run in runs])


def consistency(runs: Sequence[Analysis]) -> Consistency:
    """Compare NEES with the chi-squared distribution of s x 6 degrees, divided by s."""
    dimension = len(runs[0].trace.plan.space.kept)
    return over_seeds(np.stack([run.nees for run in runs]), dimension, runs[0].first)


def outlier_factors(dirty: Sequence[Analysis], clean: Sequence[Analysis]) -> Floats:
    """Position MSE over that of the same seed without outliers, per seed."""
    return position_mse(dirty) / position_mse(clean)


def msee_factors(runs: Sequence[Analysis]) -> Floats:
    """Find by what factor the average MSEE falls from step 1 to the last, per seed; below 1 if it rises."""
    return np.array([run.msee_average[0] / run.msee_average[-1] for run in runs])


def saturation_price(runs: Sequence[Analysis], plain: Sequence[Analysis]) -> float:
    """Compare with a centralised filter that does not saturate: median over seeds of the position RMSE ratio.

    The yardstick of a saturating filter saturates, too; `plain` are runs of icf, whose yardstick does not.
    """
    return float(
        np.median(
            [
                pick(run.metrics, "position_rmse") / pick(other.metrics, "centralized.position_rmse")
                for run, other in zip(runs, plain, strict=True)
            ]
        )
    )


def tracking_rows(runs: Sequence[Analysis], plain: Sequence[Analysis]) -> list[Row]:
    ratio, nees = ratios(runs), consistency(runs)
    low, high = nees.band
    band = f"{low:.3f} to {high:.3f}"
    return [
        below("position RMSE / centralised, median", float(np.median(ratio)), 1.01),
        Row("position RMSE / centralised, worst seed", number(float(ratio.max()))),
        Row("position RMSE / unsaturated centralised, median", number(saturation_price(runs, plain))),
        Row("NEES, mean over seeds, agents and steps", number(nees.mean), band, low <= nees.mean <= high),
        at_least(f"steps with ANEES of {len(runs)} seeds in {band}", nees.inside, 0.95),
        Row("steps below the band (too cautious)", number(nees.under)),
        Row("steps above the band (too confident)", number(nees.over)),
    ]


def outlier_rows(dirty: Sequence[Analysis], clean: Sequence[Analysis]) -> list[Row]:
    factor = outlier_factors(dirty, clean)
    return [
        below("position MSE / clean, median", float(np.median(factor)), 2.0),
        Row("position MSE / clean, worst seed", number(float(factor.max()))),
        Row("position RMSE with outliers, median", number(float(np.median(np.sqrt(position_mse(dirty)))), "m")),
        Row("position RMSE clean, median", number(float(np.median(np.sqrt(position_mse(clean)))), "m")),
    ]


def paper_rows(runs: Sequence[Analysis]) -> list[Row]:
    factor = msee_factors(runs)
    return [
        at_least("seeds whose average MSEE falls", float((factor > 1.0).sum()), float(len(runs))),
        Row("falls by, median", f"{np.median(factor):.1f}x", "> 20x", bool(np.median(factor) > 20.0)),
        Row("falls by, least", f"{factor.min():.1f}x"),
    ]


def run(repeats: int) -> Iterator[Table]:
    """Nothing is timed, so nothing is repeated."""
    del repeats
    tracking, plain = analyses("tracking"), analyses("tracking", ["filter.kind=icf"])
    yield results(f"tracking: sicf, L = 10, {SEEDS} seeds", tracking_rows(tracking, plain))
    clean = analyses("outliers", ["sensor.outlier_probability=0.0"])
    title = f"outliers: 10 % of ranges, exponential, mean 5 m, {SEEDS} seeds"
    yield results(title, outlier_rows(analyses("outliers"), clean))
    yield results(f"paper: literal cbef, {SEEDS} seeds", paper_rows(analyses("paper")))
