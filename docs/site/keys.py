"""The page of all scenario keys: values and defaults from the models, meanings from docs/scenario.md."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from zenoh_cbef.faults import KINDS
from zenoh_cbef.scenario import Scenario

_PAGE = Path(__file__).resolve().parents[1] / "scenario.md"
_HEAD = """# All keys

Made from the code: each key of a scenario with the values that it takes and its default. A key whose default is "none"
may be left out: its value then follows from the rest, as the last column says. [The scenario file](../scenario.md)
explains tables, units and how keys work together.
"""
_COLUMNS = "| key | values | default | meaning |\n|---|---|---|---|\n"
_TYPES = {
    "string": "text",
    "integer": "integer",
    "number": "number",
    "boolean": "true, false",
    "array": "list",
    "object": "table",
}
Schema = dict[str, Any]


def page() -> str:
    """The page as Markdown."""
    schema = Scenario.model_json_schema(by_alias=True)
    tables = schema["$defs"]
    meanings = _meanings()
    plain = {name: field for name, field in schema["properties"].items() if name != "fault" and "$ref" not in field}
    parts = [_HEAD, "## Top level\n\n" + _table("", plain, meanings.get("Top level", {}))]
    for name, field in schema["properties"].items():
        if "$ref" in field:
            rows = tables[field["$ref"].rpartition("/")[2]]["properties"]
            parts.append(f"## `[{name}]`\n\n" + _table(f"{name}.", rows, meanings.get(f"`[{name}]`", {})))
    parts.append("## `[[fault]]`\n")
    said = meanings.get("`[[fault]]`", {})
    for kind, fault in sorted(KINDS.items()):
        model = fault.model_json_schema(by_alias=True)
        rows = {key: field for key, field in model["properties"].items() if key != "kind"}
        own = {key: said.get(f"{kind}.{key}", said.get(key, "")) for key in rows}
        parts.append(f"### `{kind}`\n\n{_cell(model.get('description', ''))}\n\n" + _table("", rows, own))
    return "\n".join(parts)


def _table(prefix: str, rows: Schema, meanings: dict[str, str]) -> str:
    lines = [
        f"| `{prefix}{key}` | {_cell(values(field))} | {_cell(_default(field))} | {meanings.get(key, '')} |\n"
        for key, field in rows.items()
    ]
    return _COLUMNS + "".join(lines)


def values(field: Schema) -> str:
    """What a key takes, in words, from its JSON Schema."""
    if "anyOf" in field and "description" not in field:
        return " or ".join(values(one) for one in field["anyOf"] if one.get("type") != "null")
    if "description" in field and "enum" not in field:
        return str(field["description"])
    if "enum" in field or "const" in field:
        return ", ".join(f"`{json.dumps(one)}`" for one in field.get("enum", [field.get("const")]))
    if field.get("type") == "array":
        return _list(field)
    if "$ref" in field:
        return "table"
    least = field.get("minimum", field.get("exclusiveMinimum"))
    most = field.get("maximum", field.get("exclusiveMaximum"))
    bounds = f", {_plain(least)} to {_plain(most)}" if least is not None and most is not None else ""
    return _TYPES.get(str(field.get("type")), "any") + bounds


def _list(field: Schema) -> str:
    if field.get("minItems") == field.get("maxItems") == 3:
        return "vector"
    inner = field.get("items") or (field.get("prefixItems") or [{}])[0]
    many = f"{field['minItems']} " if field.get("minItems") == field.get("maxItems", -1) else ""
    return f"list of {many}({values(inner)})" if inner else "list"


def _plain(limit: float) -> str:
    """A limit in words: large whole ones in groups of three digits, or as a power of two."""
    if isinstance(limit, float) or limit <= 10**6:
        return f"{limit:.6g}"
    return f"2^{limit.bit_length() - 1}" if limit.bit_count() == 1 else f"{limit:,}".replace(",", " ")


def _default(field: Schema) -> str:
    if "default" not in field:
        return "needed"
    return "none" if field["default"] is None else f"`{json.dumps(field['default'])}`"


def _meanings() -> dict[str, dict[str, str]]:
    """What docs/scenario.md says of each key, by section; links are made relative to the page's folder."""
    parts = re.split(r"^## (.+)$", _PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    found: dict[str, dict[str, str]] = {}
    for section, text in zip(parts[1::2], parts[2::2], strict=True):
        for line in text.splitlines():
            cells = line.strip().removeprefix("|").removesuffix("|").split(" | ")
            if line.startswith("| `") and len(cells) in {2, 3}:
                meaning = re.sub(r"\]\((?!https?:)(#?)", lambda m: "](../scenario.md#" if m[1] else "](../", cells[-1])
                kind = cells[0].strip("` ") + "." if len(cells) == 3 else ""
                keys = [f"{kind}{key}" for key in re.findall(r"`([^`]+)`", cells[-2])]
                found.setdefault(section, {}).update(dict.fromkeys(keys, meaning.strip()))
    return found


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
