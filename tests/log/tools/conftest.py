"""One log of a run, made by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.log.hand_made import written


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("log") / "run.mcap", 50, "record.chunk_bytes=4096")
