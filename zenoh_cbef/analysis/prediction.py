"""The error of an information filter's network, propagated along a path before any run."""

from __future__ import annotations

from dataclasses import dataclass
from math import erf, exp, pi, sqrt

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import inverse, matvec, outer
from zenoh_cbef.tracking.motion import LinearMotion

_LEAST = 1e-12


@dataclass(frozen=True)
class Sight:
    """What n agents measure in K steps: gradients of their ranges, (K, n, s), zero where nothing is measured.

    range_std: m. The gradients are those at the truth, so prediction is first order in the error.
    """

    rows: Floats
    range_std: float


@dataclass(frozen=True)
class Clipping:
    """Moments of the saturation gain w = min(1, xi/|u|) of a standard normal innovation u; all 1 without saturation.

    gain: E w u^2. power: E w^2 u^2. weight: E w. square: E w^2.
    """

    gain: float
    power: float
    weight: float
    square: float

    @classmethod
    def at(cls, xi: float) -> Clipping:
        """The moments of the clipped normal, in closed form but for the weight."""
        if xi == np.inf:
            return cls(1.0, 1.0, 1.0, 1.0)
        inner = erf(xi / sqrt(2.0))
        density = exp(-0.5 * xi * xi) / sqrt(2.0 * pi)
        # E[1/u; u > xi] has no closed form; the midpoint rule in log u is good to six digits.
        edges = np.linspace(np.log(xi), np.log(max(xi, 1.0) * 40.0), 4001)
        middle = np.exp(0.5 * (edges[:-1] + edges[1:]))
        tail = float(np.sum(np.exp(-0.5 * middle * middle))) * (edges[1] - edges[0]) / sqrt(2.0 * pi)
        outer_part = 1.0 - inner
        power = inner - 2.0 * xi * density + xi * xi * outer_part
        square = inner + 2.0 * xi * density - xi * xi * outer_part
        return cls(inner, power, inner + 2.0 * xi * tail, square)

    def linearised(self, share: Floats) -> tuple[Floats, Floats]:
        """How saturated noise w v depends on the prior's error, and its mean square in units of the innovation's.

        For a Gaussian innovation z = v - h e, of whose variance h e has the given share, w v is this coefficient
        times h e, plus what is uncorrelated with it (statistical linearisation).
        """
        coefficient = (1.0 - share) * (self.weight - self.gain)
        total = (1.0 - share) ** 2 * self.power + share * (1.0 - share) * self.square
        return coefficient, np.maximum(total - coefficient**2 * share, 0.0)


@dataclass(frozen=True)
class Expected:
    """Expected squared errors for c ways of averaging, mean over agents, (c, K), m^2 and m^2/s^2; NEES (c, K)."""

    position: Floats
    velocity: Floats
    nees: Floats


def propagate(
    initial: Floats,
    motion: LinearMotion,
    sight: Sight,
    mixing: Floats,
    *,
    weight: Floats,
    clipping: Clipping,
) -> Expected:
    """Expected errors of icf, sicf, hcmci and ci: the recursion of claimed covariances and of true ones.

    Agent j shares Y_j = P_j^-1 + beta_j w h_j h_j^T/sigma^2, and i claims P_i = (sum_j M_ij Y_j)^-1; M is what L rounds
    do to a payload, beta n for icf and sicf (less where averages are of few), omega for hcmci, 1 for the rest. Errors:

        e_i <- P_i sum_j M_ij [ P_j^-1 e_j + beta_j w_j h_j v_j/sigma^2 ]

    with range noise v_j and saturation gain w_j, which is 1 without saturation and else replaced by its statistical
    linearisation. So the joint covariance of all agents' errors, with the correlations between agents, is
    propagated exactly as far as the linearisation holds.

    initial: (s, s), of independent first guesses. mixing: (c, K or 1, n, n). weight: beta, (c, n).
    """
    ways, agents = len(mixing), mixing.shape[-1]
    steps, _, size = sight.rows.shape
    claimed = np.broadcast_to(initial, (ways, agents, size, size))
    error = np.broadcast_to(np.kron(np.eye(agents), initial), (ways, agents * size, agents * size))
    forward = np.kron(np.eye(agents), motion.transition)
    process = np.kron(np.ones((agents, agents)), motion.process_noise)
    variance, axes, beta = sight.range_std**2, motion.axes, weight[:, :, None, None]
    own, joined = np.empty((2, ways, steps, agents, size, size))
    for k in range(steps):
        rows, how = sight.rows[k], mixing[:, k if mixing.shape[1] > 1 else 0]
        claimed = motion.predict_covariance(claimed)
        error = forward @ error @ forward.T + process
        prior, square = inverse(claimed), outer(rows, rows) / variance
        spread = np.sum(rows * matvec(claimed, np.broadcast_to(rows, (ways, *rows.shape))), axis=2) + variance
        shared = prior + beta * clipping.weight * square
        how, joined[:, k] = _mixed(how, shared)
        claimed = inverse(joined[:, k])
        coefficient, power = clipping.linearised(1.0 - variance / spread)
        kept = prior + beta * coefficient[:, :, None, None] * square
        carried = claimed[:, :, None] @ (how[:, :, :, None, None] * kept[:, None])
        carried = np.swapaxes(carried, 2, 3).reshape(ways, agents * size, agents * size)
        noise = np.sqrt(spread * power)
        pushed = weight[:, None, :, None] / variance * noise[:, None, :, None] * how[:, :, :, None] * rows
        pushed = (claimed @ np.swapaxes(pushed, 2, 3)).reshape(ways, agents * size, agents)
        error = carried @ error @ np.swapaxes(carried, 1, 2) + pushed @ np.swapaxes(pushed, 1, 2)
        own[:, k] = np.einsum("caiaj->caij", error.reshape(ways, agents, size, agents, size))
    return _scores(own, joined, axes)


def _scores(own: Floats, joined: Floats, axes: int) -> Expected:
    """Means over agents, of the covariances of their errors and the information that they claim, (c, K, n, s, s)."""
    spreads = np.einsum("ckaii->ckai", own)
    nees = np.einsum("ckaij,ckaji->cka", joined, own)
    parts = spreads[..., :axes].sum(axis=3), spreads[..., axes:].sum(axis=3), nees
    return Expected(*(part.mean(axis=2) for part in parts))


def _mixed(how: Floats, shared: Floats) -> tuple[Floats, Floats]:
    """The agents' information after averaging; an agent whose result is no information keeps its own, as in filters."""
    shape = shared.shape
    joined = (how @ shared.reshape(*shape[:2], -1)).reshape(shape)
    eigenvalues = np.linalg.eigvalsh(joined)
    sound = eigenvalues[:, :, 0] > _LEAST * eigenvalues[:, :, -1]
    how = np.where(sound[:, :, None], how, np.eye(shape[1]))
    return how, np.where(sound[:, :, None, None], joined, shared)
