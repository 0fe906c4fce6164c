"""The filters by kind. Adding one is a file with a class as in base.py, and a line here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from zenoh_cbef.tracking.filters.auto_bias import AutoBias
from zenoh_cbef.tracking.filters.base import Belief, Filter, Update
from zenoh_cbef.tracking.filters.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.cbef import Cbef
from zenoh_cbef.tracking.filters.cbef_scaled import ScaledCbef
from zenoh_cbef.tracking.filters.ci import CovarianceIntersection
from zenoh_cbef.tracking.filters.diffusion import Diffusion
from zenoh_cbef.tracking.filters.distrusting import Distrusting
from zenoh_cbef.tracking.filters.first_fix import FirstFix
from zenoh_cbef.tracking.filters.hcmci import HybridConsensus
from zenoh_cbef.tracking.filters.information import SaturatedInformation
from zenoh_cbef.tracking.filters.kcf import KalmanConsensus
from zenoh_cbef.tracking.filters.learned_noise import LearnedNoise
from zenoh_cbef.tracking.filters.recovering import Recovering
from zenoh_cbef.tracking.motion import NearlyConstantVelocity
from zenoh_cbef.tracking.ranging import Space

__all__ = [
    "BIASED",
    "DIFFERENCED",
    "INFORMATION",
    "KINDS",
    "NOISE_LEARNED",
    "SATURATED",
    "WITHOUT_COVARIANCE",
    "Belief",
    "Cbef",
    "Filter",
    "FilterSettings",
    "SaturatedInformation",
    "Update",
    "make_filter",
]


@dataclass(frozen=True)
class FilterSettings:
    """What any filter may need to know.

    range_std: m; learns_noise: it is where learning it begins. xi, omega: see the filter; omega None: network_size.
    network_size: number of agents. differenced: whether ci and local take in differences of ranges in place of the
    agent's own range. power: of the saturation. recovers: whether the network widens its covariances where most
    agents are surprised. distrusts: whether agents weigh down their own ranges while these stay implausible. bias:
    none, estimate or auto; common_bias_std, own_bias_std: its prior, m. first_fix: over how many steps the initial
    estimate, a guess, is improved by least squares on the first ranges; 0: it is none.
    """

    motion: NearlyConstantVelocity
    space: Space
    range_std: float
    xi: float
    network_size: int
    omega: float | None = None
    differenced: bool = False
    power: int = 1
    recovers: bool = False
    distrusts: bool = False
    bias: str = "none"
    common_bias_std: float = 0.0
    own_bias_std: float = 0.0
    learns_noise: bool = False
    first_fix: int = 0


def _information(settings: FilterSettings, xi: float) -> Filter:
    plain = SaturatedInformation(
        settings.motion, settings.space, settings.range_std, settings.network_size, xi, settings.power
    )
    biased = BiasedInformation(
        settings.motion,
        settings.space,
        settings.range_std,
        settings.network_size,
        settings.common_bias_std,
        settings.own_bias_std,
        xi,
        settings.power,
    )
    if settings.bias == "none":
        return plain
    return biased if settings.bias == "estimate" else AutoBias(plain, biased)


def _intersection(settings: FilterSettings, *, cooperates: bool) -> Filter:
    return CovarianceIntersection(
        settings.motion,
        settings.space,
        settings.range_std,
        settings.xi,
        settings.differenced,
        cooperates,
        settings.power,
    )


def _hcmci(settings: FilterSettings) -> Filter:
    omega = float(settings.network_size) if settings.omega is None else settings.omega
    return HybridConsensus(settings.motion, settings.space, settings.range_std, omega, settings.xi, settings.power)


KINDS: dict[str, Callable[[FilterSettings], Filter]] = {
    "sicf": lambda settings: _information(settings, settings.xi),
    "icf": lambda settings: _information(settings, np.inf),
    "hcmci": _hcmci,
    "ci": lambda settings: _intersection(settings, cooperates=True),
    "kcf": lambda settings: KalmanConsensus(settings.motion, settings.space, settings.range_std),
    "diffusion": lambda settings: Diffusion(settings.motion, settings.space, settings.range_std),
    "cbef": lambda settings: Cbef(settings.motion, settings.space, settings.xi),
    "cbef-scaled": lambda settings: ScaledCbef(settings.motion, settings.space, settings.xi),
    "local": lambda settings: _intersection(settings, cooperates=False),
}

INFORMATION = ("sicf", "icf", "hcmci", "ci")
"""The kinds whose payload is information, of which any convex combination is meaningful."""

SATURATED = ("sicf", "hcmci", "ci", "local")
"""The kinds that saturate ranges at xi of their standard deviations."""

DIFFERENCED = ("cbef", "cbef-scaled", "ci", "local")
"""The kinds that may take in differences of ranges; the others would count shared noise more than once."""

WITHOUT_COVARIANCE = ("cbef", "cbef-scaled")
"""The kinds that claim nothing about their error."""


BIASED = ("sicf", "icf")
"""The kinds that estimate biases of ranges, and that begin with a first fix."""

NOISE_LEARNED = ("sicf", "icf", "hcmci", "ci", "local")
"""The kinds for which the range noise can be learned online."""


def first_fix_of(settings: FilterSettings, then: Filter, xi: float) -> FirstFix:
    """The first fix before a filter."""
    bias_std = 0.0 if settings.bias == "none" else float(np.hypot(settings.common_bias_std, settings.own_bias_std))
    return FirstFix(
        then,
        settings.motion,
        settings.space,
        settings.range_std,
        bias_std,
        settings.network_size,
        settings.first_fix,
        xi,
    )


def make_filter(kind: str, settings: FilterSettings) -> Filter:
    """The filter of one kind, with what the settings put around it."""
    chosen = KINDS[kind](settings)
    # Recovery widens the belief that the filter goes on from, so nothing else may stand between the two.
    if settings.recovers:
        chosen = Recovering(chosen)
    if settings.distrusts:
        chosen = Distrusting(chosen, settings.range_std)
    if settings.first_fix:
        chosen = first_fix_of(settings, chosen, settings.xi if kind in SATURATED else np.inf)
    return LearnedNoise(chosen, settings.range_std) if settings.learns_noise else chosen
