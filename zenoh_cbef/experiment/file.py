"""The experiment file: its keys, how it is read, and the mistakes that a user can make in it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, Field, JsonValue, ValidationError

from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import Json, read_toml
from zenoh_cbef.quantities import Finite, Seed
from zenoh_cbef.scenario.library import Library, purpose_of
from zenoh_cbef.scenario.load import put
from zenoh_cbef.scenario.table import Table
from zenoh_cbef.words import meant

_LIBRARY = Library(files("zenoh_cbef.experiment") / "builtin", "experiment")
builtin_names, purposes, read_source = _LIBRARY.names, _LIBRARY.purposes, _LIBRARY.read

Key = Annotated[str, Field(min_length=1, pattern=r"^[^.\s]+(\.[^.\s]+)*$", description="a key as in consensus.rounds")]


class Vary(Table):
    """One axis of the grid: a scenario key and the values that it takes in turn."""

    key: Key
    values: Annotated[tuple[JsonValue, ...], Field(min_length=1, description="a list of one or more values")]


class Expect(Table):
    """What the median over the seeds of every cell that `where` selects has to satisfy."""

    metric: Annotated[str, Field(min_length=1)]
    at_most: Finite | None = None
    at_least: Finite | None = None
    where: dict[str, JsonValue] = Field(default={}, description="a table of varied keys and their values")

    def mistakes(self) -> dict[str, bool]:
        """See Table."""
        said = f"the expectation of {self.metric} has no limit; give at_most or at_least"
        return {said: self.at_most is None and self.at_least is None}

    def holds(self, value: float) -> bool:
        """Whether a value keeps the limits."""
        above = self.at_least is None or value >= self.at_least
        return above and (self.at_most is None or value <= self.at_most)


class Experiment(Table):
    """An experiment. seeds: how many, from the base scenario's on, or which. fault: None leaves the base's."""

    base: str = "tracking"
    seeds: Annotated[int, Field(ge=1, le=1_000_000)] | Annotated[tuple[Seed, ...], Field(min_length=1)] = Field(
        default=20, description="a number of at least 1, or a list of seeds"
    )
    engine: Literal["simulate", "processes"] = "simulate"
    set: dict[str, JsonValue] = Field(default={}, description="a table of scenario keys and their values")
    fault: tuple[dict[str, JsonValue], ...] | None = Field(
        default=None, description="a list of tables, written [[fault]]"
    )
    vary: tuple[Vary, ...] = Field(default=(), description="a list of tables, each written [[vary]]")
    expect: tuple[Expect, ...] = Field(default=(), description="a list of tables, each written [[expect]]")

    def mistakes(self) -> dict[str, bool]:
        """See Table."""
        keys = [one.key for one in self.vary]
        twice = next((key for key in keys if keys.count(key) > 1), None)
        return {
            f"{twice} is varied twice; list all its values in one [[vary]]": twice is not None,
            "seed is not varied or set; give the seeds as seeds = 20 or seeds = [1, 2, 3]": "seed"
            in {*keys, *self.set},
            "seeds lists a seed twice; list each once": (
                isinstance(self.seeds, tuple) and len(set(self.seeds)) < len(self.seeds)
            ),
        }


@dataclass(frozen=True)
class Written:
    """An experiment with its name, its text, and the folder that its relative paths start from."""

    name: str
    source: str
    folder: Path
    experiment: Experiment

    @property
    def purpose(self) -> str:
        """The comment that the file begins with."""
        return purpose_of(self.source)


def read_experiment(name: str, changes: Mapping[str, object] | None = None) -> Written:
    """Read an experiment; changes: top-level keys that replace the file's. Raises UserError with the remedy."""
    source, folder = read_source(name)
    try:
        data = read_toml(source)
        data = {**data, **(changes or {})}
        text = json.dumps(data, allow_nan=True)
    except TypeError:
        raise UserError(f"{name} holds a date, which no key takes; write it as text or number") from None
    except (ValueError, RecursionError) as error:
        raise UserError(f"{name} is not valid TOML: {error}; correct that line") from None
    try:
        experiment = Experiment.model_validate_json(text, strict=True)
    except ValidationError as error:
        raise UserError(f"{name}: {_sentence(error)}") from None
    return Written(Path(name).stem if name not in builtin_names() else name, source, folder, experiment)


def flat(table: Mapping[str, Json]) -> dict[str, Json]:
    """A [set] table by dotted keys, however its tables were written."""
    found: dict[str, Json] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            found |= {f"{key}.{rest}": each for rest, each in flat(value).items()}
        else:
            found[key] = value
    return found


def changed(data: dict[str, object], experiment: Experiment) -> dict[str, object]:
    """Apply the experiment's faults and settings to the base's tables."""
    if experiment.fault is not None:
        data["fault"] = [dict(one) for one in experiment.fault]
    for key, value in flat(experiment.set).items():
        put(data, key, value)
    return data


def _sentence(error: ValidationError) -> str:
    mistake = max(error.errors(include_url=False), key=lambda one: one["type"] == "extra_forbidden")
    place, kind = mistake["loc"], mistake["type"]
    parts = [part for part in place if isinstance(part, int) or not part.startswith(("constrained", "tuple", "int"))]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")
    tables: dict[str, type[BaseModel]] = {"vary": Vary, "expect": Expect}
    table = tables.get(str(place[0]) if place else "", Experiment)
    if kind == "extra_forbidden":
        known = list((table if len(place) > 1 else Experiment).model_fields)
        near = meant(str(place[-1]), known, f"the keys are {', '.join(known)}")
        return f"{key} is not a key of an experiment; {near}"
    if kind == "missing":
        return f"{key} is missing; add it"
    if kind == "value_error":
        return str(mistake["ctx"]["error"])
    if kind == "model_type":
        return f"{key} must be a table of keys"
    field = next((table.model_fields[str(part)] for part in reversed(parts) if part in table.model_fields), None)
    field = field or (Experiment.model_fields.get(str(place[0])) if place else None)
    said = str(mistake["msg"]).removeprefix("Value error, ").replace("Input should", "must", 1)
    return f"{key} must be {field.description}" if field and field.description else f"{key} {said}"
