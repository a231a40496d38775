"""Targets of the values of a variant, as options of a run and as arguments of `emla run`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_origin

from ...base.option import SWEEP, FileOrObject, Option
from ...inputs.input import Input
from ...run.options import list_options, select_repeatable
from ...system.model import Replacement, Value

OPTION, FMU, START = "option", "replace", "set"
ACTUATOR, SHEET = "actuator", "sheet"
"""Kinds of targets: an option, a component whose FMU varies, a start value by its full name, a joint whose
actuator varies, or an entry of a data sheet by JOINT.TABLE.ENTRY.
"""


@dataclass(frozen=True)
class Target:
    """Where a value goes. A relative value multiplies `nominal`; one of a data sheet is in `unit`."""

    name: str
    kind: str = START
    nominal: float | None = None
    unit: str = ""


def needs_preparation(target: Target) -> bool:
    """Return whether another value of a target needs another simulation."""
    return target.kind in (FMU, ACTUATOR, SHEET) or (
        target.kind == OPTION and list_options()[target.name].is_prepared
    )


def select_run_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options that a run of a prepared simulation accepts."""
    declared = list_options()
    return {name: value for name, value in options.items() if not declared[name].is_prepared}


def assign_value(targets: Sequence[Target], value: Value | None) -> dict[str, Any]:
    """Return the options that set these targets to a value of the table of variants; none for None."""
    options: dict[str, Any] = {}
    if value is None:
        return options
    for target in targets:
        assigned = value
        # the table has the multiplier only where several targets have different nominal values
        if target.nominal is not None and len(targets) > 1:
            assigned = target.nominal * float(value)
        if target.unit:
            assigned = f"{float(value)!r} {target.unit}"
        if target.kind == OPTION:
            takes_several = get_origin(list_options()[target.name].type) is Sequence
            options[target.name] = [assigned] if takes_several else assigned
        else:
            options.setdefault(target.kind, {})[target.name] = assigned
    return options


def merge_options(parts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """Merge the options of several factors for one run."""
    merged: dict[str, Any] = {}
    for part in parts:
        for name, value in part.items():
            merged[name] = {**merged.get(name, {}), **value} if isinstance(value, Mapping) else value
    return merged


def format_arguments(options: Mapping[str, Any]) -> list[str] | None:
    """Return options as arguments of `emla run`; None if one is an object that only Python has."""
    declared = list_options(SWEEP)
    parts = [_format_option(declared[name], value) for name, value in select_repeatable(options).items()]
    return None if None in parts else [text for part in parts for text in part or ()]


def _format_option(option: Option, value: Any) -> list[str] | None:
    flag = option.flag
    if value is None or (value is False and option.type is not bool):
        return []
    if isinstance(value, bool):
        return [flag if value else f"--no-{flag.removeprefix('--')}"]
    if isinstance(value, Mapping):
        if any(isinstance(inner, FileOrObject) and inner.file is None for inner in value.values()):
            return None
        arguments = list[str]()
        for name, inner in value.items():
            is_fmu = isinstance(inner, Replacement)
            arguments += [flag, f"{name}={inner.fmu if is_fmu else _format_value(inner)}"]
            if is_fmu and inner.mapping is not None:
                arguments += ["--mapping", f"{name}={inner.mapping}"]
        return arguments
    if isinstance(value, (list, tuple)):
        if option.parse is not None:
            return [flag, ",".join(map(_format_value, value))]
        if any(isinstance(inner, Input) and not inner.is_text for inner in value):
            return None
        return [text for inner in value for text in (flag, _format_value(inner))]
    return [flag, _format_value(value)] if isinstance(value, (str, int, float, Path)) else None


def _format_value(value: Any) -> str:
    if isinstance(value, FileOrObject):
        return str(value.file)
    if isinstance(value, bool):
        return str(value).lower()
    # repr: the command must repeat the run to the last bit
    return repr(value) if isinstance(value, float) else str(value)
