"""A scenario as Python describes it: a name, a file or a scenario, and values at keys."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from zenoh_cbef.plain import read_toml
from zenoh_cbef.scenario.load import Loaded, complete, put_all, read_tables, to_toml
from zenoh_cbef.scenario.model import Scenario

What = str | Path | Scenario
"""The name of a built-in scenario, a TOML file, or a scenario."""


def described(what: What, values: Mapping[str, object]) -> Loaded:
    """A scenario with other values at keys such as "consensus.rounds". Raises UserError with the remedy."""
    if isinstance(what, Scenario):
        name, folder, source = what.name, Path.cwd(), to_toml(what)
        data: dict[str, object] = read_toml(source)
    else:
        name = str(what)
        source, data, folder = read_tables(name)
    put_all(data, values)
    return Loaded(source, complete(data, name, folder))
