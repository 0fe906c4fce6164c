"""The filters by kind. Adding one is a file in kinds/ with a class as in base.py, and a line here.

A kind of another package is named by its class, see plugins.py.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from zenoh_cbef.plugins import Registry
from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.auto_bias import AutoBias
from zenoh_cbef.tracking.filters.around.bursts import Bursts
from zenoh_cbef.tracking.filters.around.curving import Curving
from zenoh_cbef.tracking.filters.around.cut_off import CutOff
from zenoh_cbef.tracking.filters.around.distrusting import Distrusting
from zenoh_cbef.tracking.filters.around.doubted_noise import DoubtedNoise
from zenoh_cbef.tracking.filters.around.evidence import SQUARES, Evidence
from zenoh_cbef.tracking.filters.around.fitting import Fitting
from zenoh_cbef.tracking.filters.around.lasting_errors import LastingErrors
from zenoh_cbef.tracking.filters.around.learned_noise import LearnedNoise
from zenoh_cbef.tracking.filters.around.mirror_images import MirrorImages
from zenoh_cbef.tracking.filters.around.recovering import Recovering
from zenoh_cbef.tracking.filters.around.returning import Returning
from zenoh_cbef.tracking.filters.around.sudden import Sudden
from zenoh_cbef.tracking.filters.base import Abilities, Belief, Filter, Kind, Sharing, Update, filter_of
from zenoh_cbef.tracking.filters.finding.knowing import Knowing
from zenoh_cbef.tracking.filters.finding.one_side import OneSide
from zenoh_cbef.tracking.filters.finding.reacquiring import Reacquiring
from zenoh_cbef.tracking.filters.finding.supposing import Supposing
from zenoh_cbef.tracking.filters.finding.tried_guess import first_fix
from zenoh_cbef.tracking.filters.information_form import packed_size
from zenoh_cbef.tracking.filters.kinds.cbef import Cbef
from zenoh_cbef.tracking.filters.kinds.cbef_scaled import ScaledCbef
from zenoh_cbef.tracking.filters.kinds.ci import CovarianceIntersection
from zenoh_cbef.tracking.filters.kinds.diffusion import Diffusion
from zenoh_cbef.tracking.filters.kinds.hcmci import HybridConsensus
from zenoh_cbef.tracking.filters.kinds.icf import InformationWeighted
from zenoh_cbef.tracking.filters.kinds.kcf import KalmanConsensus
from zenoh_cbef.tracking.filters.kinds.local import Local
from zenoh_cbef.tracking.filters.kinds.sicf import SaturatedInformation
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.imm import InteractingModels
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.filters.models.several_noises import SeveralNoises
from zenoh_cbef.tracking.filters.models.squared_information import SquaredInformation
from zenoh_cbef.tracking.filters.models.told_ranges import ToldRanges
from zenoh_cbef.tracking.filters.plugged import PluggedFilter
from zenoh_cbef.tracking.filters.settings import FilterSettings
from zenoh_cbef.tracking.payloads import InformationPayloads, Payloads, SeveralPayloads, StatePayloads

__all__ = [
    "KINDS",
    "Abilities",
    "Belief",
    "Filter",
    "FilterSettings",
    "Sharing",
    "Update",
    "abilities_of",
    "kind_of",
    "level_of",
    "make_filter",
    "mark_of",
    "options_of",
    "payloads_of",
    "sharing_of",
]

KINDS: dict[str, type[Kind]] = {
    "sicf": SaturatedInformation,
    "icf": InformationWeighted,
    "hcmci": HybridConsensus,
    "ci": CovarianceIntersection,
    "kcf": KalmanConsensus,
    "diffusion": Diffusion,
    "cbef": Cbef,
    "cbef-scaled": ScaledCbef,
    "local": Local,
}


_REGISTRY: Registry[Kind] = Registry("filters", KINDS, filter_of)
kind_of, mark_of, options_of = _REGISTRY.kind_of, _REGISTRY.mark_of, _REGISTRY.options_of


def abilities_of(kind: str) -> Abilities:
    """What a kind of filter can do."""
    return kind_of(kind).abilities


def level_of(kind: str, xi: float) -> float:
    """At how many standard deviations a kind of filter saturates ranges, infinite for one that does not."""
    return xi if abilities_of(kind).saturates else np.inf


def sharing_of(kind: str, settings: FilterSettings) -> Sharing:
    """What agents with the filter of one kind exchange, with what the settings put around it."""
    own = KINDS[kind].sharing if kind in KINDS else partial(PluggedFilter.sharing, kind_of(kind))
    one = SquaredInformation.sharing if settings.squares else own
    if settings.tells_ranges:
        shared = ToldRanges.sharing(settings)
    else:
        several = SeveralNoises.sharing if settings.noises else InteractingModels.sharing
        shared = several(settings, one) if settings.models or settings.noises else one(settings)
    if settings.bias != "none" and not settings.tells_ranges:
        biased = (JointBiases if settings.joint_biases else BiasedInformation).sharing(replace(settings, scale_std=0.0))
        if settings.scale_std:
            biased = AutoBias.sharing(biased, JointBiases.sharing(settings), _of_shares(settings))
        shared = biased if settings.bias == "estimate" else AutoBias.sharing(shared, biased, _of_biases(settings))
    shared = shared.longer(
        (settings.recovers > 0.0) * Recovering.more
        + settings.distrusts * Distrusting.more
        + Bursts.wanted(settings) * Bursts.more
    )
    if settings.plane and not settings.tells_ranges:
        shared = replace(shared.longer(shared.payload_size + MirrorImages.more), blocks=shared.blocks * 2)
    more = (
        LastingErrors.numbers(settings)
        + DoubtedNoise.numbers(settings)
        + settings.says_status * Knowing.numbers(settings)
        + (settings.reacquires > 0) * Reacquiring.more
        + settings.supposes * Supposing.more
        + OneSide.numbers(settings)
        + CutOff.numbers(settings)
    )
    return shared.longer(more)


def payloads_of(kind: str, settings: FilterSettings) -> Payloads:
    """How to read the payloads of the filter of one kind, with what the settings put around it."""
    axes, size = settings.space.axes, settings.motion.size
    if settings.tells_ranges or settings.noises or not abilities_of(kind).information:
        return StatePayloads(axes)
    if settings.models or settings.plane:
        sizes = [one.size for one in settings.models] or sharing_of(kind, settings).blocks
        return SeveralPayloads(tuple(InformationPayloads(axes, one) for one in sizes))
    omega = float(settings.network_size) if settings.omega is None else settings.omega
    return InformationPayloads(axes, size + settings.constants, (1.0, omega) if kind == "hcmci" else (1.0,))


def make_filter(kind: str, settings: FilterSettings) -> Filter:
    """The filter of one kind, with what the settings put around it."""
    xi = level_of(kind, settings.xi)
    chosen = _innermost(kind, settings, xi)
    if settings.fits:
        chosen = Fitting(chosen, settings.space, settings.range_std)
    # These widen the belief that the filter goes on from, so nothing else may stand between.
    if settings.recovers:
        chosen = Sudden(chosen, settings.sudden) if settings.sudden else Recovering(chosen, settings.recovers)
    if settings.distrusts:
        repeats = not settings.presumes
        chosen = Distrusting(chosen, settings.range_std, repeats=repeats, silence=settings.silence)
    if Bursts.wanted(settings):
        chosen = Bursts(chosen, settings.space, settings.range_std)
    chosen = _bent(kind, settings, chosen)
    chosen = _begun(kind, settings, chosen, xi)
    if settings.doubts_noise:
        chosen = DoubtedNoise.of(settings, chosen)
    if settings.lasting:
        chosen = LastingErrors.of(settings, chosen)
    elif settings.learns_noise:
        chosen = LearnedNoise(chosen, settings.range_std, settings.wrong_share)
    if settings.says_status:
        chosen = _knowing(kind, settings, chosen, xi)
    return CutOff(chosen, settings) if settings.cut_off else chosen


def _innermost(kind: str, settings: FilterSettings, xi: float) -> Filter:
    """What takes in the ranges: of one motion or of several, with biases or without."""
    if settings.tells_ranges:
        return ToldRanges.of(settings)
    own = KINDS[kind].of if kind in KINDS else partial(PluggedFilter.of, kind_of(kind))

    def one(settings: FilterSettings) -> Filter:
        return SquaredInformation.of(settings, xi) if settings.squares else own(settings)

    if settings.noises:
        plain: Filter = SeveralNoises.of(settings, one)
    else:
        plain = InteractingModels.of(settings, one) if settings.models else one(settings)
    return plain if settings.bias == "none" else _biased(settings, plain, xi)


def _biased(settings: FilterSettings, plain: Filter, xi: float) -> Filter:
    """The filter that estimates biases, or weighs them beside the plain one."""
    of_one = (JointBiases if settings.joint_biases else BiasedInformation).of
    biased: BiasedInformation | JointBiases | AutoBias = of_one(replace(settings, scale_std=0.0), xi)
    if settings.scale_std:
        biased = AutoBias(biased, JointBiases.of(settings, xi), _of_shares(settings))
    return biased if settings.bias == "estimate" else AutoBias(plain, biased, _of_biases(settings))


def _of_biases(settings: FilterSettings) -> Evidence:
    """What decides whether to rely on biases."""
    lasting, presumes = settings.weighs_lasting, settings.presumes_biases
    how = {"lasting": lasting, "presumes": presumes, "opens": settings.opens_biases}
    return Evidence(settings.likelihoods, settings.recorded, **how)


def _of_shares(settings: FilterSettings) -> Evidence:
    """What decides whether to rely on a share of all ranges."""
    return replace(SQUARES, lasting=settings.weighs_shares, presumes=settings.presumes_biases)


def _bent(kind: str, settings: FilterSettings, chosen: Filter) -> Filter:
    """A filter for which ranges bend, of all agents or of one that was alone."""
    if settings.curves:
        chosen = Curving(chosen, settings.motion, settings.space, settings.range_std)
    plain = not (settings.squares or settings.tells_ranges)
    if settings.returns and settings.network_size > 1 and abilities_of(kind).biases and plain:
        chosen = Returning(chosen, settings.space, settings.range_std, newcomers=settings.cut_off > 0)
    return chosen


def _begun(kind: str, settings: FilterSettings, chosen: Filter, xi: float) -> Filter:
    """A filter with its mirror image, where there is one, after a first fix."""
    if settings.plane and not settings.tells_ranges:
        blocks = sharing_of(kind, settings).blocks
        chosen = MirrorImages(chosen, settings, sum(map(packed_size, blocks)) // 2)
    if not settings.first_fix:
        return chosen
    alone = replace(settings, says_status=False, reacquires=0, supposes=False, cut_off=0, lasting=False)
    alone = replace(alone, doubts_noise=False)
    return first_fix(settings, chosen, xi, sharing_of(kind, alone).payload_size)


def _knowing(kind: str, settings: FilterSettings, chosen: Filter, xi: float) -> Filter:
    """A filter with what says what its estimate is worth, and looks for the target again where that is too little."""
    chosen = known = Knowing(chosen, settings)
    if settings.reacquires:
        size = sharing_of(kind, replace(settings, reacquires=0, supposes=False, cut_off=0, sides=False)).payload_size
        chosen = searching = Reacquiring.of(settings, known, xi, size)
        if settings.supposes:
            chosen = Supposing.of(settings, searching, size + Reacquiring.more)
    return OneSide(chosen, settings) if settings.sides else chosen
