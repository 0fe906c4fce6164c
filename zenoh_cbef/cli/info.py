"""info: describe a log."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.table import Table

from zenoh_cbef.cli.calling.offer import verb
from zenoh_cbef.cli.options.shared import AsJson, LogFile
from zenoh_cbef.cli.terminal.console import console, say
from zenoh_cbef.cli.terminal.fitting import Fitting
from zenoh_cbef.log.common.naming import END, RESOLVED, RUN
from zenoh_cbef.log.read.parts import Log, open_log
from zenoh_cbef.log.tools.collection import GOES_ON, goes_on
from zenoh_cbef.plain import read_toml

_FOREIGN = "none, as this is no log of zenoh-cbef"


@dataclass(frozen=True)
class _Described:
    """What --json prints. run, end: the log's metadata of these names. start: ns since the epoch; duration: s.

    goes_on: the log is still being written.
    """

    file: str
    parts: list[str]
    bytes: int
    complete: bool
    damage: list[str]
    library: str
    run: dict[str, str]
    end: dict[str, str] | None
    messages: int
    start: int
    duration: float
    channels: dict[str, int]
    attachments: dict[str, int]
    goes_on: bool

    @property
    def state(self) -> str:
        """Whether the log was closed."""
        if self.goes_on:
            return GOES_ON
        if not self.complete:
            return "cut off: readable as far as it goes"
        return "complete" if self.run else "whole"

    @property
    def ended(self) -> str:
        """How its run ended."""
        if self.end:
            return self.end.get("status", "-")
        sound = self.complete or self.goes_on
        return "no end record" + ("" if sound else ": the recorder was killed, or the file is cut off")


def _describe(file: Log) -> _Described:
    summary, growing = file.summary(), goes_on(file)
    return _Described(
        file=str(file.path),
        parts=[str(part) for part in file.files],
        bytes=file.bytes,
        complete=file.complete,
        damage=file.lost if growing else file.damage,
        library=summary.library,
        run=file.metadata.get(RUN, {}),
        end=file.metadata.get(END),
        messages=summary.message_count,
        start=summary.start_time,
        duration=max(0, summary.end_time - summary.start_time) / 1e9,
        channels=dict(sorted(summary.channel_counts.items())),
        attachments={name: len(data) for name, data in file.attachments.items()},
        goes_on=growing,
    )


def _payloads(file: Log) -> str:
    """In which numbers payloads travel, as the scenario has it; "" for the usual ones, and where it does not say."""
    try:
        stage = read_toml(file.attachments[RESOLVED].decode())["consensus"]
    except (KeyError, ValueError):
        return ""
    told = stage if isinstance(stage, dict) else {}
    precision, trigger = told.get("precision", "float64"), told.get("trigger", 0.0)
    if precision == "float64" and not trigger:
        return ""
    return f"{precision}, agents silent within {trigger:g} deviations" if trigger else str(precision)


def _info(log: LogFile = Path("logs/latest"), as_json: AsJson = False) -> None:
    """Describe a log, complete or cut off: what it holds, of which run, and whether anything is wrong with it."""
    file = open_log(log)
    found = _describe(file)
    if as_json:
        print(json.dumps(asdict(found)))
        return
    started = datetime.fromtimestamp(found.start / 1e9, UTC).isoformat(timespec="milliseconds")
    payloads = _payloads(file) if found.run else ""
    lines = {
        "file": f"{', '.join(found.parts)} ({found.bytes} bytes)",
        "state": found.state,
        "written by": found.library,
        "run": ", ".join(f"{name} {value}" for name, value in found.run.items()) or _FOREIGN,
        **({"ended": found.ended} if found.run else {}),
        **({"payloads": payloads} if payloads else {}),
        "messages": f"{found.messages} in {found.duration:.3f} s from {started}",
        "attachments": ", ".join(f"{name} ({size} bytes)" for name, size in found.attachments.items()) or "-",
    }
    for name, value in lines.items():
        say(f"{name + ':':13}{value}")
    for sentence in found.damage:
        say(f"damage:      {sentence}")
    table = Table("channel", box=None, pad_edge=False)
    table.add_column("messages", justify="right")
    table.add_column("per s", justify="right")
    for topic, count in found.channels.items():
        rate = count / found.duration if found.duration > 0 else 0.0
        table.add_row(topic, str(count), f"{rate:.1f}")
    console.print(Fitting(table))


VERB = verb(_info, "info logs/latest")
