"""The finished runs of an experiment, a line for each in its folder: an interrupted experiment goes on from there."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Self

from zenoh_cbef import __version__
from zenoh_cbef.experiment.results import Curve, Outcome
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.writing import writing

JOURNAL = "finished.jsonl"
"""Its file in the folder of an experiment."""


def key_of(scenario: Scenario, engine: str, skip: float) -> str:
    """A name for everything that determines a cell's results, except the seed."""
    meant = scenario.model_dump(mode="json", by_alias=True, exclude={"seed"})
    text = json.dumps([__version__, engine, skip, meant], sort_keys=True)
    return sha256(text.encode()).hexdigest()[:16]


class Journal:
    """Outcomes by cell key and seed, in `finished.jsonl`.

    A run that failed counts as not finished, so that the same command tries it again; its error is kept for `take_in`.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / JOURNAL
        with writing(f"into {folder}"):
            folder.mkdir(parents=True, exist_ok=True)
            self._found = {run: one for run, one in _read(self._path) if one.error is None}
            self._stream = self._path.open("a", encoding="utf-8")
        if self._stream.tell() and not _ends_a_line(self._path):
            self._stream.write("\n")  # the line that an interruption cut off

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def outcome(self, key: str, seed: int) -> Outcome | None:
        """The outcome of a run; None where it is not finished."""
        return self._found.get((key, seed))

    def add(self, key: str, outcomes: Iterable[Outcome]) -> None:
        """Keep the outcomes of some runs of one cell. Raises UserError where they cannot be written."""
        with writing(self._path, "make room; what is finished by then counts, and the same command goes on from there"):
            for one in outcomes:
                self._found[key, one.seed] = one
                kept = {name: value for name, value in asdict(one).items() if value is not None}
                self._stream.write(json.dumps({"key": key, **kept}, separators=(",", ":")) + "\n")
            self._stream.flush()

    def take_in(self, folder: Path) -> None:
        """Keep what another journal found, too; a run that finished anywhere counts as finished."""
        for (key, seed), one in dict(_read(folder / JOURNAL)).items():
            if (known := self.outcome(key, seed)) is None or (known.error is not None and known != one):
                self.add(key, [one])


def _read(path: Path) -> Iterable[tuple[tuple[str, int], Outcome]]:
    if not path.exists():
        return
    with path.open(encoding="utf-8", errors="replace") as lines:
        for line in lines:
            try:
                one = json.loads(line)
                curve = None if "error" in one else Curve(**one["curve"])
                yield (one["key"], one["seed"]), Outcome(one["seed"], one["metrics"], curve, one.get("error"))
            except (ValueError, KeyError, TypeError, AttributeError):
                continue  # cut off, so it has to be done again


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as stream:
        stream.seek(-1, 2)
        return stream.read(1) == b"\n"
