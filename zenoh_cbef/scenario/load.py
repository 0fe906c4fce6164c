"""From a name or a file, with overrides, to a checked scenario; and back to TOML."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args

import tomli_w
from pydantic import BaseModel, ValidationError

from zenoh_cbef.datasets import read_dataset
from zenoh_cbef.errors import UserError
from zenoh_cbef.scenario.model import Scenario

_BUILTIN = files("zenoh_cbef.scenario") / "builtin"


@dataclass(frozen=True)
class Loaded:
    """A scenario as it was written (TOML text), and as it is meant: complete, with recorded data laid out."""

    source: str
    scenario: Scenario


def builtin_names() -> list[str]:
    """The built-in scenarios."""
    return sorted(entry.name.removesuffix(".toml") for entry in _BUILTIN.iterdir() if entry.name.endswith(".toml"))


def read_source(name: str) -> tuple[str, Path]:
    """The TOML text of a built-in scenario or a file, and the folder that its relative paths start from."""
    if name in builtin_names():
        return (_BUILTIN / f"{name}.toml").read_text(encoding="utf-8"), Path.cwd()
    path = Path(name)
    if not path.is_file():
        near = get_close_matches(name, builtin_names(), 1)
        hint = f"did you mean {near[0]!r}?" if near else "see 'zenoh-cbef scenario list', or give a file"
        raise UserError(f"there is no built-in scenario and no file named {name!r}; {hint}")
    try:
        return path.read_text(encoding="utf-8"), path.resolve().parent
    except UnicodeDecodeError:
        raise UserError(f"{path} is not a text file; a scenario is written in TOML") from None


def load(name: str, overrides: Sequence[str] = ()) -> Loaded:
    """Read a scenario, apply `a.b=c` overrides, lay out recorded data. Raises UserError with the remedy."""
    source, folder = read_source(name)
    try:
        data = tomllib.loads(source)
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{name} is not valid TOML: {error}; mend that line") from None
    for override in overrides:
        _override(data, override)
    return Loaded(source, _lay_out(parse(data, name), folder))


def parse(data: Mapping[str, Any], name: str) -> Scenario:
    """A scenario from its tables. Raises UserError naming file, key and remedy."""
    try:
        return Scenario.model_validate(data)
    except ValidationError as error:
        raise UserError(f"{name}: {_sentence(error, data)}") from None


def to_toml(scenario: Scenario) -> str:
    """The scenario as TOML; None is left out, as it means "derive it"."""
    return tomli_w.dumps(scenario.model_dump(mode="json", by_alias=True, exclude_none=True))


def _override(data: dict[str, Any], override: str) -> None:
    key, separator, text = override.partition("=")
    keys = [part.strip() for part in key.split(".")]
    if not separator or not all(keys):
        raise UserError(f"--set {override!r} is not of the form a.b=value, as in --set consensus.rounds=5")
    try:
        value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    table = data
    for part in keys[:-1]:
        table = table.setdefault(part, {})
        if not isinstance(table, dict):
            raise UserError(f"--set {override!r}: {part} is not a table of the scenario; see docs/scenario.md")
    table[keys[-1]] = value


def _lay_out(scenario: Scenario, folder: Path) -> Scenario:
    # Agents on other hosts have no dataset folder: what they need of it travels in the resolved scenario.
    if scenario.target.motion != "dataset":
        return scenario
    path = (folder / Path(scenario.target.path or "").expanduser()).resolve()
    dataset = read_dataset(path)
    positions = [tuple(row) for row in dataset.anchors.tolist()]
    data = scenario.model_dump(by_alias=True)
    data["target"]["path"] = str(path)
    data["agents"].update(count=len(positions), positions=positions, labels=dataset.labels)
    most = dataset.steps(scenario.dt)
    if scenario.steps is not None and scenario.steps > most:
        raise UserError(f"steps = {scenario.steps}, but {path} fills only {most} steps of {scenario.dt} s; lower it")
    data["steps"] = scenario.steps or most
    return parse(data, str(path))


def _known_keys(path: Sequence[str | int]) -> list[str]:
    model: Any = Scenario
    for part in path:
        field = next(
            (one for name, one in model.model_fields.items() if part in (name, one.alias)), None
        ) if isinstance(part, str) else None
        if field is None:
            return []
        candidates = [field.annotation, *get_args(field.annotation)]
        model = next((one for one in candidates if isinstance(one, type) and issubclass(one, BaseModel)), None)
        if model is None:
            return []
    return [one.alias or name for name, one in model.model_fields.items()]


def _sentence(error: ValidationError, data: Mapping[str, Any]) -> str:
    """The first mistake of a validation, as one sentence."""
    first = error.errors(include_url=False)[0]
    path = [part for part in first["loc"] if not (isinstance(part, str) and part.startswith(("function-", "tuple")))]
    key = ".".join(str(part) for part in path)
    if first["type"] == "extra_forbidden":
        near = get_close_matches(str(path[-1]), _known_keys(path[:-1]), 1)
        hint = f"did you mean {near[0]!r}?" if near else "remove it, or see docs/scenario.md for the keys"
        return f"{key} is not a key of a scenario; {hint}"
    message = first["msg"].removeprefix("Value error, ")
    message = message[0].lower() + message[1:]
    given = first["input"]
    shown = f" (given: {given!r})" if isinstance(given, str | int | float) and str(given) not in message else ""
    more = f" ({len(error.errors()) - 1} more)" if _independent(error) else ""
    return f"{key + ': ' if key else ''}{message}{shown}{more}"


def _independent(error: ValidationError) -> bool:
    # The branches of a union all complain of the same key: that is one mistake, not several.
    return len({one["loc"][:2] for one in error.errors()}) > 1
