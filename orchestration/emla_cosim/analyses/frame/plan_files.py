"""Files of plans: their sources, entries and options; scenario files with the values of a result."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, Self

import msgspec

from ...base.errors import CommandError
from ...base.files import read_text
from ...base.option import SWEEP
from ...base.toml_structs import Struct, check_fields, describe, dotted, list_given, read_toml, struct_of
from ...base.values import convert_value
from ...run.options import list_options
from ...run.scenarios.scenario import Scenario
from ...run.scenarios.scenario_file import (
    SCENARIOS,
    SYSTEMS,
    ScenarioFile,
    find_built_in,
    parse_scenario,
    with_options,
)
from ...study.loading import load
from ...system.model import System
from ..variants.factors import merge_options

Source = str | Path | System | Scenario
"""A scenario, its name or its file."""

NOT_IN_FILES = ("name", "options", "where")
"""Fields of a plan that are not entries of its file."""

IN_FILES: Mapping[str, Any] = {
    "scenario": Annotated[str, describe("name or path of what is run", "study")],
    "vary": Annotated[
        dict[str, Any],
        dotted("what varies, and how, by name", lambda table: isinstance(table.get("distribution"), str)),
    ],
    "metrics": list[str] | dict[str, str],
}
"""Types of fields in files of plans that differ from those in Python."""


@dataclass(frozen=True)
class AnalysisPlan:
    """The plan of an analysis: a scenario, what varies, and options for all runs.

    Args:
        name: name of the analysis.
        scenario: what is run: a scenario, its name or its file, or a `System`.
        vary: what varies, by name.
        description: one line on its purpose.
        options: values of options by name, for all runs.
        where: what error messages call the plan.
    """

    name: str
    scenario: Source
    vary: Mapping[str, Any] = field(default_factory=dict)
    description: str = field(default="", kw_only=True)
    options: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    where: str = field(default="the plan", kw_only=True)

    ADDED: ClassVar[Sequence[str]] = ()
    """Fields whose values `updated` adds to those of the plan."""

    UNCHECKED: ClassVar[Sequence[str]] = ()
    """Fields whose types `check` does not check, besides those of `IN_FILES`."""

    NOTHING_VARIES: ClassVar[str] = "varies nothing"
    """What is wrong with a plan without `vary`, and what to do."""

    @classmethod
    def types_in_files(cls) -> Mapping[str, Any]:
        """Return the types of fields in files that differ from those in Python."""
        return IN_FILES

    @classmethod
    def struct(cls) -> type[msgspec.Struct]:
        """Return the struct of a plan's file, without options."""
        return struct_of(cls, cls.types_in_files(), NOT_IN_FILES)

    def updated(self, changes: Mapping[str, Any]) -> Self:
        """Return the plan with other values; tables and `ADDED` are extended, None changes nothing.

        Args:
            changes: values of fields by name.

        Raises:
            CommandError: a value has a wrong type, or the plan has a mistake.
        """
        values = {name: value for name, value in changes.items() if value is not None}
        for name in (*self.ADDED, "vary", "options"):
            if name in values:
                before, label = getattr(self, name), f"'{name}' of {self.where}"
                kind = Mapping[str, Any] if isinstance(before, Mapping) else Sequence[Any]
                more = convert_value(values[name], kind, label)
                if name == "options":
                    values[name] = merge_options([before, more])
                else:
                    values[name] = {**before, **more} if isinstance(before, Mapping) else [*before, *more]
        changed = replace(self, **values)
        changed.check()
        return changed

    def check(self) -> None:
        """Raise CommandError for mistakes that can be found without the scenario."""
        check_fields(self, self.struct(), self.where, (*IN_FILES, *self.UNCHECKED))
        allowed = list_options(SWEEP)
        if wrong := [name for name in self.options if name in list_options() and name not in allowed]:
            raise CommandError(f"the option {wrong[0]} is for a single run; remove it from {self.where}.")
        if not self.vary:
            raise CommandError(f"{self.where} {self.NOTHING_VARIES}.")


def plan_struct(table: type[Struct]) -> type[Struct]:
    """Return the struct of a plan: its fields, and the options of a sweep."""
    return with_options(table, table.__name__, SWEEP)


def read_plan(
    source: object,
    kind: type[AnalysisPlan],
    noun: str,
    file_noun: str,
    built_in: Mapping[str, Callable[[], str]],
) -> tuple[dict[str, Any], Path | None]:
    """Read a plan by name, from a .toml file with `vary`, or from a scenario, which varies nothing.

    Args:
        source: The plan or the scenario.
        kind: The class of the plan.
        noun: What messages call a plan that is made of a scenario, such as `sweep`.
        file_noun: What messages call a plan that has a file.
        built_in: Functions that return the text of a plan, by name.

    Returns:
        The fields of the plan by name, and the folder of a file with a plan; None for any other source.

    Raises:
        CommandError: A file cannot be read, or an entry is unknown, missing or wrong.
    """
    if isinstance(source, (Scenario, System)):
        return {"name": source.name if isinstance(source, Scenario) else "system", "scenario": source}, None
    if not isinstance(source, (str, Path)):
        raise CommandError(f"the plan is {source!r}; it must be a plan or a scenario, by name or file.")
    path, label, table = Path(source), f"the {file_noun} '{source}'", kind.struct()
    if str(source) in built_in:
        values = _read_plan_fields(read_toml(built_in[str(source)](), label), table, label, None)
        return {"name": str(source), **values}, None
    if path.suffix.lower() == ".toml":
        content = read_toml(read_text(path, "the plan"), f"the plan '{path}'")
        if "vary" in content:
            return {"name": path.stem, **_read_plan_fields(content, table, label, path.parent)}, path.parent
    name = path.stem if path.suffix else path.name
    return {"name": name, "scenario": source, "where": f"the {noun} of '{source}'"}, None


def _read_plan_fields(
    content: Mapping[str, Any], table: type[msgspec.Struct], label: str, folder: Path | None
) -> dict[str, Any]:
    """Return the fields of a plan that a file has, by name, with `options` and `where`."""
    values = list_given(convert_value(content, plan_struct(table), label, folder))
    options = {name: values.pop(name) for name in [*values] if name not in table.__struct_fields__}
    # otherwise it is the name of a scenario that comes with the package
    if folder is not None and (folder / values["scenario"]).exists():
        values["scenario"] = str(folder / values["scenario"])
    return {**values, "options": options, "where": label}


def load_planned(plan: AnalysisPlan, options: Mapping[str, Any] = MappingProxyType({})) -> Scenario:
    """Return the scenario of a plan, with its options and these; raise CommandError if it does not load."""
    merged = merge_options([plan.options, options])
    if isinstance(plan.scenario, Scenario):
        return plan.scenario.with_options(merged)
    return load(plan.scenario, **merged)


def scenario_content(source: Source, options: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the content of a file that runs a scenario with options; None if it is only in Python."""
    read = _resolve_scenario(source)
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


def _resolve_scenario(source: Source) -> ScenarioFile | None:
    """Return the scenario of a built-in name or a TOML file, or an empty one for another file.

    It is None if the source is an object in memory.
    """
    if not isinstance(source, (str, Path)):
        return None
    name, path = str(source), Path(source)
    if name in SCENARIOS:
        return find_built_in(name)
    if path.suffix.lower() == ".toml":
        return parse_scenario(read_text(path, "the scenario"), name, path.parent)
    return ScenarioFile("", name, {}, name, Path())


def _is_plain(value: Any) -> bool:
    """Return whether a value consists of numbers, texts, lists and tables."""
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
    """Return a value as TOML; anything but lists, tables and numbers becomes a text."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(k)} = {_to_toml(x)}" for k, x in value.items()) + " }"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_to_toml, value)) + "]"
    if isinstance(value, (bool, int, float)):
        return json.dumps(value)
    return json.dumps(str(value), ensure_ascii=False)
