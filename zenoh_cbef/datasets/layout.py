"""The files of a dataset's folder, as docs/datasets.md has them."""

from __future__ import annotations

COLUMNS = {"anchors": "id,x,y,z", "ranges": "t,anchor_id,range", "truth": "t,x,y,z"}
"""The header of each file by its name without .csv. truth.csv may be left out."""

NAMING = frozenset({"id", "anchor_id"})
"""The columns that name an anchor; all others are numbers."""

MOST = {"t": 1e12, "x": 1e7, "y": 1e7, "z": 1e7, "range": 1e7}
"""The largest size of a column's numbers, s and m: that of a scenario's coordinates."""
