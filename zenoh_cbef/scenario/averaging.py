"""The scenario's [consensus] table."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from zenoh_cbef.quantities import Chance, Deviations
from zenoh_cbef.scenario.table import Eigenvalue, Table
from zenoh_cbef.tracking.compact import Compact, Precision


class Consensus(Table):
    """How payloads are averaged. epsilon None: 1/(largest degree + 1). scheme auto: see Plan.scheme.

    bounds: least and largest eigenvalue of W other than 1, for chebyshev; None: those of the graph.
    trim: F, how many neighbours' values are left out in every round (W-MSR); 0: none.
    lag: how many steps after its own a message is used, predicted forward; 0: in its own round.
    isolate: whether agents leave out neighbours whose messages their own prediction rules out; auto: where the scenario
    has agents that send wrong values, and trim is 0.
    precision: in which numbers payloads travel, see tracking/compact.py.
    trigger: how far an agent's value may be from what it sent last while it keeps silent, see tracking/triggered.py; 0:
    agents send in every round.
    """

    rounds: Annotated[int, Field(ge=0, le=10_000)] = 10
    weights: Literal["uniform", "metropolis"] = "metropolis"
    epsilon: Chance | None = None
    acceleration: Literal["none", "chebyshev"] = "none"
    bounds: tuple[Eigenvalue, Eigenvalue] | None = None
    scheme: Literal["auto", "average", "running-sums"] = "auto"
    trim: Annotated[int, Field(ge=0, le=1000)] = 0
    lag: Annotated[int, Field(ge=0, le=100)] = 0
    precision: Precision = "float64"
    trigger: Deviations = 0.0
    isolate: Annotated[bool | Literal["auto"], Field(description="true, false or 'auto'")] = "auto"

    def compact(self, width: int, blocks: tuple[int, ...]) -> Compact | None:
        """How payloads of so many numbers travel, see Compact; None: as they are, in every round."""
        if self.precision == "float64" and not self.trigger:
            return None
        return Compact(width, blocks, self.precision, silences=self.trigger > 0.0)

    def mistakes(self) -> dict[str, bool]:
        """See Table."""
        sums, accelerated = self.scheme == "running-sums", self.acceleration != "none"
        plain, bounds = not (sums or accelerated or self.trim), self.bounds or (0.0, 0.0)
        return {
            f"consensus.lag = {self.lag} needs plain averaging, as only that intersects covariances; set "
            "consensus.acceleration = 'none', consensus.trim = 0 and consensus.scheme = 'average' or 'auto'": (
                self.lag > 0 and not plain
            ),
            f"consensus.trigger = {self.trigger:g} needs plain averaging, in which a message may stand for later ones; "
            "set consensus.acceleration = 'none', consensus.trim = 0, consensus.lag = 0, consensus.isolate = false and "
            "consensus.scheme = 'average' or 'auto'": (
                self.trigger > 0.0 and (self.isolate is True or self.lag > 0 or not plain)
            ),
            "consensus.isolate = true judges whether a message is what its sender can know now; set "
            "consensus.acceleration = 'none' and consensus.lag = 0, or leave isolate out": (
                self.isolate is True and (self.lag > 0 or accelerated)
            ),
            f"consensus.bounds = {list(bounds)} are the least and the largest eigenvalue for consensus.acceleration = "
            "'chebyshev'; set that and give the lower one first, or leave bounds out": (
                self.bounds is not None and (self.acceleration != "chebyshev" or bounds[0] > bounds[1])
            ),
            "consensus.scheme = 'running-sums' cannot be accelerated; set consensus.acceleration = 'none', or "
            "consensus.scheme = 'average'": sums and accelerated,
            f"consensus.precision = {self.precision!r} leaves too little of the shares in running sums; set "
            "consensus.precision = 'float32', or consensus.scheme = 'average'": (
                sums and self.precision.startswith("int")
            ),
            f"consensus.trim = {self.trim} needs plain averaging, in which no agent weighs negatively; set "
            "consensus.acceleration = 'none' and consensus.scheme = 'average' or 'auto'": (
                self.trim > 0 and (sums or accelerated)
            ),
        }
