"""A file or folder that gets its name when it is whole."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from zenoh_cbef.writing import writing


@contextmanager
def whole(output: Path) -> Iterator[Path]:
    """Where to write what is to be `output`, which has that name when the block has ended.

    Where the block fails nothing is left, and what was there before stays. Raises UserError for an OSError.
    """
    with writing(output, "make room, or choose another --output"):
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".export-", dir=output.parent) as folder:
            fresh = Path(folder) / output.name
            yield fresh
            fresh.replace(output)
