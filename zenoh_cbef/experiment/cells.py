"""The grid of an experiment: one cell per combination of varied values, and how `where` names cells."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from itertools import product

from zenoh_cbef.errors import UserError
from zenoh_cbef.experiment.file import Written, changed
from zenoh_cbef.plain import Json, whole
from zenoh_cbef.quantities import SEEDS
from zenoh_cbef.scenario import Scenario
from zenoh_cbef.scenario.checks import check
from zenoh_cbef.scenario.load import builtin_names, complete, put, read_tables
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.size import refuse_a_trace_beyond_memory

# What `loss = 0.3` means, where a kind of fault has several numbers.
_SHARED = ("kind", "from", "until", "links", "agents")


@dataclass(frozen=True)
class Cell:
    """One combination of varied values. facts: what `where` may name. scenario: None where `error` says why not."""

    index: int
    values: Mapping[str, Json]
    facts: Mapping[str, Json]
    scenario: Scenario | None
    error: str = ""

    @property
    def label(self) -> str:
        """The varied values in words."""
        return ", ".join(f"{key} = {value}" for key, value in self.values.items()) or "all runs"


def cells_of(written: Written) -> list[Cell]:
    """Every cell, the last varied key changing fastest.

    Raises UserError for a mistake that all cells share; a cell keeps a mistake of its own in `error`.
    """
    experiment = written.experiment
    base = experiment.base
    if base not in builtin_names():
        base = str(written.folder / base)
        if not (written.folder / experiment.base).is_file():
            base = experiment.base  # its own sentence says that there is none, and what is near
    _, tables, folder = read_tables(base)
    tables = changed(tables, experiment)
    axes = [[(one.key, value) for value in one.values] for one in experiment.vary]
    cells = []
    for index, chosen in enumerate(product(*axes)):
        values, data = dict(chosen), deepcopy(tables)
        try:
            for key, value in values.items():
                put(data, key, deepcopy(value))
            plan = Plan(complete(data, written.name, folder))
            check(plan)
            refuse_a_trace_beyond_memory(plan)
        except UserError as error:
            cells.append(Cell(index, values, facts_of(values, data), None, str(error)))
        else:
            cells.append(Cell(index, values, facts_of(values, data), plan.scenario))
    if all(cell.scenario is None for cell in cells):
        raise UserError(cells[0].error)
    _distinct(cells)
    return cells


def seeds_of(cell: Cell, seeds: int | Sequence[int]) -> list[int]:
    """The seeds of a cell's runs."""
    first = cell.scenario.seed if cell.scenario else 1
    return [(first + more) % SEEDS for more in range(seeds)] if isinstance(seeds, int) else list(seeds)


def facts_of(values: Mapping[str, Json], data: Mapping[str, object]) -> dict[str, Json]:
    """What `where` may name in a cell, from the strongest claim on a name to the weakest.

    A varied key in full; its last parts (fault.0.probability: probability); the kind of the fault it belongs to
    (loss, loss.probability); a fault that is not varied by its kind. A name that two varied keys claim names neither.
    """
    claims: dict[str, set[str]] = {}
    for key in values:
        parts = key.split(".")
        names = {".".join(parts[start:]) for start in range(1, len(parts))}
        if parts[0] == "fault" and len(parts) == 3:
            kind = _kind(data, parts[1])
            names |= {kind, f"{kind}.{parts[2]}", f"fault.{kind}.{parts[2]}"}
        for name in names:
            claims.setdefault(name, set()).add(key)
    facts = {name: value for name, value in _of_faults(data).items() if name not in claims}
    facts |= {name: values[next(iter(keys))] for name, keys in claims.items() if len(keys) == 1}
    return facts | dict(values)


def _of_faults(data: Mapping[str, object]) -> dict[str, Json]:
    listed = data.get("fault")
    faults = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    kinds = [str(one.get("kind")) for one in faults]
    facts: dict[str, Json] = {}
    for kind, one in zip(kinds, faults, strict=True):
        numbers = {key: value for key, value in one.items() if key not in _SHARED}
        if kinds.count(kind) == 1:
            facts |= {f"{kind}.{key}": value for key, value in numbers.items()}
        if kinds.count(kind) == 1 and len(numbers) == 1:
            facts[kind] = next(iter(numbers.values()))
    return facts


def selected(cells: Sequence[Cell], where: Mapping[str, Json], metric: str) -> list[Cell]:
    """The cells that `where` names. Raises UserError where a name or a value is in none."""
    found = list(cells)
    for name, value in where.items():
        known = {fact for cell in cells for fact in cell.facts}
        if name not in known:
            told = ", ".join(sorted({key for cell in cells for key in cell.values})) or "none"
            raise UserError(
                f"the expectation of {metric}: where.{name} names no varied key, or more than one; varied is {told}"
            )
        of_name = list(found)
        found = [cell for cell in found if name in cell.facts and _same(cell.facts[name], value)]
        if not found:
            there = dict.fromkeys(json.dumps(cell.facts[name]) for cell in of_name if name in cell.facts)
            raise UserError(
                f"the expectation of {metric}: no cell has where.{name} = {json.dumps(value)}; use one of its values, "
                f"{', '.join(there)}"
            )
    return found


def _same(first: Json, second: Json) -> bool:
    return isinstance(first, bool) == isinstance(second, bool) and bool(first == second)


def _kind(data: Mapping[str, object], part: str) -> str:
    faults, number = data.get("fault"), whole(part)
    if isinstance(faults, list) and number is not None and number < len(faults) and isinstance(faults[number], dict):
        return str(faults[number].get("kind"))
    return part


def _distinct(cells: Sequence[Cell]) -> None:
    met: set[str] = set()
    for cell in cells:
        before = len(met)
        met.add(json.dumps(cell.values))
        if len(met) == before:
            raise UserError(f"the values {cell.label} are listed twice in [[vary]]; list each once")
