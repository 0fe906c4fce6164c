"""A run as pandas and xarray hold data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from zenoh_cbef.errors import UserError
from zenoh_cbef.extras import from_extra
from zenoh_cbef.trace import Trace
from zenoh_cbef.viewers.arrays import WHOLE_COLUMNS, arrays_of, tables_of

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

_STATE = ["x", "y", "z", "vx", "vy", "vz"]
_AXES: dict[str, tuple[str, ...]] = {
    "source_time": ("time",),
    "truth": ("time", "state"),
    "positions": ("agent", "time", "axis"),
    "initial": ("agent", "state"),
    "estimates": ("agent", "time", "state"),
    "covariances": ("agent", "time", "state", "other"),
    "smoothed": ("agent", "time", "state"),
    "smoothed_covariances": ("agent", "time", "state", "other"),
    "edges": ("edge", "end"),
    "bias": ("agent", "time", "part"),
}
"""The axes of the arrays that are not one number for each agent and step."""


def to_pandas(trace: Trace, table: str) -> pd.DataFrame:
    """A table of the run. Raises UserError where it has none of this name."""
    pandas = from_extra("pandas", "a table")
    tables = tables_of(trace)
    if table not in tables:
        raise UserError(f"there is no table {table!r}; there are {', '.join(tables)}")
    header, parts = tables[table]
    frame: pd.DataFrame = pandas.DataFrame(np.column_stack(parts), columns=header)
    return frame.astype({name: np.int64 for name in header if name in WHOLE_COLUMNS})


def to_xarray(trace: Trace) -> xr.Dataset:
    """All arrays of the run, with named axes."""
    xarray = from_extra("xarray", "a data set with named axes")
    arrays = arrays_of(trace)
    labels = trace.scenario.agents.labels
    coordinates = {
        "time": ("time", arrays.pop("time"), {"units": "s"}),
        "agent": list(labels) if labels else np.arange(len(trace.estimates)),
        "state": _STATE,
        "other": _STATE,
        "axis": _STATE[:3],
        "part": ["bias", "std", "weight"],
        "end": ["first", "second"],
    }
    data = {name: (_AXES.get(name, ("agent", "time")), values) for name, values in arrays.items()}
    found: xr.Dataset = xarray.Dataset(data, coords=coordinates, attrs={"run": trace.name})
    return found
