"""Logs whose messages, keys, records and bytes are mutated, through every verb that reads a log."""

from __future__ import annotations

import io
import shutil
import sys
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout, suppress
from functools import partial
from pathlib import Path
from unittest.mock import patch

from mcap.writer import CompressionType, Writer

from benchmarks.fuzz_material import AGENTS, RUN, Material
from benchmarks.made_logs import MadeLog
from zenoh_cbef.cli.calling.main import main
from zenoh_cbef.errors import UserError
from zenoh_cbef.log.common.naming import END, RESOLVED
from zenoh_cbef.log.common.naming import RUN as ABOUT
from zenoh_cbef.log.mcap.contents import RawMessage
from zenoh_cbef.log.read.parts import open_log
from zenoh_cbef.log.tools.playlist import Playlist, Selection
from zenoh_cbef.log.write.run_log import RunLog
from zenoh_cbef.scenario.load import load, to_toml

_STEPS = 8
_MUTATED = 40
"""Messages of a log that are mutated, or put in."""

VERBS: dict[str, tuple[str, ...]] = {
    "check": ("{log}",),
    "info": ("{log}",),
    "verify": ("{log}",),
    "analyze": ("{log}",),
    "timeline": ("{log}", "-o", "picture.html"),
    "cat": ("{log}",),
    "filter": ("{log}", "-o", "filtered.mcap", "-y", ".*/(estimate|event|beacon.*)"),
    "merge": ("{log}", "{base}", "-o", "merged.mcap"),
    "recover": ("{log}", "-o", "recovered.mcap"),
    "export": ("{log}", "-o", "arrays.npz"),
    "export viz": ("{log}", "--to", "viz", "-o", "scene.mcap"),
    "reestimate": ("{log}", "-o", "again", "--run", "again"),
}


class Logs:
    """A sound log of a run, and mutated ones of it, in a folder."""

    def __init__(self, folder: Path) -> None:
        self.base, self._folder = folder / "base.mcap", folder
        self.scenario = load("tracking", [f"agents.count={AGENTS}", f"steps={_STEPS}"]).scenario
        MadeLog(self.base, self.scenario, RUN).write()
        self._messages = [*open_log(self.base).messages()]
        self._plain = self._without_crcs()

    def mutated(self, material: Material, path: Path) -> None:
        """Write a log that is wrong somewhere."""
        draw = material.random.random()
        if draw < 0.6:
            self._of_messages(material, path)
        else:
            data = self.base.read_bytes() if draw < 0.7 else self._plain
            path.write_bytes(material.bytes(data))

    def _of_messages(self, material: Material, path: Path) -> None:
        """Some messages are others, in the file as a recorder writes it."""
        log = RunLog(path, self.scenario.record)
        resolved = to_toml(self.scenario)
        if material.random.random() < 0.2:
            resolved = material.bytes(resolved.encode()).decode(errors="replace")
        said = {"run": RUN, "name": "fuzz", "seed": "1", "version": "", "host": "", "started": ""}
        log.describe(source="", resolved=resolved, run=said)
        for key, data, moment in self._changed(material):
            log.add(key, data, moment)
        log.close({"status": material.pick(("finished", "stopped", "x"))})

    def _changed(self, material: Material) -> Iterator[tuple[str, bytes, int]]:
        chosen = {material.random.randrange(len(self._messages)) for _ in range(material.random.randrange(_MUTATED))}
        for place, message in enumerate(self._messages):
            key, data, moment = message.channel.topic, message.data, message.log_time
            draw = material.random.random() if place in chosen else 1.0
            if draw < 0.3:
                key = material.key()
            elif draw < 0.6:
                data = material.bytes(data)
            elif draw < 0.7:
                continue
            elif draw < 1.0:
                _, other, forged = material.message()
                yield other, forged, moment
            yield key, data, moment

    def _without_crcs(self) -> bytes:
        """The same log as another program might write it: nothing guards its bytes."""
        stream = io.BytesIO()
        writer = Writer(stream, chunk_size=8192, compression=CompressionType.NONE, enable_crcs=False)
        writer.start()
        file = open_log(self.base)
        writer.add_attachment(0, 0, RESOLVED, "application/toml", file.attachments[RESOLVED])
        writer.add_metadata(ABOUT, file.metadata[ABOUT])
        channels: dict[int, int] = {}
        for message in self._messages:
            channel = message.channel
            if channel.id not in channels:
                schema = writer.register_schema(channel.schema_name, channel.schema_encoding, channel.schema_data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema)
            _copy(writer, channels[channel.id], message)
        writer.add_metadata(END, file.metadata[END])
        writer.finish()
        return stream.getvalue()


def _copy(writer: Writer, channel: int, message: RawMessage) -> None:
    writer.add_message(channel, message.log_time, message.data, message.publish_time, message.sequence)


def call(verb: str, words: tuple[str, ...]) -> int:
    """The exit status of the program as a user calls it. Raises what would be a traceback."""
    output = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with patch.object(sys, "argv", ["zenoh-cbef", verb, *words]), redirect_stdout(output), redirect_stderr(output):
        try:
            main()
        except SystemExit as end:
            return int(end.code or 0)
    return 0


def read_by_all(log: Path, base: Path, folder: Path) -> Iterator[tuple[str, str]]:
    """Every verb, and how it ended: "status 0", or the end of a traceback that begins with "crash"."""
    for name, arguments in VERBS.items():
        words = tuple(word.format(log=log, base=base) for word in arguments)
        yield name, _outcome(partial(call, name.split()[0], words), folder)
    yield "playlist", _outcome(partial(_play, log), folder)


def _play(log: Path) -> int:
    with suppress(UserError):
        for _ in Playlist(open_log(log), Selection()).items(0, 1 << 64):
            pass
    return 0


def _outcome(act: Callable[[], int], folder: Path) -> str:
    with chdir(folder), warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            return f"status {act()}"
        except Exception as error:  # noqa: BLE001 - this is what is looked for
            last = traceback.extract_tb(error.__traceback__)[-1]
            return f"crash: {type(error).__name__} at {Path(last.filename).name}:{last.lineno}: {error!s:.80}"


def fuzz_logs(folder: Path, seed: int, numbers: Iterable[int]) -> dict[str, Counter[str]]:
    """How every verb ended on so many mutated logs."""
    logs, material = Logs(folder), Material(seed)
    found: dict[str, Counter[str]] = {}
    for number in numbers:
        place = folder / f"log-{number}"
        place.mkdir()
        logs.mutated(material, place / "run.mcap")
        for verb, end in read_by_all(place / "run.mcap", logs.base, place):
            found.setdefault(verb, Counter())[end] += 1
        shutil.rmtree(place)
    return found
