"""One log for each way to compress."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.log.mcap.made import COMPRESSIONS, MESSAGES, chance
from zenoh_cbef.log.mcap.writer import McapWriter


@pytest.fixture(scope="module", params=COMPRESSIONS)
def log(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A closed log of some 20 chunks, with attachments and metadata before, among and after them."""
    path = tmp_path_factory.mktemp("log") / f"{request.param}.mcap"
    noise = chance(1)
    with McapWriter(path, compression=request.param, chunk_bytes=2000, library="test 1.0") as writer:
        schema = writer.register_schema("Beacon", "jsonschema", b"{}")
        channels = [writer.register_channel(f"key/{n}", "msgpack", schema, {"n": str(n)}) for n in range(3)]
        writer.add_attachment("first", "text/plain", b"seed = 1\n" * 20)
        writer.add_metadata("run", {"seed": "1"})
        for n in range(MESSAGES):
            data = b"%d " % n * 10 + noise.randbytes(n % 50)
            writer.add_message(channels[n % 3], 1000 + n, 900 + n, n, data)
            if n == MESSAGES // 2:
                writer.add_attachment("middle", "text/plain", b"middle")
        writer.add_metadata("end", {"status": "done"})
    return path
