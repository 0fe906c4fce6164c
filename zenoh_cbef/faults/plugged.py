"""Faults of other packages beside our own: which class a table of a scenario is read by."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import BaseModel, GetCoreSchemaHandler, ValidationError
from pydantic_core import CoreSchema, InitErrorDetails, PydanticCustomError
from pydantic_core.core_schema import any_schema, no_info_plain_validator_function, tagged_union_schema

from zenoh_cbef.faults.base import Fault, MessageFault
from zenoh_cbef.faults.outgoing import SenderFault
from zenoh_cbef.faults.sensing import SensorFault
from zenoh_cbef.plugins import Registry, told_options

PLUGGED = "plug-in"
"""What stands in place of the kind where a fault of another package is in error."""

_METHODS: Mapping[type[Fault], str] = {MessageFault: "effect", SenderFault: "sent", SensorFault: "measured"}


def fault_of(found: type, name: str) -> type[Fault]:
    """A class of another package as a fault. Raises ValueError, to stand after its key, if it is none."""
    for base, method in _METHODS.items():
        if issubclass(found, base):
            if getattr(found, method) is getattr(base, method):
                raise ValueError(f"names {name!r}, which is no fault: it lacks {method}(); add it, see docs/plugins.md")
            return found
    raise ValueError(
        f"names {name!r}, which is no fault: derive it from LinkFault, MessageFault, Absence, SenderFault or "
        "SensorFault of zenoh_cbef.extending"
    )


def _options_model(kind: type[Fault]) -> type[BaseModel] | None:
    """The model of a fault's options, as its field `options` has it; None for a fault without such a field."""
    field = kind.model_fields.get("options")
    model: object = field.annotation if field else None
    return model if isinstance(model, type) and issubclass(model, BaseModel) else None


@dataclass(frozen=True)
class ByKind:
    """Pydantic reads a fault's table by the class that its `kind` names: one of our own, or of another package."""

    kinds: Registry[Fault]

    def __get_pydantic_core_schema__(self, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        """One choice for each kind, and one for all kinds of other packages."""
        plugged = no_info_plain_validator_function(self._read, json_schema_input_schema=any_schema())
        choices = {name: handler.generate_schema(kind) for name, kind in self.kinds.own.items()}
        return tagged_union_schema({**choices, PLUGGED: plugged}, self._choice)

    def _choice(self, table: object) -> str | None:
        kind = table.get("kind") if isinstance(table, Mapping) else getattr(table, "kind", None)
        if isinstance(kind, str):
            return kind if kind in self.kinds.own else PLUGGED
        return None

    def _read(self, table: object) -> Fault:
        """A fault of another package. Raises ValidationError for wrong keys, ValueError for wrong options."""
        if isinstance(table, Fault):
            return table
        given = dict(table) if isinstance(table, Mapping) else {}
        name = str(given["kind"])
        try:
            kind = self.kinds.kind_of(name)
        except ValueError as error:
            said = PydanticCustomError("value_error", "{error}", {"error": str(error)})
            line = InitErrorDetails(type=said, loc=("kind",), input=name)
            raise ValidationError.from_exception_data("fault", [line]) from None
        return read_fault(kind, given)


def read_fault(kind: type[Fault], given: Mapping[str, object]) -> Fault:
    """A fault of another package from its table. Raises ValidationError for wrong keys, ValueError for options."""
    model, options, name = _options_model(kind), given.get("options", {}), str(given["kind"])
    names = [] if model is None else [field.alias or one for one, field in model.model_fields.items()]
    misplaced = [key for key in given if key in names and key not in kind.model_fields]
    if misplaced:
        raise ValueError(f"fault.{misplaced[0]} is an option of {name!r}; write it as fault.options.{misplaced[0]}")
    table = dict(given)
    if isinstance(options, Mapping) and (model or options):
        table["options"] = told_options(model, name, options, "fault.options")
    # As in the scenario, strict JSON: lists become tuples and integers floats, but no text or boolean becomes a number.
    return kind.model_validate_json(json.dumps(table), strict=True)
