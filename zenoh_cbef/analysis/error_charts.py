"""The report's figures beyond the paper's: errors, and whether the claimed covariances are consistent with them."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.analysis.averages import mean_over_agents, rms_over_agents
from zenoh_cbef.analysis.claimed import claimed_position_error
from zenoh_cbef.analysis.consistency import chi2_band, trailing_mean
from zenoh_cbef.analysis.coverage import truth_steps
from zenoh_cbef.analysis.figures import Chart, Reference, few_lines
from zenoh_cbef.analysis.metrics import Analysis

_NIS_STEPS = 20


def error_charts(analysis: Analysis) -> list[Chart]:
    """Describe the position error, NEES, NIS and disagreement of each agent or of all."""
    average = mean_over_agents(analysis.nees)
    charts = (
        _position_chart(analysis),
        Chart(
            "nees",
            "Normalised estimation error squared (NEES)",
            "The error in units of the agent's own covariance. A consistent filter stays inside the shaded 95 % "
            "band; above it a filter is overconfident, below it too cautious.",
            "NEES",
            analysis.nees,
            (Reference("mean of the agents", "network", average),),
            band=analysis.nees_band,
            scored=True,
        ),
        _nis_chart(analysis),
        Chart(
            "disagreement",
            "Disagreement",
            "Root mean square distance of the agents' position estimates from their mean.",
            "disagreement (m)",
            None,
            (Reference("network", "network", analysis.disagreement),),
            scored=True,
        ),
    )
    return [few_lines(chart) for chart in charts]


def _position_chart(analysis: Analysis) -> Chart:
    """The position errors, or, where the truth is not known, what the covariances say that they are."""
    if not truth_steps(analysis.trace).any():
        return Chart(
            "position-error",
            "Position error that each agent claims",
            "Root of the trace of each covariance's position block: it needs no truth, and is as honest as the filter.",
            "claimed position error (m)",
            claimed_position_error(analysis.trace),
            scored=True,
        )
    references = [
        Reference("centralised filter", "centralized", analysis.centralized_position_error),
        Reference("posterior bound", "bound", analysis.bound_position_error),
    ]
    caption = "Distance of each agent's estimate from the truth. Bound: root of its position block's trace."
    if analysis.smoothed is not None:
        smoothed = rms_over_agents(analysis.smoothed.position[analysis.counted])
        references.append(Reference("smoothed", "network", smoothed))
        caption += " Smoothed: root mean square of the agents' smoothed estimates."
    return Chart(
        "position-error",
        "Position error of each agent",
        caption,
        "position error (m)",
        analysis.position_error,
        tuple(references),
        scored=True,
    )


def _nis_chart(analysis: Analysis) -> Chart:
    trace = analysis.trace
    degrees = trace.diagnostics.nis_degrees[trace.diagnostics.nis_degrees > 0]
    usual = float(np.median(degrees)) if degrees.size else 1.0
    low, high = chi2_band(usual, _NIS_STEPS)
    return Chart(
        "nis",
        "Normalised innovation squared (NIS)",
        "How large innovations are, in units of the variance that the agent predicted for them, before saturation: "
        f"per degree of freedom, mean of the last {_NIS_STEPS} steps. It needs no truth. A consistent filter stays "
        "inside the shaded 95 % band; above it a filter is overconfident, or measurements are worse than assumed.",
        "NIS per degree of freedom",
        trailing_mean(trace.diagnostics.nis, trace.diagnostics.nis_degrees, _NIS_STEPS),
        band=(low / usual, high / usual),
        scored=True,
    )
