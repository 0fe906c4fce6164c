"""A filter's belief moved to another place, with what it has learned of receivers."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.copying import replace
from zenoh_cbef.tracking.filters.around.auto_bias import AutoBias
from zenoh_cbef.tracking.filters.around.mirror_images import MirrorImages
from zenoh_cbef.tracking.filters.around.recovering import Recovering
from zenoh_cbef.tracking.filters.around.wrapping import Wrapping
from zenoh_cbef.tracking.filters.base import Belief, Filter
from zenoh_cbef.tracking.filters.models.biased_information import BiasedInformation
from zenoh_cbef.tracking.filters.models.imm import InteractingModels
from zenoh_cbef.tracking.filters.models.joint_biases import JointBiases
from zenoh_cbef.tracking.filters.models.several_noises import SeveralNoises
from zenoh_cbef.tracking.filters.models.told_ranges import ToldRanges


def moved(chosen: Filter, belief: Belief, place: Belief) -> Belief:
    """A belief of `chosen` with the state and covariance of another one.

    Biases (but such as are beyond belief), learned noise, distrust, and how far biases are relied on stay; motions, and
    mirror images, are as likely as at the start.
    """
    there = replace(belief, state=place.state, covariance=place.covariance)
    if isinstance(chosen, Recovering):
        return moved(chosen.filter, belief, place)
    if isinstance(chosen, Wrapping):
        places = [place]
        if isinstance(chosen, MirrorImages):
            there = replace(there, memory=(np.zeros_like(belief.memory[0]), *belief.memory[1:]))
            places.append(chosen.mirrored(place))
        inner = (moved(chosen.filter, *each) for each in zip(belief.parts, places, strict=False))
        return replace(there, parts=tuple(inner))
    if isinstance(chosen, AutoBias):
        plain, biased = belief.parts
        return replace(there, parts=(moved(chosen.plain, plain, place), moved(chosen.biased, biased, place)))
    if isinstance(chosen, BiasedInformation | JointBiases):
        return replace(there, memory=chosen.moved(belief.memory, place))
    if isinstance(chosen, SeveralNoises | ToldRanges):
        return chosen.moved(belief, place)
    if isinstance(chosen, InteractingModels):
        chance, parts = chosen.switching.begun(place.state, place.known_covariance)
        there = replace(there, chance=chance, parts=tuple(Belief(*one) for one in parts))
    return there
