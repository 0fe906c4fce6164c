"""A log that is estimated again, and what was said in it, to compare with the original."""

from __future__ import annotations

import shutil
from collections import defaultdict
from pathlib import Path

import msgpack

from tests.processes.conftest import World
from zenoh_cbef.log.mcap.reader import McapFile

OWN = ("run", "sent", "latency", "at")
"""Fields that are of the run, not of what was computed."""


def said(log: Path) -> dict[str, list[dict]]:
    """All that target and agents sent, without what is of the run, by key."""
    found: dict[str, list[dict]] = defaultdict(list)
    for message in McapFile(log).messages():
        body = msgpack.unpackb(message.data)
        assert message.sequence == body["seq"]
        key = message.channel.topic.split("/", 2)[2]
        if key.startswith("event/"):
            if body["kind"] != "finished":
                continue
            body["data"]["sent"] = {name.split("/", 2)[2]: count for name, count in body["data"]["sent"].items()}
            # Last words are said until they are heard, and numbered for that.
            found.pop(key, None)
            body["data"].pop("word", None)
            body["seq"] = 0
        found[key].append({name: value for name, value in body.items() if name not in OWN})
    return dict(found)


def again(world: World, log: Path, *overrides: str) -> Path:
    output = world.folder / "again" / f"{len(overrides)}.mcap"
    shutil.rmtree(output.parent, ignore_errors=True)
    options = [part for one in overrides for part in ("--set", one)]
    done = world.done("reestimate", str(log), *options, "--output", str(output), "--run", "again")
    assert "times faster than real time" in done.stdout
    assert "equal bit for bit" in world.verdict(log=output)
    return output
