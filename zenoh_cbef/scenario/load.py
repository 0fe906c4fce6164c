"""From a name or a file, with overrides, to a checked scenario; and back to TOML."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import files
from pathlib import Path

import numpy as np
import tomli_w
from pydantic import ValidationError

from zenoh_cbef.datasets import dataset_folder, read_dataset
from zenoh_cbef.datasets.gaps import gap
from zenoh_cbef.datasets.scatter import scatter
from zenoh_cbef.datasets.spikes import without_spikes
from zenoh_cbef.errors import UserError
from zenoh_cbef.plain import read_toml, whole
from zenoh_cbef.scenario.library import Library
from zenoh_cbef.scenario.mistakes import sentence
from zenoh_cbef.scenario.model import MOST_STEPS, Scenario
from zenoh_cbef.scenario.paths import step_times
from zenoh_cbef.scenario.plan import Plan
from zenoh_cbef.scenario.plugged import PackageAbsentError, lacking, stamped
from zenoh_cbef.scenario.recorded_motion import recorded_motion
from zenoh_cbef.words import counted

_SHORT_NUMBER = re.compile(r"[+-]?(\.\d+|\d+\.)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)
"""A number as people write it and TOML does not take it: .3, or 5."""

_APART = 3
"""How many ranges apart those are about which recorded ranges scatter: of errors that last, next ones differ little."""

_LIBRARY = Library(files("zenoh_cbef.scenario") / "builtin", "scenario")
builtin_names, purposes, read_source = _LIBRARY.names, _LIBRARY.purposes, _LIBRARY.read


@dataclass(frozen=True)
class Loaded:
    """A scenario as it was written (TOML text), and as it is meant: complete, with recorded data laid out."""

    source: str
    scenario: Scenario

    @cached_property
    def plan(self) -> Plan:
        """What the scenario means."""
        return Plan(self.scenario)


def load(name: str, overrides: Sequence[str] = ()) -> Loaded:
    """Read a scenario, apply `a.b=c` overrides, lay out recorded data. Raises UserError with the remedy."""
    source, data, folder = read_tables(name)
    for override in overrides:
        apply(data, override)
    return Loaded(source, complete(data, name, folder))


def read_tables(name: str) -> tuple[str, dict[str, object], Path]:
    """As `read_source`, with the text's tables between the two."""
    source, folder = read_source(name)
    try:
        return source, read_toml(source), folder
    except ValueError as error:
        raise UserError(f"{name} is not valid TOML: {error}; correct that line") from None


def complete(data: Mapping[str, object], name: str, folder: Path) -> Scenario:
    """The scenario of these tables, complete: with recorded data laid out, and what its plug-ins are.

    Relative paths start from the folder.
    """
    return _lay_out(stamped(parse(data, name)), folder)


def parse(data: Mapping[str, object], name: str) -> Scenario:
    """A scenario from its tables. Raises UserError naming file, key and remedy."""
    try:
        text = json.dumps(data, default=_dated)
    except (ValueError, RecursionError):
        raise UserError(f"{name} nests too deeply or holds a number of too many digits; correct it") from None
    try:
        # Strict JSON: lists become tuples and integers floats, but no text or boolean becomes a number.
        return Scenario.model_validate_json(text, strict=True)
    except ValidationError as error:
        if absent := lacking(data):
            raise PackageAbsentError(f"{name}: {absent}") from None
        raise UserError(f"{name}: {sentence(error)}") from None


def to_toml(scenario: Scenario) -> str:
    """The scenario as TOML; None is left out, as it means "derive it"."""
    return tomli_w.dumps(scenario.model_dump(mode="json", by_alias=True, exclude_none=True))


def _dated(value: object) -> list[list[str]]:
    # TOML's dates have no place in a scenario; no key takes a list of lists of text.
    return [[str(value)]]


def put(data: dict[str, object], key: str, value: object) -> None:
    """Put a value at `a.b.c`; a table of a list is named by its place, or by its kind (fault.loss.probability).

    Raises UserError where the way there does not lead through tables.
    """
    *way, last = (part.strip() for part in key.split("."))
    place: dict[str, object] | list[object] = data
    for depth, part in enumerate(way, 1):
        if isinstance(place, list):
            inner = place[_entry(place, part, key)]
        else:
            inner = place.setdefault(part, [] if part == "fault" else {})
        if not isinstance(inner, dict | list):
            raise UserError(f"{key}: {'.'.join(way[:depth])} is not a table of the scenario; see docs/scenario.md")
        place = inner
    if isinstance(place, list):
        place[_entry(place, last, key)] = value
    else:
        place[last] = value


def put_all(data: dict[str, object], values: Mapping[str, object]) -> None:
    """Put values of Python at their keys, as TOML has them: lists for arrays and tuples, text for paths."""
    for key, value in values.items():
        put(data, key, _plain(value))


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value


def _entry(entries: list[object], part: str, key: str) -> int:
    number = whole(part)
    if number is not None and number < len(entries):
        return number
    kinds = [one.get("kind") if isinstance(one, dict) else None for one in entries]
    if kinds.count(part) == 1:
        return kinds.index(part)
    if part in kinds:
        raise UserError(f"{key}: {kinds.count(part)} entries are of the kind {part}; name one by its place, from 0")
    if not entries:
        raise UserError(
            f"{key}: there is no entry {part}, as the list is empty; give the whole list, as in "
            """fault=[{kind="loss", probability=0.3}]"""
        )
    there = ", ".join(f"{place} ({kind})" for place, kind in enumerate(kinds))
    raise UserError(f"{key}: there is no entry {part}; there is {there}; name one of these")


def value_of(text: str) -> object:
    """A value as a command line has it: TOML, or else text without quotes. Raises UserError for a broken list."""
    try:
        return read_toml(f"value = {text}")["value"]
    except ValueError as error:
        if text.lstrip().startswith(("[", "{", '"', "'")):
            raise UserError(f"the value is not valid TOML: {error}; write 0.1, not .1, and text in quotes") from None
        return float(text) if _SHORT_NUMBER.fullmatch(text.strip()) else text.strip()


def apply(data: dict[str, object], override: str) -> None:
    """Apply one `a.b=value` to a scenario's tables. Raises UserError where it is none."""
    key, separator, text = override.partition("=")
    if not separator or not all(part.strip() for part in key.split(".")):
        raise UserError(f"--set {override!r} is not of the form a.b=value, as in --set consensus.rounds=5")
    try:
        put(data, key, value_of(text))
    except UserError as error:
        raise UserError(f"--set {override!r}: {error}") from None


def _lay_out(scenario: Scenario, folder: Path) -> Scenario:
    # Agents on other hosts have no dataset folder: what they need of it travels in the resolved scenario.
    if scenario.target.motion != "dataset":
        return scenario.changed(steps=scenario.length)
    path = dataset_folder(scenario.target.path or "", folder).resolve()
    dataset = read_dataset(path)
    positions = [tuple(row) for row in dataset.anchors.tolist()]
    data = scenario.model_dump(by_alias=True)
    data["target"]["path"] = str(path)
    data["agents"].update(count=len(positions), positions=positions, labels=dataset.labels)
    most = dataset.steps(scenario.dt)
    if scenario.steps is not None and scenario.steps > most:
        filled = f"{path} fills only {counted(most, 'step')} of {scenario.dt} s"
        raise UserError(f"steps = {scenario.steps}, but {filled}; lower it")
    if scenario.steps is None and most > MOST_STEPS:
        why = gap(dataset) or "give a longer dt, or import a part of it"
        raise UserError(f"{path} fills {most} steps of {scenario.dt} s, more than {MOST_STEPS}: {why}")
    data["steps"] = steps = scenario.steps or most
    data["target"]["origin"] = origin = dataset.origin(scenario.dt)
    if dataset.has_truth and not np.isfinite(dataset.truth_at(origin + step_times(scenario, steps))).any():
        raise UserError(
            f"{path / 'truth.csv'} has no position in the {steps} steps of the run: its t goes from "
            f"{dataset.truth_time[0]:.12g} to {dataset.truth_time[-1]:.12g} s, that of ranges.csv from "
            f"{dataset.range_time[0]:.12g} to {dataset.range_time[-1]:.12g} s; bring both to one clock"
        )
    plain = without_spikes(dataset) if scenario.filter.defaults > 20 else dataset
    if scenario.filter.acceleration_interval is None:
        data["filter"]["acceleration_interval"] = dataset.interval
        if scenario.filter.acceleration_std is None and scenario.filter.defaults > 14:
            data["filter"].update(recorded_motion(scenario, plain))
    today = scenario.filter.defaults > 11
    if scenario.filter.range_std == "auto" and (today or "range_std" not in scenario.sensor.model_fields_set):
        # A noise that begins far below the true one comes too late for the first fix, and for biases.
        found = scatter(plain, _APART if today else 1) or 0.0
        data["sensor"]["range_std"] = max(scenario.sensor.range_std, found)
    return parse(data, str(path))
