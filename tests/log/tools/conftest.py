"""One log of a run, made by hand."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.log.hand_made import Maker


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("log") / "run.mcap"
    maker = Maker(path, "record.chunk_bytes=4096")
    for k in range(1, 51):
        maker.step(k)
    maker.close()
    return path
