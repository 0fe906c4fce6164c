"""A million mutated and made-up messages, keys and texts through every decoder, and mutated logs through every verb.

A crash is whatever a user would see as a traceback, NumPy's warnings included.
"""

from __future__ import annotations

import re
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from rich.progress import track
from rich.table import Table

from benchmarks.common import Row, below, plain_table, results
from benchmarks.fuzz_doors import REFUSALS, Door, Doors
from benchmarks.fuzz_logs import fuzz_logs
from benchmarks.fuzz_material import Material

MESSAGES, TEXTS, LOGS = 920_000, 80_000, 250
"""How many of each are fed in, shared out evenly among the decoders."""

_SEED = 1
_NAMED = 4
"""Reasons of refusals that are told for each decoder."""

_SHORTENED = 60


def run(repeats: int, messages: int = MESSAGES, texts: int = TEXTS, logs: int = LOGS) -> Iterator[Table]:
    """Measure; what is fed in is the same each time, so nothing is repeated."""
    del repeats
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="fuzz-") as folder, warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        found = feed(Path(folder), messages, texts)
        ends = fuzz_logs(Path(folder), _SEED, track(range(logs), description="logs"))
    yield plain_table(
        "fed into every decoder", ["decoder", "fed in", "accepted", "crashes", "refused"], [*_rows(found)]
    )
    statuses = sorted({end for each in ends.values() for end in each if not end.startswith("crash")})
    rows = [[verb, *map(each.__getitem__, statuses), _crashes(each)] for verb, each in ends.items()]
    yield plain_table("mutated logs, by verb and exit status", ["verb", *statuses, "crashes"], rows)
    named = [end for each in (*found.values(), *ends.values()) for end in each if end.startswith("crash")]
    crashes = sum(map(_crashes, (*found.values(), *ends.values())))
    total = sum(each.total() for each in found.values())
    made = Row("messages, keys and texts; logs", f"{total}; {logs}")
    spent = Row("time", f"{time.monotonic() - began:.0f} s")
    yield results("fuzz", [made, below("crashes", crashes, 1), *(Row("", end) for end in named[:_NAMED]), spent])


def feed(folder: Path, messages: int, texts: int) -> dict[str, Counter[str]]:
    """Counts of all inputs by decoder: accepted, refused for a reason, or a crash."""
    doors, found = Doors(folder), {}
    for count, some in ((messages, doors.of_messages()), (texts, doors.of_texts())):
        for number, (name, door) in enumerate(some.items()):
            material = Material(_SEED + number)
            each = count // len(some)
            found[name] = Counter(through(door, material) for _ in track(range(each), description=f"{name:20}"))
    doors.close()
    return found


def through(door: Door, material: Material) -> str:
    """The result for one input."""
    try:
        return door(material)
    except REFUSALS as error:
        # A RuntimeWarning is none of these: it is an error here, and so a crash.
        return f"refused: {_in_general(str(error))}"
    except Exception as error:  # noqa: BLE001 - this is what is looked for
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"crash: {type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error!s:.{_SHORTENED}}"


def _in_general(reason: str) -> str:
    """A reason without the values of one message."""
    return " ".join(re.split("['(:]", reason, maxsplit=1)[0].split()[:6])


def _crashes(each: Counter[str]) -> int:
    return sum(count for end, count in each.items() if end.startswith("crash"))


def _rows(found: dict[str, Counter[str]]) -> Iterable[list[object]]:
    for name, each in found.items():
        refused = Counter({end.removeprefix("refused: "): count for end, count in each.items() if "refused" in end})
        told = ", ".join(f"{reason} {count}" for reason, count in refused.most_common(_NAMED))
        rest = refused.total() - sum(count for _, count in refused.most_common(_NAMED))
        yield [name, each.total(), each["accepted"], _crashes(each), told + (f", others {rest}" if rest else "")]
