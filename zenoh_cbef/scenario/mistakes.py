"""Says what is wrong with a scenario's tables, in one sentence that names the key and the remedy."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from difflib import get_close_matches
from typing import get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from zenoh_cbef.faults import KINDS, PLUGGED, Fault, LinkFault, SenderFault, SensorFault
from zenoh_cbef.scenario.model import Scenario

Place = Sequence[str | int]

_ALIKE = 0.8
"""How alike a key of another table must be to be the one that was meant, from 0 to 1."""

_MUST_BE = {
    "int_type": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "string_type": "text in quotes",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "model_type": "a table of keys",
    "dict_type": "a table of keys",
}


def sentence(error: ValidationError) -> str:
    """Say the first mistake of a validation in one sentence."""
    mistakes = error.errors(include_url=False)
    keys = [_key(one["loc"]) for one in mistakes]
    # All branches of a union complain of the same key; the one that got furthest is the one that was meant. A check
    # of our own comes after all others have passed.
    same = [one for one, key in zip(mistakes, keys, strict=True) if key[: len(keys[0])] == keys[0]]
    meant = max(same, key=lambda one: (len(one["loc"]), one["type"] == "value_error"))
    # A key that does not exist is often the one that another is missing for.
    unknown = [one for one in mistakes if one["type"] == "extra_forbidden" and one["loc"][:-1] == meant["loc"][:-1]]
    meant = unknown[0] if unknown and meant["type"] == "missing" else meant
    more = len({tuple(key[:2]) for key in keys}) - 1
    return _text(meant, same) + (f" ({more} more)" if more else "")


def _text(mistake: ErrorDetails, same: Sequence[ErrorDetails]) -> str:
    place, kind, given = mistake["loc"], mistake["type"], mistake["input"]
    key = _written(_key(place))
    if kind == "extra_forbidden":
        return _unknown_key(place, key)
    if kind in {"missing", "too_long"}:
        return _miscounted(mistake, same)
    if kind.startswith("union_tag"):
        return _unknown_kind(mistake, key)
    if kind == "json_invalid":
        return "it holds text that is not valid Unicode; correct it"
    if kind == "value_error":
        said = str(mistake["ctx"]["error"])
        return said if isinstance(given, dict) else f"{key} {said}"
    return f"{key} {_requirement(mistake)}, not {_shown(given)}"


def _requirement(mistake: ErrorDetails) -> str:
    place, kind = mistake["loc"], mistake["type"]
    field = _field(place)
    if field and field.description and kind != "finite_number" and not isinstance(place[-1], int):
        return f"must be {field.description}"
    said = str(mistake["msg"]).removeprefix("Value error, ").replace("Input should", "must", 1)
    return f"must be {_MUST_BE[kind]}" if kind in _MUST_BE else said


def _miscounted(mistake: ErrorDetails, same: Sequence[ErrorDetails]) -> str:
    place, given = mistake["loc"], mistake["input"]
    if mistake["type"] == "too_long":
        return f"{_written(_key(place))} must have {mistake['ctx']['max_length']} items, not {len(given)}"
    if not isinstance(place[-1], int):
        return f"{_written(_key(place))} is missing; add it"
    beside = [one["loc"][-1] for one in same if one["loc"][:-1] == place[:-1]]
    needed = 1 + max(number for number in beside if isinstance(number, int))
    return f"{_written(_key(place[:-1]))} must have {needed} items, not {len(given)}"


def _unknown_kind(mistake: ErrorDetails, key: str) -> str:
    kinds = ", ".join(tag for model in _models(mistake["loc"]) if (tag := _tag(model)))
    given = f", not {mistake['ctx']['tag']!r}" if "tag" in mistake["ctx"] else ""
    return f"{key}.kind must be one of {kinds}{given}"


def _unknown_key(place: Place, key: str) -> str:
    known = [name for model in _models(place[:-1]) for name in _names(model)]
    name = str(place[-1])
    beside = (_written([*_key(place[:-1]), one]) for one in get_close_matches(name, known, 1) or _begun(name, known))
    near = _everywhere(lambda one: one == name) or list(beside)
    near = near or _everywhere(lambda one: bool(get_close_matches(name, [one], 1, _ALIKE)))
    hint = (
        f"did you mean {' or '.join(map(repr, near))}?" if near else "remove it, or see docs/scenario.md for the keys"
    )
    return f"{key} is not a key of a scenario; {hint}"


def _begun(name: str, known: Sequence[str]) -> list[str]:
    """The only key that begins so, as `probability` does for `prob`."""
    found = [one for one in known if one.startswith(name)]
    return found if len(found) == 1 else []


def _everywhere(is_meant: Callable[[str], bool]) -> list[str]:
    """The keys of all tables but faults whose last part is meant, as in "consensus.rounds"."""
    return [
        f"{table}.{name}"
        for table, field in Scenario.model_fields.items()
        if table != "fault"
        for model in _tables(field.annotation)
        for name in _names(model)
        if is_meant(name)
    ]


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str | int | float):
        return f"{value!r:.60}"
    return "a table" if isinstance(value, dict) else "a list"


def _written(key: Place) -> str:
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return text.removeprefix(".")


def _key(place: Place) -> list[str | int]:
    """Leave out the names of union branches, which pydantic puts between the parts of a place."""
    return [part for _, part in _walk(place)]


def _walk(place: Place) -> Iterator[tuple[list[type[BaseModel]], str | int]]:
    """Yield the parts of a place that a user wrote, each with the tables that may stand there."""
    models: list[type[BaseModel]] = [Scenario]
    inside = branch = False
    for part in place:
        if isinstance(part, int):
            yield models, part
        elif branch and part != "?":
            # One of several things that may stand there names itself; only a table has keys.
            models, inside, branch = [model for model in models if model.__name__ in part], False, False
        elif inside and part == PLUGGED:
            models, inside = [LinkFault, SenderFault, SensorFault], False
        elif tagged := [model for model in models if inside and _tag(model) == part]:
            models, inside = tagged, False
        elif models:
            yield models, part
            field = _named(models, part)
            models, inside = (_tables(field.annotation), True) if field else ([], False)
            branch = field is not None and _tables_or_values(field.annotation)


def _models(place: Place) -> list[type[BaseModel]]:
    """Find the tables that may stand at a place."""
    *_, (models, _) = _walk([*place, "?"])
    return models


def _field(place: Place) -> FieldInfo | None:
    field = None
    for models, part in _walk(place):
        if isinstance(part, str):
            field = _named(models, part)
    return field


def _named(models: Sequence[type[BaseModel]], name: str) -> FieldInfo | None:
    fields = (field for model in models for key, field in model.model_fields.items() if name == (field.alias or key))
    return next(fields, None)


def _names(model: type[BaseModel]) -> list[str]:
    return [field.alias or name for name, field in model.model_fields.items()]


def _tables(annotation: object) -> list[type[BaseModel]]:
    if annotation is Fault:
        return list(KINDS.values())
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _tables(part)]


def _tables_or_values(annotation: object) -> bool:
    """Whether a key takes a table, or something else."""
    parts = (part for part in get_args(annotation) if part is not Ellipsis)
    kinds = {isinstance(part, type) and issubclass(part, BaseModel) for part in parts}
    return len(kinds) == 2


def _tag(model: type[BaseModel]) -> str | None:
    kind = model.model_fields.get("kind")
    values = get_args(kind.annotation) if kind else ()
    return str(values[0]) if values else None
