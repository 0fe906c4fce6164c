"""One run, wherever it comes from: its numbers as arrays, what they amount to, figures and a report."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING

from zenoh_cbef.analysis.metrics import Analysis, analyze
from zenoh_cbef.analysis.report import write_report
from zenoh_cbef.analysis.results import Metrics
from zenoh_cbef.api.frames import to_pandas, to_xarray
from zenoh_cbef.api.paths import path_of
from zenoh_cbef.api.plotting import Plots
from zenoh_cbef.arrays import Floats
from zenoh_cbef.errors import UserError
from zenoh_cbef.numbers import MOST_SKIPPED, SKIPPED
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.trace import Trace
from zenoh_cbef.viewers.arrays import Array, arrays_of
from zenoh_cbef.writing import writing

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Run:
    """A run: n agents, K steps, row k-1 of a step axis for step k; NaN where there is nothing.

    trace: all that is known of it. log: its log; None where it was simulated. skip: the share of steps that errors
    leave out at the start.
    """

    trace: Trace
    log: Path | None = None
    skip: float = SKIPPED

    def __post_init__(self) -> None:
        """Raise UserError for a skip that is no share."""
        if not (isinstance(self.skip, Real) and 0.0 <= self.skip <= MOST_SKIPPED):
            raise UserError(
                f"skip must be a share of steps from 0 to {MOST_SKIPPED}, not {self.skip!r}; {SKIPPED} is usual"
            )

    def __repr__(self) -> str:
        count, steps = self.ranges.shape
        where = "" if self.log is None else f", log {self.log}"
        return f"<Run {self.name}: {self.scenario.filter.kind}, {count} agents, {steps} steps{where}>"

    @property
    def name(self) -> str:
        """The run's name."""
        return self.trace.name

    @property
    def scenario(self) -> Scenario:
        """What the run was to be."""
        return self.trace.scenario

    @property
    def time(self) -> Floats:
        """The time of each step, (K,), s."""
        return self.trace.time

    @property
    def source_time(self) -> Floats | None:
        """The same times on the clock of the recording that the ranges are of, (K,), s; None for other ranges."""
        return self.trace.source_time

    @property
    def truth(self) -> Floats:
        """The target's position and velocity, (K, 6), m and m/s."""
        return self.trace.truth

    @property
    def positions(self) -> Floats:
        """The agents' positions, (n, K, 3), m."""
        return self.trace.positions

    @property
    def ranges(self) -> Floats:
        """What each agent measured, (n, K), m."""
        return self.trace.ranges

    @property
    def range_time(self) -> Floats:
        """When each range was measured, (n, K), s, on the recording's clock; run time for other ranges."""
        return self.trace.range_time

    @property
    def estimates(self) -> Floats:
        """Each agent's estimate of position and velocity, (n, K, 6), m and m/s."""
        return self.trace.estimates

    @property
    def covariances(self) -> Floats:
        """The covariance that each agent claims for it, (n, K, 6, 6)."""
        return self.trace.covariances

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays by the names that `export --to npz` gives them (docs/log-format.md)."""
        return arrays_of(self.trace)

    @cached_property
    def analysis(self) -> Analysis:
        """Errors at each step, the centralised filter and the bound."""
        return analyze([self.trace], self.skip)[0]

    @property
    def metrics(self) -> Metrics:
        """What the run achieved: field by field the JSON of `analyze --json`."""
        return self.analysis.metrics

    def scored(self, skip: float) -> Run:
        """The same run, with another share of steps left out at the start. Raises UserError where it is none."""
        return replace(self, skip=skip)

    @property
    def position_error(self) -> Floats:
        """The distance of each agent's estimate from the truth, (n, K), m."""
        return self.analysis.position_error

    @property
    def plot(self) -> Plots:
        """Figures of the run, drawn with matplotlib."""
        return Plots(self)

    def to_pandas(self, table: str = "estimates") -> pd.DataFrame:
        """One of the tables that `export --to csv` writes. Raises UserError for another name or without pandas."""
        return to_pandas(self.trace, table)

    def to_xarray(self) -> xr.Dataset:
        """All arrays with named axes: agent, time, state. Raises UserError without xarray."""
        return to_xarray(self.trace)

    def report(self, path: str | Path = "report.html") -> Path:
        """Write one page that opens anywhere, offline; returns its path. Raises UserError where it cannot be."""
        page = path_of(path, "a page")
        with writing(page, "make its folder, or choose another path"):
            write_report(self.analysis, page)
        return page
