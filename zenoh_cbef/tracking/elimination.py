"""Small symmetric positive definite matrices, inverted by one row of operations that is the same for one and for many.

    A = U^T D U            d_k = a_kk,  u_ki = -a_ki/d_k,  a_ij <- a_ij + u_ki a_kj             k < i <= j
    V = U^-1               v_ij = u_ij + sum u_il v_lj                                          i < l < j
    A^-1 = V D^-1 V^T      x_ij = sum v_il v_jl/d_l                                             i <= j <= l

The library takes the matrices of a batch one by one, which takes four times as long. Here each operation is one call
for all matrices of a batch, and of a single matrix one of plain floats. Both are those of IEEE 754 and nothing else, so
a matrix has the same inverse in any batch, and on any processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, overload

import numpy as np

from zenoh_cbef.arrays import Bools, Floats
from zenoh_cbef.tracking.linalg import Inversion, solve, upper

_LARGEST = 6
"""Rows of the largest matrices that are inverted so. Of a single larger one the library is quicker."""

_FEW = 24
"""Fewer matrices are sooner inverted one by one."""


class _Program(Protocol):
    """From the upper triangle of a matrix, that of its inverse, and whether it is positive definite; or of many."""

    @overload
    def __call__(self, *entries: float) -> tuple[Sequence[float], bool]: ...
    @overload
    def __call__(self, *entries: Floats) -> tuple[Sequence[Floats], Bools]: ...


@dataclass(frozen=True)
class Elimination(Inversion):
    """By elimination. Large matrices, and those that are not positive definite, are left to the library."""

    def inverse(self, matrices: Floats) -> Floats:
        """Inverse of symmetric matrices (n, s, s), NaN where one is singular."""
        if matrices.shape[1] > _LARGEST:
            return super().inverse(matrices)
        inverted, others = _inverted(matrices)
        if len(others):
            inverted[others] = super().inverse(matrices[others])
        return inverted

    def if_definite(self, matrices: Floats) -> Floats | None:
        """Inverse of symmetric matrices (n, s, s); None unless all of them are positive definite."""
        if matrices.shape[1] > _LARGEST:
            return super().if_definite(matrices)
        inverted, others = _inverted(matrices)
        return None if len(others) else inverted

    def information(self, rows: Floats, noise: Floats, values: Floats) -> tuple[Floats, Floats]:
        """H^T R^-1 y and H^T R^-1 H without R^-1, of which many values have no use."""
        told = rows.swapaxes(1, 2) @ solve(noise, np.concatenate([rows, values[:, :, None]], axis=2))
        return told[:, :, -1], told[:, :, :-1]


BY_ELIMINATION = Elimination()


def _inverted(matrices: Floats) -> tuple[Floats, list[int]]:
    """The inverses of matrices (n, s, s), and in which places are some that are not positive definite."""
    count, size, _ = matrices.shape
    (places, back), program = upper(size), _program(size)
    flat = matrices.reshape(count, size * size)
    if count < _FEW:
        found = [_alone(program, entries) for entries in flat.take(places, axis=1).tolist()]
        packed = np.array([entries for entries, _ in found]).reshape(count, len(places))
        inverted = packed.take(back, axis=1)
        return inverted.reshape(matrices.shape), [place for place, (_, definite) in enumerate(found) if not definite]
    with np.errstate(all="ignore"):
        columns, definite = program(*flat.T[places])
    inverted = np.concatenate(columns).reshape(len(places), count).take(back, axis=0)
    return np.ascontiguousarray(inverted.T).reshape(matrices.shape), np.flatnonzero(~definite).tolist()


def _alone(program: _Program, entries: list[float]) -> tuple[Sequence[float], bool]:
    try:
        return program(*entries)
    except ZeroDivisionError:
        return entries, False


@cache
def _program(size: int) -> _Program:
    """The operations for matrices of one size. They are written out, as loops would take most of the time."""
    rows = range(size)
    pairs = [(i, j) for i in rows for j in rows[i:]]
    lines = [f"def program({', '.join(f'a{i}{j}' for i, j in pairs)}):"]
    for k in rows:
        lines += [f" d{k} = 1.0 / a{k}{k}", f" n{k} = -d{k}"]
        for i in rows[k + 1 :]:
            lines += [f" u{k}{i} = a{k}{i} * n{k}"]
            lines += [f" a{i}{j} = a{i}{j} + u{k}{i} * a{k}{j}" for j in rows[i:]]
    for i, j in reversed(pairs):
        if i < j:
            lines += [f" v{i}{j} = u{i}{j}" + "".join(f" + u{i}{k} * v{k}{j}" for k in rows[i + 1 : j])]
            lines += [f" w{i}{j} = v{i}{j} * d{j}"]
    inverse = [
        (f"w{i}{j}" if i < j else f"d{i}") + "".join(f" + v{i}{k} * w{j}{k}" for k in rows[j + 1 :]) for i, j in pairs
    ]
    lines += [f" return ({', '.join(inverse)},), {' & '.join(f'(a{k}{k} > 0.0)' for k in rows)}"]
    names: dict[str, _Program] = {}
    exec("\n".join(lines), names)  # noqa: S102 - made of nothing but the size
    return names["program"]
