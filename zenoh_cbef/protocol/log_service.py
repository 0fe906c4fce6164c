"""The files of a log, which a recorder hands out over the network when it has closed them.

A query without parameters is answered by what there is; one with `file` and `from` by a part of a file; one with `done`
ends the service. A file is as long as its recorder says, so a fetching process knows what it lacks.
"""

from __future__ import annotations

import hashlib
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import msgpack
import zenoh

from zenoh_cbef.errors import UserError
from zenoh_cbef.protocol.asking import ask_all
from zenoh_cbef.protocol.fields import Counts, Texts, field_of
from zenoh_cbef.protocol.keys import Keys
from zenoh_cbef.protocol.messages import LARGEST, VERSION, BadMessage, unpack
from zenoh_cbef.writing import writing

PART = LARGEST // 2
"""Bytes of a file that come at once."""
_ANSWER_SECONDS, _AGAIN_SECONDS = 5.0, 0.2
_TRIES = 6
_TEXTS, _COUNTS = field_of(Texts), field_of(Counts)


@dataclass(frozen=True)
class Offer:
    """What a recorder, as in "record/host-b", has: its log's files in order, with their bytes and SHA-256 digests."""

    recorder: str
    names: tuple[str, ...]
    sizes: tuple[int, ...]
    digests: tuple[str, ...]

    @property
    def size(self) -> int:
        """Bytes of all files."""
        return sum(self.sizes)


class LogService:
    """Answers for a closed log until it is closed itself. fetched: set when a process has fetched all of it."""

    def __init__(self, session: zenoh.Session, keys: Keys, recorder: str, files: Sequence[Path]) -> None:
        self._key, self._files = keys.log(recorder), list(files)
        self.fetched = threading.Event()
        offer = {
            "v": VERSION,
            "names": [one.name for one in self._files],
            "sizes": [one.stat().st_size for one in self._files],
            "digests": [_digest(one) for one in self._files],
        }
        self._offer = msgpack.packb(offer)
        self._queryable = session.declare_queryable(self._key, self._answer)

    def _answer(self, query: zenoh.Query) -> None:
        with query:
            asked = query.parameters
            if asked.get("done") is not None:
                query.reply(self._key, self._offer)
                self.fetched.set()
            elif (number := asked.get("file")) is None:
                query.reply(self._key, self._offer)
            else:
                with suppress(ValueError, IndexError, OSError):
                    query.reply(self._key, self._part(int(number), int(asked.get("from") or 0)))

    def _part(self, number: int, start: int) -> bytes:
        if number < 0:
            raise IndexError
        with self._files[number].open("rb") as file:
            file.seek(start)
            return file.read(PART)

    def close(self) -> None:
        """Answer no more."""
        self._queryable.undeclare()


def offers(session: zenoh.Session, keys: Keys) -> list[Offer]:
    """The logs of a run that recorders hand out now, by the recorders' names."""
    found = {}
    for sample in ask_all(session, keys.log("**"), _ANSWER_SECONDS):
        with suppress(BadMessage):
            offer = _read(str(sample.key_expr).removeprefix(keys.log("")), sample.payload.to_bytes())
            found[offer.recorder] = offer
    return [found[name] for name in sorted(found)]


def fetch(
    session: zenoh.Session, keys: Keys, offer: Offer, paths: Sequence[Path], progress: Callable[[int], None]
) -> None:
    """Copy the files of a log to these paths. progress: told how many bytes more have come.

    Raises UserError where the recorder does not answer any more, or what came is not what it has.
    """
    for number, (path, size, digest) in enumerate(zip(paths, offer.sizes, offer.digests, strict=True)):
        with writing(path, "make room, or choose another place"), path.open("wb") as file:
            for data in _parts(session, keys.log(offer.recorder), number, size):
                file.write(data)
                progress(len(data))
        if _digest(path) != digest:
            raise UserError(f"{path} is not what {offer.recorder} has; fetch it again")
    for _ in ask_all(session, f"{keys.log(offer.recorder)}?done=1", _ANSWER_SECONDS):
        pass


def _parts(session: zenoh.Session, key: str, number: int, size: int) -> Iterator[bytes]:
    start = 0
    while start < size:
        data = _ask(session, f"{key}?file={number};from={start}")
        yield data
        start += len(data)


def _ask(session: zenoh.Session, selector: str) -> bytes:
    for _ in range(_TRIES):
        for sample in ask_all(session, selector, _ANSWER_SECONDS):
            if data := sample.payload.to_bytes():
                return data
        time.sleep(_AGAIN_SECONDS)
    raise UserError(f"{selector.partition('?')[0]} does not answer any more; fetch again while its recorder stays")


def _read(recorder: str, data: bytes) -> Offer:
    told = unpack(data)
    names, sizes, digests = told.get("names"), told.get("sizes"), told.get("digests")
    if not isinstance(names, list) or not isinstance(sizes, list) or not isinstance(digests, list):
        raise BadMessage("it offers no log")
    if not (_TEXTS.hold([names, digests]) and _COUNTS.hold([sizes]) and len(names) == len(sizes) == len(digests)):
        raise BadMessage("it offers no log")
    return Offer(recorder, tuple(names), tuple(sizes), tuple(digests))


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
