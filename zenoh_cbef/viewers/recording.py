"""A run's ranges as a dataset: to run them again with other settings, or to try what a dataset is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from zenoh_cbef.datasets import Dataset, write_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.trace import Trace


def dataset_of(trace: Trace) -> Dataset:
    """The agents as anchors, their ranges at the times at which they were measured, and the truth.

    Raises UserError where agents move, or measured nothing.
    """
    if np.nanmax(np.ptp(trace.positions, axis=1), initial=0.0) > 0.0:
        raise UserError("anchors of a dataset rest, but the agents of this run move; export it to csv or npz")
    agent, step = np.nonzero(np.isfinite(trace.ranges) & np.isfinite(trace.age))
    if not len(agent):
        raise UserError("the run has no range, and a dataset needs at least one; export another run")
    times = trace.time if trace.source_time is None else trace.source_time
    measured = trace.range_time[agent, step]
    order = np.lexsort((agent, measured))
    known = np.isfinite(trace.truth).all(axis=1)
    return Dataset(
        labels=trace.scenario.agents.names,
        anchors=trace.positions[:, 0],
        range_time=measured[order],
        range_anchor=agent[order],
        ranges=trace.ranges[agent, step][order],
        truth_time=times[known],
        truth=trace.truth[known, :3],
    )


def write_recording(trace: Trace, folder: Path) -> list[Path]:
    """Write it; returns its files."""
    return write_dataset(dataset_of(trace), folder)
