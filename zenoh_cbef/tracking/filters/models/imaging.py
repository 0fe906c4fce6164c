"""Hypotheses near the plane of the agents, from which the target may leave on either side, and their mirror images."""

from __future__ import annotations

import numpy as np

from zenoh_cbef.tracking.filters.models.mixtures import NEVER, Priors
from zenoh_cbef.tracking.mirroring import Plane, Sides, mirrored


def with_images(priors: Priors, plane: Plane | None) -> Priors:
    """Each hypothesis that may be its own mirror image with that image beside it, as likely as the hypothesis has it.

    How the target came to a plane tells on which side it leaves, as long as it comes fast. Where it is known no better
    than to its own mirror image, ranges tell how high it is next, but not above or below: one Gaussian that takes them
    in leaves on the side to which chance has moved its mean, and is sure of it.

    plane: near which agents are; None: near none.
    """
    if plane is None:
        return priors
    state, covariance, likelihood = priors
    flat, spreads = state.reshape(-1, state.shape[2]), covariance.reshape(-1, *covariance.shape[2:])
    sides = Sides.of(flat, plane)
    unsure = sides.unsure(spreads).reshape(likelihood.shape) & (likelihood > 0.5 * NEVER)
    if not unsure.any():
        return priors
    image, spread = mirrored(flat, spreads, plane)
    less = np.where(unsure, sides.likelier(spreads).reshape(likelihood.shape), np.inf)
    whole = likelihood - np.log1p(np.exp(-less))
    return (
        np.concatenate([state, image.reshape(state.shape)], axis=1),
        np.concatenate([covariance, spread.reshape(covariance.shape)], axis=1),
        np.concatenate([whole, np.maximum(whole - less, NEVER)], axis=1),
    )
