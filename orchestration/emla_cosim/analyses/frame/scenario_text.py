"""Write a scenario file that repeats a scenario with the start values of a result."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...base.files import read_text
from ...run.options import list_options
from ...run.scenarios.built_in import SCENARIOS, SYSTEMS, find_built_in
from ...run.scenarios.scenario_file import ScenarioFile, parse_scenario
from ..variants.targets import merge_options
from .plan_files import Source


def scenario_content(source: Source, options: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the content of a file that runs a scenario with options; None if it is only in Python."""
    read = _read_scenario_file(source)
    if read is None:
        return None
    system = read.system if read.system in SYSTEMS else str((read.folder / read.system).resolve())
    # absolute: the file is written to another folder than that of the scenario
    merged = merge_options([read.options, options])
    options = {
        n: x for n, x in merged.items() if n in list_options() and list_options()[n].in_file and _is_plain(x)
    }
    return {"system": system, **options}


def format_scenario(description: str, content: Mapping[str, Any] | None, values: Mapping[str, Any]) -> str:
    """Return the text of a scenario file.

    Args:
        description: Its description.
        content: What `scenario_content` returns.
        values: Start values to add.
    """
    fields = content or {}
    return _join_tables({"description": description, **fields, "set": {**fields.get("set", {}), **values}})


def _read_scenario_file(source: Source) -> ScenarioFile | None:
    if not isinstance(source, (str, Path)):
        return None
    name, path = str(source), Path(source)
    if name in SCENARIOS:
        return find_built_in(name)
    if path.suffix.lower() == ".toml":
        return parse_scenario(read_text(path, "the scenario"), name, path.parent)
    return ScenarioFile("", name, {}, name, Path())


def _is_plain(value: Any) -> bool:
    if isinstance(value, Mapping):
        return all(map(_is_plain, value.values()))
    if isinstance(value, (list, tuple)):
        return all(map(_is_plain, value))
    return isinstance(value, (str, int, float))


def _join_tables(content: Mapping[str, Any]) -> str:
    """Return plain data as TOML: keys first, then tables with quoted names."""
    lines = [f"{key} = {_to_toml(value)}" for key, value in content.items() if not isinstance(value, Mapping)]
    for name, table in content.items():
        if isinstance(table, Mapping) and table:
            lines += ["", f"[{name}]", *(f"{json.dumps(key)} = {_to_toml(x)}" for key, x in table.items())]
    return "\n".join([*lines, ""])


def _to_toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_to_toml(x)}" for k, x in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_to_toml, value)) + "]"
    if isinstance(value, (bool, int, float)):
        return json.dumps(value)
    return json.dumps(str(value), ensure_ascii=False)
