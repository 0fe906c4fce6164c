"""How fast logs are written: the public library's writer beside ours, in interleaved rounds.

Payloads are 200 bytes: random floats behind a short text, the worst for compression.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from mcap.reader import NonSeekingReader
from mcap.writer import CompressionType, Writer
from rich.table import Table

from benchmarks.common import plain_table
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.log.mcap.writer import Compression, McapWriter

MESSAGES = 100_000
CHANNELS = 8
COMPRESSIONS: dict[Compression, CompressionType] = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}


def payloads(count: int) -> list[bytes]:
    floats = np.random.default_rng(1).standard_normal((count, 23))
    return [b"beacon from agent".ljust(16, b" ")[:16] + row.tobytes() for row in floats]


def write_official(path: Path, compression: Compression, messages: list[bytes]) -> None:
    with path.open("wb") as stream:
        writer = Writer(stream, compression=COMPRESSIONS[compression])
        writer.start()
        schema = writer.register_schema("speed", "jsonschema", b"{}")
        channels = [writer.register_channel(f"key/{n}", "msgpack", schema) for n in range(CHANNELS)]
        for n, data in enumerate(messages):
            writer.add_message(channels[n % CHANNELS], log_time=n, publish_time=n, sequence=n // CHANNELS, data=data)
        writer.finish()


def write_ours(path: Path, compression: Compression, messages: list[bytes]) -> None:
    with McapWriter(path, compression=compression, library="speed") as writer:
        schema = writer.register_schema("speed", "jsonschema", b"{}")
        channels = [writer.register_channel(f"key/{n}", "msgpack", schema) for n in range(CHANNELS)]
        for n, data in enumerate(messages):
            writer.add_message(channels[n % CHANNELS], n, n, n // CHANNELS, data)


def read_official(path: Path) -> None:
    with path.open("rb") as stream:
        for _ in NonSeekingReader(stream).iter_messages(log_time_order=False):
            pass


def read_ours(path: Path) -> None:
    for _ in McapFile(path).messages():
        pass


def summarise(path: Path) -> None:
    McapFile(path).summary()


def cases(folder: Path, messages: list[bytes]) -> Iterator[tuple[str, Path, Callable[[], None]]]:
    """Yield each case: its name, the file it writes or reads, and what is timed."""
    for compression in COMPRESSIONS:
        official, ours = folder / f"official.{compression}.mcap", folder / f"ours.{compression}.mcap"
        yield (
            f"write official {compression}",
            official,
            partial(write_official, official, compression, messages),
        )
        yield f"write ours {compression}", ours, partial(write_ours, ours, compression, messages)
        yield f"read official {compression}", ours, partial(read_official, ours)
        yield f"read ours {compression}", ours, partial(read_ours, ours)
        yield f"summary {compression}", ours, partial(summarise, ours)


def run(repeats: int) -> Iterator[Table]:
    messages = payloads(MESSAGES)
    seconds: dict[str, list[tuple[float, float]]] = {}
    sizes: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(repeats):
            for name, path, timed in cases(Path(folder), messages):
                wall, cpu = time.perf_counter(), time.process_time()
                timed()
                spent = (time.perf_counter() - wall, time.process_time() - cpu)
                seconds.setdefault(name, []).append(spent)
                sizes[name] = path.stat().st_size / 1e6
    rows = []
    for name, times in seconds.items():
        walls = [wall for wall, _ in times]
        median = statistics.median(walls)
        best = MESSAGES / min(walls) / 1e3
        cpu = statistics.median(cpu for _, cpu in times) / MESSAGES * 1e6
        rows.append([name, f"{MESSAGES / median / 1e3:.0f}", f"{best:.0f}", cpu, median * 1e3, sizes[name]])
    title = f"{MESSAGES} messages of 200 bytes, medians of {repeats}"
    yield plain_table(title, ["case", "kmsg/s", "best", "CPU us/msg", "ms", "MB"], rows)
