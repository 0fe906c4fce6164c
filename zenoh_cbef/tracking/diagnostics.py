"""What an agent says about a step besides its state: the one list of these numbers.

Messages, logs, traces, exports, proofs and viewers iterate over the fields. A new diagnostic is a field here, and the
filter that fills it in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from zenoh_cbef.arrays import Bools, Floats, Ints

FloatsIfAny = Floats
"""Floats that a message leaves out where there are none."""

Numbers = NDArray[Any]
"""Floats, or whole numbers."""


@dataclass(frozen=True, kw_only=True)
class Diagnostics:
    """Arrays of one shape: (n,) for a step of n agents, (n, K) for a run.

    innovation: size of the innovation, in the filter's unit (m, m^2 for cbef). weight: the saturation gain in (0, 1]
    that was applied. nis: the innovation squared in units of the covariance that the filter predicted for it, before
    saturation. nis_degrees: its degrees of freedom. distrust: how far the agent distrusted its range, 0 to 1. bias,
    bias_std: lasting error of the agent's ranges as it estimates it, and its standard deviation, m. bias_weight: how
    far the state relies on that estimate, 0 to 1. maneuver: probability of the most agile of several motions, before
    the step's ranges. isolated: the neighbour that the agent isolated last, by its number. status: what the estimate
    is, as a number of `status.STATUSES`. status_seconds: how long it has been so, s. silent: in how many
    rounds of the step the agent kept silent. excess: by what share the covariance is larger than that which the filter
    goes on with, as errors of ranges last.
    """

    innovation: Floats
    weight: Floats
    nis: Floats
    nis_degrees: Ints
    distrust: FloatsIfAny
    bias: FloatsIfAny
    bias_std: FloatsIfAny
    bias_weight: FloatsIfAny
    maneuver: FloatsIfAny
    isolated: FloatsIfAny
    status: FloatsIfAny
    status_seconds: FloatsIfAny
    silent: FloatsIfAny
    excess: FloatsIfAny

    @classmethod
    def of(cls, *shape: int, **known: Numbers) -> Self:
        """The given fields, and the value for "nothing" in all others."""
        return cls(**{name: known[name] if name in known else nothing(name, *shape) for name in NAMES})

    @classmethod
    def where(cls, measured: Bools, **known: Numbers) -> Self:
        """The given fields for the agents (n,) that measured something, and "nothing" for the others."""
        said: dict[str, Numbers] = dict.fromkeys(NAMES, np.array([np.nan]).repeat(len(measured)))
        for name in WHOLE:
            said[name] = known[name] if name in known else nothing(name, len(measured))
        missing = ~measured
        for name, one in known.items():
            if name not in WHOLE:
                said[name] = values = one.copy()
                values[missing] = np.nan
        return cls(**said)

    @classmethod
    def read(cls, columns: Floats) -> Self:
        """The fields from the last axis of an array, in their order; NaN stands for nothing in all of them."""
        return cls(**{name: read(name, columns[..., place]) for place, name in enumerate(NAMES)})

    def named(self) -> Mapping[str, Numbers]:
        """The arrays by their names."""
        return vars(self)

    def each(self, change: Callable[[Numbers], Numbers]) -> Self:
        """The same with every array changed."""
        return type(self)(**{name: change(values) for name, values in self.named().items()})

    def put(self, place: Any, other: Diagnostics) -> None:
        """Copy the fields of another one into a place of the arrays."""
        for name, values in self.named().items():
            values[place] = getattr(other, name)

    def chosen(self, rows: Bools, other: Diagnostics) -> Self:
        """The same, with some rows (n,) from another one."""
        return type(self)(
            **{name: np.where(rows, getattr(other, name), values) for name, values in self.named().items()}
        )


NAMES: tuple[str, ...] = tuple(one.name for one in fields(Diagnostics))
"""The names of all diagnostics: fields of messages, columns of exports."""

WHOLE: frozenset[str] = frozenset(one.name for one in fields(Diagnostics) if one.type == "Ints")
"""Those that are whole numbers."""

SOMETIMES: frozenset[str] = frozenset(one.name for one in fields(Diagnostics) if one.type == "FloatsIfAny")
"""Those that a message leaves out where there is nothing to say."""


def nothing(name: str, *shape: int) -> Numbers:
    """An array of a diagnostic that says nothing."""
    return np.zeros(shape, dtype=np.int64) if name in WHOLE else np.full(shape, np.nan)


def read(name: str, values: Floats) -> Numbers:
    """A diagnostic from floats in which NaN stands for nothing."""
    return np.nan_to_num(values).astype(np.int64) if name in WHOLE else values
