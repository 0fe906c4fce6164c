"""Hypotheses about a run, weighed by their likelihood: starts, and for each a target that manoeuvres or does not.

Each is a bank of models of the motion: one keeps to its models (static multiple models; the likelihood finds the right
one), one is an interacting multiple model (Blom, Bar-Shalom, IEEE TAC 33(8), 1988).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from zenoh_cbef.analysis.strong.models import Models
from zenoh_cbef.analysis.strong.ranged import Heard, update
from zenoh_cbef.arrays import Bools, Floats

_LEAST = -600.0
_CHALLENGE = 0.01
"""How likely it is beforehand that a new start is right and what was believed before is not."""


@dataclass(frozen=True)
class Bank:
    """s starts, each kept (first) and switching (second), each of m models, in r runs.

    mean: (r, s, 2, m, d). covariance: (r, s, 2, m, d, d). mode: (r, s, 2, m) and weight: (r, s, 2), logarithms that are
    normalised within a hypothesis and within a run. surprise: (r,), of the last step's ranges, see Updated.
    """

    mean: Floats
    covariance: Floats
    mode: Floats
    weight: Floats
    surprise: Floats

    @classmethod
    def of(cls, mean: Floats, covariance: Floats, models: int) -> Bank:
        """From starts (r, s, d) and (r, s, d, d) that are equally likely."""
        shape = (*mean.shape[:2], 2, models)
        wide = np.broadcast_to(mean[:, :, None, None], (*shape, mean.shape[2])).copy()
        spread = np.broadcast_to(covariance[:, :, None, None], (*shape, *covariance.shape[2:])).copy()
        weight = np.full(shape[:3], -np.log(2.0 * shape[1]))
        return cls(wide, spread, np.full(shape, -np.log(models)), weight, np.zeros(shape[0]))

    def joined(self, other: Bank, among: Bools) -> Bank:
        """With the starts of another, which get a small weight in these of the runs and none in the rest."""
        theirs = np.where(among, np.log(_CHALLENGE), _LEAST)[:, None, None] + other.weight
        ours = np.where(among, np.log(1.0 - _CHALLENGE), 0.0)[:, None, None] + self.weight
        parts = ((getattr(self, name), getattr(other, name)) for name in ("mean", "covariance", "mode"))
        mean, covariance, mode = (np.concatenate(both, axis=1) for both in parts)
        return Bank(mean, covariance, mode, np.concatenate([ours, theirs], axis=1), self.surprise)

    def best(self) -> Bank:
        """The most likely start of each run alone."""
        runs = np.arange(len(self.weight))
        chosen = _sum(self.weight, 2).argmax(axis=1)
        weight = self.weight[runs, chosen]
        weight = weight - _sum(weight, 1)[:, None]
        mean, covariance, mode = (part[runs, chosen][:, None] for part in (self.mean, self.covariance, self.mode))
        return Bank(mean, covariance, mode, weight[:, None], self.surprise)

    def step(self, models: Models, heard: Heard, passes: int) -> Bank:
        """Predict and take in a step's ranges."""
        mixed = self._interacting(models)
        size = self.mean.shape[4]
        mean, covariance = models.predict(mixed.mean, mixed.covariance)
        many = int(np.prod(self.mode.shape[1:]))
        flat = mean.reshape(-1, many, size), covariance.reshape(-1, many, size, size)
        found = update(*flat, heard, passes)
        mode = mixed.mode + found.evidence.reshape(self.mode.shape)
        evidence = _sum(mode, 3)
        mode = np.maximum(mode - evidence[..., None], _LEAST)
        weight = self.weight + evidence
        weight = np.maximum(weight - _sum(weight, (1, 2))[:, None, None], _LEAST)
        share = np.exp(weight[..., None] + mode)
        surprise = np.sum(share * found.surprise.reshape(mode.shape), axis=(1, 2, 3)) / share.sum(axis=(1, 2, 3))
        mean, covariance = found.mean.reshape(mean.shape), found.covariance.reshape(covariance.shape)
        return Bank(mean, covariance, mode, weight, surprise)

    def estimate(self) -> tuple[Floats, Floats]:
        """Mean (r, d) and covariance (r, d, d) of all hypotheses together."""
        share = np.exp(self.weight[..., None] + self.mode)
        share /= share.sum(axis=(1, 2, 3), keepdims=True)
        mean = np.einsum("rskm,rskmd->rd", share, self.mean)
        apart = self.mean - mean[:, None, None, None]
        spread = self.covariance + apart[..., :, None] * apart[..., None, :]
        return mean, np.einsum("rskm,rskmde->rde", share, spread)

    def _interacting(self, models: Models) -> Bank:
        """The second of each pair, mixed for its models; the first as it is."""
        mode = self.mode[:, :, 1]
        joint = np.exp(mode)[..., None] * models.chance
        expected = joint.sum(axis=2)
        share = joint / expected[:, :, None]
        mean = np.einsum("rsij,rsid->rsjd", share, self.mean[:, :, 1])
        apart = self.mean[:, :, 1, :, None] - mean[:, :, None]
        spread = np.einsum("rsij,rside->rsjde", share, self.covariance[:, :, 1])
        spread += np.einsum("rsij,rsijd,rsije->rsjde", share, apart, apart, optimize=True)
        both = [np.stack([part[:, :, 0], new], axis=2) for part, new in ((self.mean, mean), (self.covariance, spread))]
        mode = np.stack([self.mode[:, :, 0], np.log(expected)], axis=2)
        return replace(self, mean=both[0], covariance=both[1], mode=mode)


def _sum(logarithms: Floats, axis: int | tuple[int, ...]) -> Floats:
    """Logarithm of the sum of exponentials."""
    most = logarithms.max(axis=axis, keepdims=True)
    return np.asarray((most + np.log(np.exp(logarithms - most).sum(axis=axis, keepdims=True))).squeeze(axis))
