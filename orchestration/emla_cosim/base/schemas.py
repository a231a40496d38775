"""JSON Schemas of files, from the structs that read them.

The schemas are of draft 7, which editors for TOML support.
"""

from collections.abc import Iterator, Mapping
from typing import Any, get_args

import msgspec

DRAFT = "http://json-schema.org/draft-07/schema#"


def make_schema(type_: type[msgspec.Struct], title: str) -> dict[str, Any]:
    """Return the JSON Schema of a file.

    Args:
        type_: The struct that reads the file.
        title: The title of the schema.
    """
    types = dict.fromkeys([type_, *_list_alternatives(type_, set())])
    _, components = msgspec.json.schema_components(types, ref_template="#/definitions/{name}")
    definitions = {name: _adapt(components[name]) for name in sorted(components)}
    top = definitions.pop(type_.__name__)
    return {"$schema": DRAFT, **top, "title": title, "definitions": definitions}


def _list_alternatives(type_: Any, visited: set[Any]) -> Iterator[type[msgspec.Struct]]:
    """Yield the structs that `one_of` names in a type; msgspec does not see them."""
    if isinstance(type_, msgspec.Meta):
        for alternative in (type_.extra or {}).get("types", {}).values():
            yield alternative
            yield from _list_alternatives(alternative, visited)
    elif isinstance(type_, type) and issubclass(type_, msgspec.Struct):
        if type_ not in visited:
            visited.add(type_)
            for field in msgspec.structs.fields(type_):
                yield from _list_alternatives(field.type, visited)
    else:
        for part in get_args(type_):
            yield from _list_alternatives(part, visited)


def _adapt(node: Any) -> Any:
    """Return a part of a schema of msgspec as a file in TOML has it, in draft 7."""
    if isinstance(node, list):
        return [_adapt(part) for part in node]
    if not isinstance(node, Mapping):
        return node
    schema = {
        key: {name: _adapt(part) for name, part in value.items()} if key == "properties" else _adapt(value)
        for key, value in node.items()
        if key not in ("default", "x-dotted")
    }
    if "description" in schema and isinstance(schema["description"], str):
        schema["description"] = " ".join(schema["description"].split())
    if "anyOf" in schema:
        parts = [part for part in schema.pop("anyOf") if part != {"type": "null"}]  # TOML has no null
        schema = {**parts[0], **schema} if len(parts) == 1 else {"anyOf": parts, **schema}
    if "prefixItems" in schema:
        items = schema.pop("prefixItems")
        schema["items"] = items[0] if all(item == items[0] for item in items) else items
    if "pattern" in schema and schema.get("type") == "number":
        schema["type"] = ["number", "string"]
    if "pattern" in schema and schema.get("type") == "array":  # a single quantity is a list of one
        schema["type"] = ["array", "number", "string"]
        schema["items"] = {"type": ["number", "string"], "pattern": schema["pattern"]}
    if "properties" in schema:
        schema["additionalProperties"] = False
        schema["properties"] = _nest(schema["properties"])
    if node.get("x-dotted") and isinstance(schema.get("additionalProperties"), Mapping):
        schema["additionalProperties"] = {"anyOf": [schema["additionalProperties"], {"type": "object"}]}
    return schema


def _nest(properties: Mapping[str, Any]) -> dict[str, Any]:
    """Add, to names with dots, the tables as which TOML reads them."""
    tables, inner = dict(properties), dict[str, dict[str, Any]]()
    for name, value in properties.items():
        first, dot, rest = name.partition(".")
        if dot:
            inner.setdefault(first, {})[rest] = value
    for first, parts in inner.items():
        tables[first] = {"type": "object", "properties": _nest(parts), "additionalProperties": False}
    return tables
