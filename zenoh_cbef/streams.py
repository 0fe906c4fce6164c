"""Counter-based random streams: every draw is a pure function of its name and index.

A stream is named by (seed, purpose, source, destination) and indexed by (step, lane), so any process, on any
host, and the simulator draw the same value without asking each other, in any order and in any batch. The
generator is the SplitMix64 finaliser (Steele, Lea, Flood: Fast Splittable Pseudorandom Number Generators,
OOPSLA 2014), applied once per coordinate of the name and of the index.
"""

from __future__ import annotations

from functools import cache
from hashlib import blake2b

import numpy as np
from numpy.typing import ArrayLike, NDArray

from zenoh_cbef.arrays import Bools, Floats

Keys = NDArray[np.uint64]

_STEP = 0x9E3779B97F4A7C15
_LANE = 0xD1B54A32D192ED03
_MASK = (1 << 64) - 1


def _mix(z: Keys) -> Keys:
    """The finaliser. Works in place: the caller must own the array. A copy would cost more than the arithmetic."""
    shifted = z >> np.uint64(30)
    z ^= shifted
    z *= np.uint64(0xBF58476D1CE4E5B9)
    np.right_shift(z, np.uint64(27), out=shifted)
    z ^= shifted
    z *= np.uint64(0x94D049BB133111EB)
    np.right_shift(z, np.uint64(31), out=shifted)
    z ^= shifted
    return z


def _words(values: ArrayLike) -> Keys:
    # At least one dimension: NumPy warns when uint64 scalars wrap, and is silent about arrays.
    array = np.atleast_1d(np.asarray(values))
    if array.dtype == object:
        array = np.array([int(value) & _MASK for value in array.ravel()], dtype=np.uint64).reshape(array.shape)
    return array.astype(np.uint64)


def _times(factor: int, values: ArrayLike) -> Keys:
    """The product modulo 2^64. Most values are one number, which Python multiplies faster than NumPy."""
    if isinstance(values, int):
        return np.array([factor * values & _MASK], dtype=np.uint64)
    return np.uint64(factor) * _words(values)


@cache
def _code(purpose: str) -> np.uint64:
    return np.uint64(int.from_bytes(blake2b(purpose.encode(), digest_size=8).digest(), "little"))


def _mixed(z: int) -> int:
    """The finaliser of one number, which Python computes faster than NumPy."""
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9 & _MASK
    z = (z ^ z >> 27) * 0x94D049BB133111EB & _MASK
    return z ^ z >> 31


def _named(seed: ArrayLike, purpose: str) -> Keys:
    if isinstance(seed, int):
        return np.array([_mixed(_mixed(seed + _STEP & _MASK) ^ int(_code(purpose)))], dtype=np.uint64)
    return _mix(_mix(_words(seed) + np.uint64(_STEP)) ^ _code(purpose))


def stream(seed: ArrayLike, purpose: str, source: ArrayLike = 0, destination: ArrayLike = 0) -> Keys:
    """The key of one stream, or of an array of streams (at least 1-D; the arguments broadcast)."""
    key = _mix(_named(seed, purpose) + _times(_STEP, source))
    return _mix(key + _times(_LANE, destination) + np.uint64(_LANE))


def bits(key: Keys, step: ArrayLike, lane: ArrayLike = 0) -> Keys:
    """64 random bits at index (step, lane) of each stream; the arguments broadcast."""
    return _lane(_at(key, step), lane)


def _at(key: Keys, step: ArrayLike) -> Keys:
    return _mix(key + _times(_STEP, step))


def _lane(at: Keys, lane: ArrayLike) -> Keys:
    return _mix(at + _times(_LANE, lane))


def _unit(words: Keys) -> Floats:
    words >>= np.uint64(11)
    return np.asarray(words * 2.0**-53, dtype=np.float64)


class LinkStreams:
    """The streams of directed links, arrays (e,), each keyed once; draws of all lanes of a step are made at once."""

    def __init__(self, seed: ArrayLike, source: ArrayLike, destination: ArrayLike, lanes: range) -> None:
        self._links, self._lanes = (seed, source, destination), lanes
        self._keys: dict[str, Keys] = {}
        self._drawn: dict[str, tuple[int, Floats]] = {}
        # For chains whose states follow from draws: the place of the latest one, by purpose, and the states (e,).
        self.states: dict[str, tuple[int, Bools]] = {}

    def key(self, purpose: str) -> Keys:
        """The keys of the streams of one purpose."""
        if purpose not in self._keys:
            seed, source, destination = self._links
            self._keys[purpose] = stream(seed, purpose, source, destination)
        return self._keys[purpose]

    def uniform(self, purpose: str, step: int, lane: int) -> Floats:
        """What `uniform` of their keys gives, (e,)."""
        if lane not in self._lanes:
            return uniform(self.key(purpose), step, lane)
        latest, drawn = self._drawn.get(purpose, (None, None))
        if drawn is None or latest != step:
            drawn = uniform(self.key(purpose), step, np.array(self._lanes)[:, None])
            self._drawn[purpose] = step, drawn
        return np.asarray(drawn[lane - self._lanes.start])


def uniform(key: Keys, step: ArrayLike, lane: ArrayLike = 0) -> Floats:
    """Uniform draws in [0, 1)."""
    return _unit(bits(key, step, lane))


def normal(key: Keys, step: ArrayLike, lane: ArrayLike = 0) -> Floats:
    """Standard normal draws (Box and Muller 1958); uses lanes 2*lane and 2*lane + 1."""
    at, even = _at(key, step), 2 * (lane if isinstance(lane, int) else np.asarray(lane))
    radius = np.sqrt(-2.0 * np.log(1.0 - _unit(_lane(at, even))))
    return np.asarray(radius * np.cos(2.0 * np.pi * _unit(_lane(at, even + 1))))


def exponential(key: Keys, step: ArrayLike, lane: ArrayLike = 0) -> Floats:
    """Exponential draws of mean 1."""
    return np.asarray(-np.log(1.0 - uniform(key, step, lane)))
