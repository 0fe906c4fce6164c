"""What a shell completes: names of scenarios, experiments, runs, logs and faults.

Each is imported only where a shell asks for it, as what a verb imports counts in every call.
"""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path

from zenoh_cbef.plugins import short_names

_BREAKS = ("=", ":")


def mend_words() -> None:
    """Join again what bash has split: it takes the = and : of KEY=VALUE and tcp/HOST:PORT for words of their own."""
    current, joined = int(os.environ["COMP_CWORD"]), list[str]()
    for number, word in enumerate(os.environ["COMP_WORDS"].split("\n")):
        if joined and (word in _BREAKS or joined[-1].endswith(_BREAKS)):
            joined[-1] += word
        else:
            joined.append(word)
        if number == current:
            os.environ["COMP_CWORD"] = str(len(joined) - 1)
    os.environ["COMP_WORDS"] = "\n".join(joined)


def scenarios(incomplete: str) -> list[tuple[str, str]]:
    """The built-in scenarios that begin so, with what they are for."""
    return _beginning(import_module("zenoh_cbef.scenario.load").purposes(), incomplete)


def experiments(incomplete: str) -> list[tuple[str, str]]:
    """The built-in experiments, likewise."""
    return _beginning(import_module("zenoh_cbef.experiment.file").purposes(), incomplete)


def runs(incomplete: str) -> list[tuple[str, str]]:
    """The runs that go on on this host, with where they were started."""
    known = import_module("zenoh_cbef.outside.registry").known_runs()
    return _beginning({name: str(run) for name, run in known.items()}, incomplete)


def logs(incomplete: str) -> list[tuple[str, str]]:
    """The runs in logs/, with their files. Where none begins so, a shell completes the names of files."""
    return _beginning({path.parent.name: str(path) for path in sorted(Path("logs").glob("*/run.mcap*"))}, incomplete)


def faults(incomplete: str) -> list[tuple[str, str]]:
    """The kinds of faults, with what they do."""
    kinds = import_module("zenoh_cbef.faults").KINDS
    told = {kind: (one.__doc__ or "").partition("\n")[0] for kind, one in kinds.items()}
    others = {name: f"Of another package: {value}" for name, value in short_names("faults").items()}
    return _beginning(told | others, incomplete)


def _beginning(described: dict[str, str], incomplete: str) -> list[tuple[str, str]]:
    return [(name, words) for name, words in described.items() if name.startswith(incomplete)]
