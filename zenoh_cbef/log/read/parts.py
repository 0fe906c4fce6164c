"""A log on disk: one MCAP file, or several where the recorder began new ones."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mcap import records

from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import ACTIVE, LOGS, RUN, part_path
from zenoh_cbef.log.mcap.contents import NotMcapError, RawMessage, Summary
from zenoh_cbef.log.mcap.reader import McapFile
from zenoh_cbef.plain import whole
from zenoh_cbef.words import meant

if TYPE_CHECKING:
    from zenoh_cbef.log.mcap.heads import Batch


def find_log(path: Path) -> Path:
    """The log meant by a file, a run's folder or its name in logs/, or the name that a killed recorder left."""
    # A folder of the run's name that is no run's, as that of its data, does not hide it.
    named = [LOGS / path] if len(path.parts) == 1 and path.name != ".." else []
    for place in (path, *named):
        if (found := _existing(place / "run.mcap" if place.is_dir() else place)) is not None:
            return found
    what = f"there is no log in the folder {path}" if path.is_dir() else f"there is no log {path}"
    known = sorted({one.parent.name for one in LOGS.glob("*/run.mcap*")}) if named else []
    near = meant(path.name, known, "give an .mcap file or a run's folder, such as logs/latest")
    raise UserError(f"{what}; {near}")


def open_log(path: Path) -> Log:
    """Open a log: a part alone where its file is named, all parts where it is the first. Raises UserError."""
    found = find_log(path)
    files = {found: _open(found)}
    first = found.with_name(found.name.removesuffix(ACTIVE))
    number = 2
    while (following := _existing(part_path(first, number))) is not None:
        part = _open(following)
        if not _is_part(files[found], part, number):
            break
        files[following] = part
        number += 1
    return Log(files)


def open_logs(paths: Sequence[Path]) -> Log:
    """Open the files of one run as one log, in the order of their parts."""
    if len(paths) == 1:
        return open_log(paths[0])
    files = {found: _open(found) for found in map(find_log, paths)}
    runs = {file.metadata.get(RUN, {}).get("run") for file in files.values()}
    if len(runs) > 1:
        raise UserError(f"{', '.join(map(str, files))} are of different runs; give the files of one, or use 'compare'")
    return Log(dict(sorted(files.items(), key=lambda item: _number(item[1]))))


class Log:
    """The files of one log, in order, read as if they were one. Not empty.

    complete, damage, lost: as of McapFile, of all files together.
    """

    def __init__(self, files: dict[Path, McapFile]) -> None:
        self.files = files
        self.path = next(iter(files))
        first, last = files[self.path], list(files.values())[-1]
        self.attachments = last.attachments | first.attachments
        # What is said of the run is that of the first file, what is said of its end that of the last.
        self.metadata = last.metadata | {RUN: first.metadata[RUN]} if RUN in first.metadata else last.metadata

    @property
    def complete(self) -> bool:
        """Whether every file was closed."""
        return all(file.complete for file in self.files.values())

    @property
    def damage(self) -> list[str]:
        """What is wrong with the files, as far as they have been read."""
        return [self._of(path, sentence) for path, file in self.files.items() for sentence in file.damage]

    @property
    def lost(self) -> list[str]:
        """Of the damage, what is wrong with the data; without the end that a file lacks while it is written."""
        return [self._of(path, sentence) for path, file in self.files.items() for sentence in file.lost]

    @property
    def bytes(self) -> int:
        """Size of all files."""
        return sum(path.stat().st_size for path in self.files)

    def attached(self) -> Iterator[records.Attachment]:
        """Yield the attachments of the first file."""
        return self.files[self.path].attached()

    def messages(self) -> Iterator[RawMessage]:
        """Yield all messages, in file order."""
        for file in self.files.values():
            yield from file.messages()

    def batches(self) -> Iterator[Batch]:
        """Yield all messages, those of some chunks together."""
        # Verbs that read no message need not wait for NumPy.
        from zenoh_cbef.log.mcap.heads import gathered  # noqa: PLC0415

        for file in self.files.values():
            yield from gathered(file.batches())

    def messages_in_order(self) -> Iterator[RawMessage]:
        """Yield all messages by log time within each file."""
        for file in self.files.values():
            yield from file.messages_in_order()

    def summary(self) -> Summary:
        """What all files hold."""
        each = [file.summary() for file in self.files.values()]
        counts: Counter[str] = Counter()
        for one in each:
            counts.update(one.channel_counts)
        full = [one for one in each if one.message_count]
        return Summary(
            library=each[0].library,
            message_count=counts.total(),
            channel_counts=dict(counts),
            start_time=min((one.start_time for one in full), default=0),
            end_time=max((one.end_time for one in full), default=0),
            chunks=sum(one.chunks for one in each),
        )

    def _of(self, path: Path, sentence: str) -> str:
        return sentence if len(self.files) == 1 else f"{path.name}: {sentence}"


def _existing(path: Path) -> Path | None:
    candidates = [path, path.with_name(path.name + ACTIVE)]
    return next((candidate for candidate in candidates if candidate.is_file()), None)


def _open(path: Path) -> McapFile:
    try:
        return McapFile(path)
    except NotMcapError as error:
        raise UserError(f"{error}; give a log that 'run' or 'record' wrote") from None
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from None


def _number(file: McapFile) -> int:
    return whole(file.metadata.get(RUN, {}).get("part", "1")) or 1


def _is_part(first: McapFile, other: McapFile, number: int) -> bool:
    """Whether a file beside a log is that part of the same recording: its name alone does not tell."""
    told = (file.metadata.get(RUN, {}) for file in (first, other))
    shared, found = ({name: said.get(name) for name in ("run", "started")} for said in told)
    return shared == found and _number(other) == number
