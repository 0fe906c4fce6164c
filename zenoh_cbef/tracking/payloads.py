"""How to read a neighbour's payload: its distance from another one, and how a misbehaving agent falsifies it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from zenoh_cbef.arrays import Floats
from zenoh_cbef.tracking.linalg import inverse, matvec, pack_upper, unpack_upper


class Payloads(Protocol):
    """How to read one kind of payloads."""

    def displaced(self, payload: Floats, offset: Floats) -> Floats:
        """Payloads (n, d) that say the target is elsewhere by offsets (n, 3), m."""


@dataclass(frozen=True)
class StatePayloads:
    """Payloads that begin with a position. axes: 3, or 2 in a plane."""

    axes: int

    def displaced(self, payload: Floats, offset: Floats) -> Floats:
        """The position moved."""
        moved = payload.copy()
        moved[:, : self.axes] += offset[:, : self.axes]
        return moved


@dataclass(frozen=True)
class InformationPayloads:
    """Payloads of information: vectors V = O x and upper triangles of O, one pair or several, which add up.

    axes: 3, or 2 in a plane; x begins with the position. size: of x. factors: what each pair is multiplied by when
    they are added up, (1,) for a single one.
    """

    axes: int
    size: int
    factors: tuple[float, ...] = (1.0,)

    def displaced(self, payload: Floats, offset: Floats) -> Floats:
        """V + O b for a state displaced by b; what follows the information is left as it is."""
        shift = np.zeros((len(payload), self.size))
        shift[:, : self.axes] = offset[:, : self.axes]
        moved, packed = payload.copy(), self._packed
        for start in range(0, len(self.factors) * packed, packed):
            matrix = unpack_upper(payload[:, start + self.size : start + packed], self.size)
            moved[:, start : start + self.size] += matvec(matrix, shift)
        return moved

    def claims(self, payload: Floats) -> tuple[Floats, Floats]:
        """Information vectors V (n, s) and matrices O (n, s, s) of payloads (n, d), which say x = O^-1 V."""
        return self._read(payload)

    def distance(self, own: Floats, others: Floats) -> Floats:
        """How far payloads (n, m, d) are from an agent's own (n, d): infinite where they are not comparable.

            (V_j - O_j x)^T O^-1 (V_j - O_j x) + |C^-1 O_j C^-T - I|^2        x = O^-1 V, O = C C^T, |.| Frobenius

        The first term is the squared Mahalanobis distance of what j adds to the own state, and the second is of its
        certainty: the sum of (lambda - 1)^2 over the eigenvalues of O^-1 O_j. Both have no unit.
        """
        count, width, length = others.shape
        vector, matrix = self._read(own)
        theirs, matrices = self._read(others.reshape(-1, length))
        covariance = inverse(matrix)
        state = np.repeat(matvec(covariance, vector), width, axis=0)
        covariance = np.repeat(covariance, width, axis=0)
        with np.errstate(over="ignore", invalid="ignore"):  # A payload that overflows is not comparable.
            apart = theirs - matvec(matrices, state)
            excess = covariance @ matrices - np.eye(self.size)
            certainty = (excess * np.swapaxes(excess, 1, 2)).reshape(len(excess), -1)
            total = np.sum(apart * matvec(covariance, apart), axis=1) + np.sum(certainty, axis=1)
        return np.where(np.isfinite(total), total, np.inf).reshape(count, width)

    @property
    def length(self) -> int:
        """Numbers of all pairs together."""
        return len(self.factors) * self._packed

    @property
    def unit(self) -> Floats:
        """The payload of one pair that says x = 0 with a unit matrix, as a stand-in."""
        return np.concatenate([np.zeros(self.size), pack_upper(np.eye(self.size)[None])[0]])

    @property
    def _packed(self) -> int:
        return self.size + self.size * (self.size + 1) // 2

    def _read(self, payload: Floats) -> tuple[Floats, Floats]:
        packed = self._packed
        total = np.zeros((len(payload), packed))
        for place, factor in enumerate(self.factors):
            total += factor * payload[:, place * packed : (place + 1) * packed]
        return total[:, : self.size], unpack_upper(total[:, self.size :], self.size)


@dataclass(frozen=True)
class SeveralPayloads:
    """Payloads of several filters, one after the other, with other numbers after them."""

    parts: tuple[InformationPayloads, ...]

    def displaced(self, payload: Floats, offset: Floats) -> Floats:
        """Every filter's displaced."""
        moved, place = payload.copy(), 0
        for part in self.parts:
            mine = slice(place, place + part.length)
            moved[:, mine] = part.displaced(payload[:, mine], offset)
            place += part.length
        return moved
