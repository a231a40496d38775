"""Scenario files: TOML that names a system and says how it is run."""

import difflib
import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..errors import CommandError, listed
from ..replacement import Replacement


@dataclass(frozen=True)
class ScenarioFile:
    """A scenario file; `system` is the name of a built-in one or the path of an SSP.

    Times in s, None where the file says nothing. `settings` are by the names of `Settings`.
    """

    description: str
    system: str
    controller: str | None
    start_time: float | None
    stop_time: float | None
    step_size: float | None
    algorithm: str | None
    settings: Mapping[str, Any]


def parse_scenario(text: str, where: str, folder: Path) -> ScenarioFile:
    """Read a scenario file; paths in it are relative to `folder`.

    Raises CommandError, with `where`, for what is not TOML, for unknown keys and for values of another
    type.
    """
    try:
        content = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CommandError(f"the scenario '{where}' is not TOML: {error}.") from error
    for key in content:
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, n=1)
            meant = f"did you mean '{near[0]}'?" if near else f"it may have {listed(sorted(_KEYS))}."
            raise CommandError(f"the scenario '{where}' has the key '{key}'; {meant}")
    read = {
        k: _KEYS[k][1](_Item(value, f"'{k}' of the scenario '{where}'", folder))
        for k, value in content.items()
    }
    if "system" not in read:
        raise CommandError(
            f"the scenario '{where}' has no system; write system = \"study\" or the path of an SSP."
        )
    own = {key: read.get(key) for key, (setting, _) in _KEYS.items() if setting is None}
    settings = {setting: read[key] for key, (setting, _) in _KEYS.items() if setting and key in read}
    return ScenarioFile(**{**own, "description": own["description"] or ""}, settings=settings)


@dataclass(frozen=True)
class _Item:
    """A value of a file, and what to call it."""

    value: Any
    name: str
    folder: Path

    def wrong(self, right: str) -> CommandError:
        return CommandError(f"{self.name} is {self.value!r}; it must be {right}.")

    def inside(self, key: str, value: Any) -> "_Item":
        return _Item(value, f"'{key}' in {self.name}", self.folder)


def _text(item: _Item) -> str:
    if not isinstance(item.value, str):
        raise item.wrong("a text")
    return item.value


def _number(item: _Item) -> float:
    if isinstance(item.value, bool) or not isinstance(item.value, (int, float)):
        raise item.wrong("a number")
    return float(item.value)


def _whole(item: _Item) -> int:
    if isinstance(item.value, bool) or not isinstance(item.value, int):
        raise item.wrong("a whole number")
    return item.value


def _truth(item: _Item) -> bool:
    if not isinstance(item.value, bool):
        raise item.wrong("true or false")
    return item.value


def _value(item: _Item) -> float | int | bool | str:
    if not isinstance(item.value, (str, int, float, bool)):
        raise item.wrong("a number, true, false or a text")
    return item.value


def _path(item: _Item) -> Path:
    return item.folder / _text(item)


def _each(one: Callable[[_Item], Any]) -> Callable[[_Item], Any]:
    def every(item: _Item) -> list[Any]:
        if not isinstance(item.value, list):
            raise item.wrong("a list")
        return [one(item.inside(str(i), value)) for i, value in enumerate(item.value)]

    return every


def _table(one: Callable[[_Item], Any]) -> Callable[[_Item], Any]:
    def entries(item: _Item) -> dict[str, Any]:
        if not isinstance(item.value, dict):
            raise item.wrong('a table with entries such as "joint.component" = ...')
        return {key: one(item.inside(key, value)) for key, value in item.value.items()}

    return entries


def _flat_table(one: Callable[[_Item], Any]) -> Callable[[_Item], Any]:
    """Of values that are no tables: names with dots may be written without quotes."""

    def entries(item: _Item) -> dict[str, Any]:
        flat = dict(_flat(item.value)) if isinstance(item.value, dict) else item.value
        return _table(one)(replace(item, value=flat))

    return entries


def _flat(table: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Entries by their whole name: TOML nests names with dots unless they are quoted."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from ((f"{key}.{name}", inner) for name, inner in _flat(value))
        else:
            yield key, value


def _replacement(item: _Item) -> Replacement:
    if isinstance(item.value, str):
        return Replacement(_path(item))
    if not isinstance(item.value, dict) or "fmu" not in item.value or set(item.value) - {"fmu", "mapping"}:
        raise item.wrong('a path, or { fmu = "...", mapping = "..." }')
    mapping = item.value.get("mapping")
    return Replacement(
        _path(item.inside("fmu", item.value["fmu"])),
        _path(item.inside("mapping", mapping)) if mapping is not None else None,
    )


_KEYS: dict[str, tuple[str | None, Callable[[_Item], Any]]] = {
    "description": (None, _text),
    "system": (None, _text),
    "controller": (None, _text),
    "start_time": (None, _number),
    "stop_time": (None, _number),
    "step_size": (None, _number),
    "algorithm": (None, _text),
    "parameters": ("parameter_sets", _each(_path)),
    "set": ("values", _flat_table(_value)),
    "replace": ("replacements", _table(_replacement)),
    "signals": ("signals", _each(_text)),
    "output": ("output", _path),
    "output_interval": ("output_interval", _number),
    "plots": ("plots", _truth),
    "extrapolation": ("extrapolation", _text),
    "coupling_tolerance": ("coupling_tolerance", _number),
    "error_tolerance": ("error_tolerance", _number),
    "step_multiples": ("multiples", _flat_table(_whole)),
    "order": ("order", _each(_text)),
    "real_time": ("real_time", _number),
    "flavour": ("flavour", _text),
}
"""Keys of a scenario file: the setting that each is, if it is one, and how its value is read."""
