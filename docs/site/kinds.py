"""The page of what has kinds: filters, motions, faults, scenarios and experiments, from their registries."""

from __future__ import annotations

import inspect

from zenoh_cbef.courses import COURSES
from zenoh_cbef.experiment.file import purposes as experiments
from zenoh_cbef.faults import KINDS as FAULTS
from zenoh_cbef.scenario.load import purposes as scenarios
from zenoh_cbef.tracking.filters import KINDS
from zenoh_cbef.tracking.motion import MOTIONS

_HEAD = """# Kinds of filters, motions and faults

Made from the code: what a scenario can name. [Filters](../filters.md) compares the filters, and [the scenario
file](../scenario.md) tells the keys.
"""


def page() -> str:
    """The page as Markdown."""
    parts = [
        _HEAD,
        _table("Filters", "filter.kind", {name: _first(kind) for name, kind in KINDS.items()}),
        _table("Motions of the target", "target.motion", {name: _first(kind) for name, kind in COURSES.items()}),
        _table("Motions that filters assume", "filter.motion", {name: _first(kind) for name, kind in MOTIONS.items()}),
        _table("Faults", "kind` of `[[fault]]", {name: _first(kind) for name, kind in sorted(FAULTS.items())}),
        _table("Built-in scenarios", "run", scenarios()),
        _table("Built-in experiments", "experiment", experiments()),
    ]
    return "\n".join(parts)


def _table(heading: str, named: str, rows: dict[str, str]) -> str:
    lines = "".join(
        f"| `{name}` | {' '.join(what.split()).replace('|', chr(92) + '|')} |\n" for name, what in rows.items()
    )
    return f"## {heading}\n\n| `{named}` | what it is |\n|---|---|\n{lines}"


def _first(thing: object) -> str:
    """The first paragraph of a docstring."""
    return (inspect.getdoc(thing) or "").partition("\n\n")[0]
